# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A node of the graph as it is, but with a trace of its device, and a clock that can be set.

Run as ``python traced_node.py EXECUTABLE FOLDER --ros-args ...``, or as ``python traced_node.py
teleop FOLDER WORDS`` for the verb with such nodes.
"""

from __future__ import annotations

import importlib
import mmap
import os
import struct
import sys
import time
from pathlib import Path
from typing import Any

from haptic_accel.cli.main import main
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.outside import node_module
from haptic_accel.devices import MASTERS, SLAVES, Sample
from haptic_accel.devices.simulated import SimulatedDevice
from haptic_accel.graph import supervisor

OPENED, TICK, ARM, ACTUATOR = range(4)
"""Kinds of records: the device was opened or closed, was sampled, or was given a force."""

RECORD = struct.Struct("=B5d23x")
"""Kind, steady time of the record and of the tick that it is for in s, and force in N.

Its size divides that of a page: the kernel writes by pages, and who reads meanwhile, or kills the
writer, would find a part of a record that lies in two."""

TELEOP = "teleop"
"""Verb that may stand in place of a node's executable."""

CLOCK, CLOCK_FILE = struct.Struct("=q"), "clock"
"""Lead of the nodes' clock over the system's in ns, and the name of the file that holds it."""


class TracedDevice(SimulatedDevice):
    """A simulated device that writes down what is asked of it."""

    trace: int

    def open(self) -> None:
        self._note(OPENED, 0.0)
        super().open()

    def read(self, time: float) -> Sample:
        self._note(TICK, time)
        return super().read(time)

    def write(self, time: float, **forces: Any) -> None:
        if (arm := forces.get("arm_force")) is not None:
            self._note(ARM, time, arm)
        if (actuator := forces.get("actuator_force")) is not None:
            self._note(ACTUATOR, time, actuator)
        super().write(time, **forces)

    def close(self) -> None:
        self._note(OPENED, 0.0)
        super().close()

    def _note(self, kind: int, moment: float, force: Vector = ZERO) -> None:
        os.write(self.trace, RECORD.pack(kind, time.monotonic(), moment, *force))


def trace_device(devices: dict[str, Any], path: Path) -> None:
    """Let the simulated device write down what is asked of it."""
    trace = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    traced = type("TracedDevice", (TracedDevice, devices["simulated"]), {"trace": trace})
    devices["simulated"] = traced


def follow_clock(path: Path) -> None:
    """Let this process' system time follow a file that tells by how much it was set."""
    system = time.time_ns
    with path.open("rb") as file:
        lead = mmap.mmap(file.fileno(), CLOCK.size, prot=mmap.PROT_READ)
    vars(time)["time_ns"] = lambda: system() + CLOCK.unpack(lead)[0]


if __name__ == "__main__":
    executable, folder, *sys.argv[1:] = sys.argv[1:]
    follow_clock(Path(folder) / CLOCK_FILE)
    if executable == TELEOP:
        supervisor.command = lambda process, own: [
            *(sys.executable, __file__, process.executable, folder),
            *process.ros_arguments(own),
        ]
        main([TELEOP, *sys.argv[1:]])
    for device, devices in {"master_device": MASTERS, "slave_device": SLAVES}.items():
        trace_device(devices, Path(folder) / device)
    importlib.import_module(node_module(executable)).main()
