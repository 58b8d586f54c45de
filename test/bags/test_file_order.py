# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of one recording: their order, and what contradicts metadata.yaml."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bag_maker import BagContent, meta, write_bag
from haptic_accel.analysis import load
from haptic_accel.bags.metadata import read_metadata
from haptic_accel.bags.reading import read_bag, read_bags
from haptic_accel.bags.spooling import spooled_bags
from haptic_accel.core.topics import TOOL_ACCELERATION

TOOL = TOOL_ACCELERATION.name
PERIOD = 1_000_000
START = 1_700_000_000_000_000_000


def write_files(bag: Path, names: list[str], *, seed: int = 1) -> list[float]:
    """Write a recording in files with some names, in order; return its values."""
    bag.mkdir()
    values = np.random.default_rng(seed).normal(size=1000 * len(names))
    for number, name in enumerate(names):
        content = BagContent(
            {TOOL: values[1000 * number :][:1000]},
            metadata=meta("dynamic", "vinyl"),
            start=START + 1000 * number * PERIOD,
        )
        part = write_bag(bag.parent / "part", content)
        (part / "part.mcap").rename(bag / name)
        shutil.rmtree(part)
    return [float(value) for value in values]


@pytest.mark.parametrize(
    "names",
    [
        ["0_bag_2026_11_26-23_07_58.mcap", "1_bag_2026_11_26-23_07_59.mcap", "2_bag_00.mcap"],
        ["c.mcap", "b.mcap", "a.mcap"],
        ["bag_2.mcap", "bag_10.mcap", "bag_11.mcap"],
        ["bag_1.mcap", "bag_0.mcap", "bag_2.mcap"],
    ],
)
def test_files_with_any_names_are_in_order_of_their_stamps(
    tmp_path: Path, names: list[str]
) -> None:
    values = write_files(tmp_path / "bag", names)
    bag = read_bag(tmp_path / "bag")
    assert bag.signals[TOOL].values[:, 2].tolist() == values
    assert bag.problems == ["metadata.yaml is missing: its files are read without it"]


def test_metadata_with_another_order_or_count_is_named(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    values = write_files(bag, ["bag_0.mcap", "bag_1.mcap"])
    one = read_metadata(write_bag(tmp_path / "one", BagContent({TOOL: np.zeros(1000)})))
    entries = [
        replace(one.files[0], name="bag_1.mcap", start=START + 10**9, end=START + 2 * 10**9),
        replace(one.files[0], name="bag_0.mcap"),
    ]
    replace(one, files=tuple(entries)).write(bag)
    found = read_bag(bag)
    assert found.signals[TOOL].values[:, 2].tolist() == values
    assert found.problems == [
        "metadata.yaml lists its files in another order than that of their content"
    ]
    entries[0] = replace(entries[0], messages=7)
    replace(one, files=tuple(entries)).write(bag)
    assert any(
        "metadata.yaml states 2007 messages, its files have 4000: first in bag_1.mcap" in line
        for line in read_bag(bag).problems
    )


def test_a_second_recording_in_the_folder_is_a_bag_of_its_own(tmp_path: Path) -> None:
    values = write_files(tmp_path / "bag", ["a_0.mcap", "a_1.mcap"])
    more = write_files(tmp_path / "other", ["b_0.mcap"], seed=2)
    shutil.copy(tmp_path / "other" / "b_0.mcap", tmp_path / "bag")
    first, second = read_bags(tmp_path / "bag")
    assert first.signals[TOOL].values[:, 2].tolist() == values
    assert second.signals[TOOL].values[:, 2].tolist() == more
    assert (first.files, second.files) == (["a_0.mcap", "a_1.mcap"], ["b_0.mcap"])
    told = "b_0.mcap is of another recording: it has other samples at the times of a_0.mcap"
    assert told in first.problems
    assert read_bag(tmp_path / "bag").files == first.files
    (tmp_path / "spool").mkdir()
    spooled = spooled_bags(tmp_path / "bag", tmp_path / "spool")
    assert [each.signals[TOOL].values[:, 2].tolist() for each in spooled] == [values, more]
    assert len(load(tmp_path / "bag").trials) == 2


def test_a_copy_of_a_file_counts_once(tmp_path: Path) -> None:
    values = write_files(tmp_path / "bag", ["a_0.mcap", "a_1.mcap"])
    shutil.copy(tmp_path / "bag" / "a_0.mcap", tmp_path / "bag" / "a_0 (copy).mcap")
    found = read_bag(tmp_path / "bag")
    assert found.signals[TOOL].values[:, 2].tolist() == values
    assert "2000 messages are there twice, and count once" in found.problems
