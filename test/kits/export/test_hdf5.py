# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""HDF5 in ALOHA's layout, opened again by h5py."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from exported import Recorded, stamps, vectors

from haptic_accel.bags.reading import read_bag
from haptic_accel.bags.writing import write_trial
from haptic_accel.core import topics
from haptic_accel.core.trial import Trial
from verbs import output_of


def test_frames_are_as_aloha_has_them_and_signals_those_of_the_bag_to_the_last_digit(
    tmp_path: Path, recorded: Recorded
) -> None:
    words = ("--format", "hdf5", "--fps", "50", "--out", tmp_path / "out")
    output_of("export", recorded.path, recorded.path, *words)
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == ["episode_0.hdf5", "episode_1.hdf5"]
    with h5py.File(tmp_path / "out" / "episode_0.hdf5") as file:
        assert (bool(file.attrs["sim"]), file.attrs["fps"]) == (True, 50)
        names = ("observations/qpos", "observations/qvel", "action")
        qpos, qvel, action = (file[name][()] for name in names)
        count = len(action)
        assert qpos.shape == qvel.shape == action.shape == (count, 3)
        assert file["observations/vibration/tool"].shape == (count, 20, 1)
        assert file["engaged"][()].all()
        about = json.loads(file["metadata"][()])
        assert [about["conditions"][n]["surface"] for n in set(file["condition"])] == ["plywood"]
        found = read_bag(recorded.path)
        ((begin, _),) = found.coupled(topics.MASTER)
        assert file["stamps"][0] == begin + 20_000_000
        master = found.signals[topics.MASTER_POSITION.name]
        index = np.searchsorted(master.stamps, begin + 20_000_000, side="right") - 1
        assert action[0] == pytest.approx(master.values[index], abs=1e-7)
        written = vectors(recorded.trial)
        assert set(file["signals"]) == set(written)
        for name, values in written.items():
            group = file["signals"][name]
            assert np.array_equal(group["values"][()], values)
            assert np.array_equal(group["stamps"][()], stamps(recorded.trial))
        assert file["signals/actuator_force"].attrs["unit"] == "N"


def test_what_is_wrong_with_a_bag_and_its_simulation_are_told(
    tmp_path: Path, recorded: Recorded
) -> None:
    shutil.copytree(recorded.path, tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-100_000])
    metadata = tmp_path / "bag" / "metadata.yaml"
    lines = metadata.read_text().replace('"slave": "simulated"', '"slave": "virtual"').splitlines()
    metadata.write_text("\n".join(lines[:-1]))
    output_of("export", tmp_path / "bag", "--format", "hdf5", "--out", tmp_path / "out")
    with h5py.File(tmp_path / "out" / "episode_0.hdf5") as opened:
        assert bool(opened.attrs["sim"])
        assert "was cut off" in " ".join(json.loads(opened["metadata"][()])["problems"])


def test_a_bag_without_arms_has_signals_and_says_so(tmp_path: Path) -> None:
    noise = [np.random.default_rng(n).normal(size=50) for n in range(4)]
    write_trial(tmp_path / "bag", Trial("x", "none", 1000.0, np.arange(50) / 1e3, *noise), {}, 10)
    words = ("--format", "hdf5", "--out", tmp_path / "out")
    assert "the arms were never coupled" in output_of("export", tmp_path / "bag", *words)
    with h5py.File(tmp_path / "out" / "episode_0.hdf5") as file:
        assert set(file) == {"metadata", "signals"}
        assert np.array_equal(file["signals/tool_acceleration/values"][:, 2], noise[0])
