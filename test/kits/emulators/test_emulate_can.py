# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel emulate can``, and the graph on what it emulates."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.files import read_parameter_file
from running import Start
from verbs import output_of, status_of

RATE = 100.0  # Hz, so that it runs beside other tests


def tips(bag: Bag, until: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how far both tips have gone at the master's samples, before a time in ns."""
    master, slave = (bag.signals[f"{arm}/measured_cp"] for arm in ("master", "slave"))
    wanted = master.received < until
    # From the same moment on: before, an arm may have been elsewhere.
    stamps = master.stamps[wanted]
    moved = [
        np.column_stack([np.interp(stamps, arm.stamps, column) for column in arm.values.T])
        for arm in (master, slave)
    ]
    return moved[0] - moved[0][0], moved[1] - moved[1][0]


def slave_counts(bag: Bag, name: str) -> list[tuple[int, int]]:
    """Return when the slave's device reported which count."""
    reports = [found for found in bag.diagnostics if found.node.endswith("slave_device")]
    return [(found.received, int(found.values[name])) for found in reports]


def test_the_arms_couple_over_slcan_and_do_so_again_after_an_unplugging(
    haptic_accel: Start, tmp_path: Path
) -> None:
    folder, bag_path = tmp_path / "emulated", tmp_path / "bag"
    given = (f"folder:={folder}", f"rate:={RATE:g}", "kinematics:=planar")
    faults = ("faults:=unplug@2.5", "fault_seconds:=0.3")
    emulator = haptic_accel("emulate", "can", *given, *faults)
    words = emulator.wait_for("haptic-accel teleop master:=can slave:=can").split()[1:]
    teleop = haptic_accel(*words, "duration:=5", f"bag:={bag_path}")
    teleop.wait_for("can: slcan .*master: bus load up to .* % of 1 Mbit/s .2 joints at 100 Hz")
    emulator.wait_for("the arms have torques")
    teleop.wait_for("can: .*slave: no torque: the bus has gone")
    assert teleop.end() == 0, teleop.text
    assert emulator.end(signal.SIGINT) == 0, emulator.text
    assert not (folder / "slave").is_symlink(), "nothing is left"

    bag = read_bag(bag_path)
    disarmed = [when for when, count in slave_counts(bag, "disarmed") if count]
    master, slave = tips(bag, min(disarmed) - 1_500_000_000)
    # The emulated hand goes down and along, and the slave's tip with it.
    assert master[:, 2].min() < -0.01
    assert np.ptp(master[:, 0]) > 0.02
    for axis in (0, 2):
        assert np.corrcoef(master[:, axis], slave[:, axis])[0, 1] > 0.9
    assert not slave[:, 1].any()
    armed = [when for when, count in slave_counts(bag, "armed") if count]
    assert max(armed) > min(disarmed), "armed again"
    assert max(count for _, count in slave_counts(bag, "bus_losses")) == 1


def written(folder: Path) -> dict[str, CanParameters]:
    """Return what is told of the arms, by node."""
    read_parameter_file(folder / "can.yaml")
    content: dict[str, Any] = yaml.safe_load((folder / "can.yaml").read_text())
    return {key[4:]: section["ros__parameters"]["can"] for key, section in content.items()}


def test_both_arms_may_be_on_one_bus(tmp_path: Path) -> None:
    bus = ["interface:=virtual", "channel:=one"]
    shown = output_of("emulate", "can", f"folder:={tmp_path}", *bus, "duration:=0.05")
    assert f"rate:=500 params_file:={tmp_path}/can.yaml" in shown
    arguments = parse_arguments([f"params_file:={tmp_path}/can.yaml"])
    assert (arguments.master, arguments.slave) == ("can", "can")
    given = written(tmp_path)
    devices, joints = ("master_device", "slave_device"), (1, 2, 3)
    nodes = [[given[node][f"joint{number}.node_id"] for number in joints] for node in devices]
    assert nodes == [[0, 1, 2], [3, 4, 5]]


def test_without_a_folder_there_is_a_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert status_of("emulate", "can", "duration:=0.05", "kinematics:=stage") == 0
    (folder,) = tmp_path.iterdir()
    assert os.listdir(folder) == ["can.yaml"]
    assert written(folder)["master_device"]["kinematics"] == "stage"
