# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Verbs in folders whose names mean something to a shell, an address, a parser or an encoding."""

from __future__ import annotations

import json
import os
import re
import shutil
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.metadata import read_metadata
from haptic_accel.bags.reading import read_bag
from haptic_accel.setup.files import parameter_paths
from nightly import rest_slow
from verbs import ODD_NAMES, WITHOUT_FRICTION, next_words, output_of, refusal, status_of

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(params=rest_slow(ODD_NAMES[::-1]))
def odd(request: pytest.FixtureRequest, here: Path) -> Path:
    """Make a folder of an odd name."""
    folder = here / str(request.param)
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the numbers of an analysis of a bag at a usual path."""
    folder = tmp_path_factory.mktemp("reference")
    written = ("--out", folder / "report", "--json", folder / "found.json")
    assert status_of("analyze", DATA / "text", *written) == 0
    return without_paths(folder / "found.json")


def without_paths(file: Path) -> Any:
    """Return a JSON file's numbers in order."""
    return re.findall(r"(?<![\w.])-?\d+\.\d+(?!\w)", json.dumps(json.loads(file.read_text())))


def check_links(page: Path) -> None:
    """Check that the links of a page lead to files beside it."""
    links = re.findall(r'(?:href|src)="([^"#]+)"', page.read_text())
    assert links
    for link in links:
        if not link.startswith(("data:", "http")):
            assert os.path.exists(os.fsencode(page.parent) + b"/" + unquote_to_bytes(link)), link


def test_bags_are_read_repaired_replayed_and_analysed(odd: Path, reference: Any) -> None:
    bag = odd / "text"
    shutil.copytree(DATA / "text", bag)
    (bag / "metadata.yaml").unlink()
    shown = output_of("bag", "repair", bag, "--json", odd / "repair.json")
    assert next_words(shown) == [b"analyze", os.fsencode(bag)]
    assert status_of("bag", "info", bag, "--json", odd / "info.json") == 0
    assert json.loads((odd / "info.json").read_text())["path"] == str(bag)
    assert status_of("analyze", bag, "--out", odd / "report", "--json", odd / "found.json") == 0
    check_links(odd / "report" / "index.html")
    out = odd / "played"
    shown = output_of("replay", bag, "--lockstep", "duration:=0.5", "--out", out)
    assert next_words(shown) == [b"analyze", os.fsencode(out)]
    assert without_paths(odd / "found.json") == reference


def test_a_bag_of_the_other_storage_is_read(odd: Path) -> None:
    bag = odd / odd.name
    store = get_typestore(Stores.ROS2_JAZZY)
    here = odd.parent / "bag"
    with (
        Reader(DATA / "text") as reader,
        Writer(here, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer,
    ):
        add = partial(writer.add_connection, typestore=store)
        topics = {each.id: add(each.topic, each.msgtype) for each in reader.connections}
        for connection, received, data in reader.messages():
            writer.write(topics[connection.id], received, data)
    before = read_bag(here)
    shutil.move(here, bag)
    found = read_bag(bag)
    assert not found.problems
    assert found.counts == before.counts
    for name, signal in before.signals.items():
        np.testing.assert_array_equal(found.signals[name].stamps, signal.stamps)
        np.testing.assert_array_equal(found.signals[name].values, signal.values)


@pytest.mark.parametrize("name", rest_slow(ODD_NAMES[::-1]))
def test_a_bag_of_an_odd_name_is_replayed_into_another(here: Path, name: str) -> None:
    shutil.copytree(DATA / "text", here / name)
    assert status_of("replay", here / name, "--lockstep", "duration:=0.5", "--out", "played") == 0
    (out,) = (here / "played").iterdir()
    assert out.name.startswith(Path(name).stem), "named after its source"
    assert not read_bag(out).problems
    (file,) = out.glob("*.mcap")
    assert [entry.name for entry in read_metadata(out).files] == [file.name]
    assert " is whole: " in output_of("bag", "repair", out)


def test_a_file_that_no_metadata_can_list_is_refused_by_name(here: Path) -> None:
    bag = here / "bag"
    shutil.copytree(DATA / "text", bag)
    (file,) = bag.glob("*.mcap")
    file.rename(bag / f"{ODD_NAMES[-1]}_0.mcap")
    (bag / "metadata.yaml").unlink()
    line = refusal("bag", "repair", bag)
    assert "_0.mcap: must have a name in UTF-8, which metadata.yaml can list: rename it" in line
    assert len(list(bag.iterdir())) == 1
    assert read_bag(bag).signals, "still read without metadata.yaml"


def test_models_pages_and_parameter_files_are_written_and_read(odd: Path) -> None:
    out = odd / "identified"
    short = ("--trials", "1", "--duration", "1", *WITHOUT_FRICTION)
    words = next_words(output_of("identify", "--lockstep", "rig:=ideal", *short, "--out", out))
    assert words[1] == os.fsencode(f"params_file:={out / 'handle.yaml'}")
    check_links(out / "index.html")
    again = odd / "again"
    given = f"params_file:={out / 'handle.yaml'}"
    assert status_of("identify", "--lockstep", given, *short, "--out", again) == 0
    assert status_of("design", "rig:=ideal", "--json", odd / "design.json") == 0
    assert json.loads((odd / "design.json").read_text())


def test_a_path_with_an_equals_sign_is_no_grip(here: Path) -> None:
    (here / "grip=hook").mkdir()
    (here / "grip=hook" / "bench.csv").write_text("force,acceleration\n1,2\n")
    named = "grip=hook/bench.csv"
    for source in (named, f"pinch={named}", here / named):
        said = refusal("identify", "--from", source, "--recording-rate", "1000", "--out", "found")
        assert "bench.csv" in said
        assert "actuator_force" in said, "the file is read, and its columns are named"
        shutil.rmtree("found", ignore_errors=True)
    (here / "hook=a.csv").touch()
    (here / "a.csv").touch()
    said = refusal("identify", "--from", "hook=a.csv")
    assert (
        said == "from = 'hook=a.csv': must be './hook=a.csv' or 'hook=./a.csv': both files exist"
    )


def test_a_parameter_file_may_hold_a_comma(here: Path) -> None:
    for name in ("a,b.yaml", "c.yaml"):
        (here / name).touch()
    assert parameter_paths("a,b.yaml,c.yaml") == [here / "a,b.yaml", here / "c.yaml"]
    assert parameter_paths("c.yaml,d.yaml") == [here / "c.yaml", here / "d.yaml"]
