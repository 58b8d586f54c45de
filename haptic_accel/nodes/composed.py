# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `composed`: all nodes of a host with both arms but the recorder in one process.

Messages then pass without waking another process, which costs most of a force's age and of the
CPU; but a fault in one node ends all. The recorder stays apart, so that writing delays no force.
"""

from __future__ import annotations

from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.coupler import Coupler
from haptic_accel.nodes.master_device import MasterDevice
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.slave_device import SlaveDevice


def main() -> None:
    """Run the nodes."""
    # The tool's sample makes the felt force, and both devices share one interpreter.
    run("composed", SlaveDevice, Compensator, MasterDevice, Coupler)


if __name__ == "__main__":
    main()
