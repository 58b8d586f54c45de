# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `composed`: all nodes for both arms, except the recorder, in one process.

The nodes exchange signals without messages, in lockstep order; a fault in one node ends all nodes.
The recorder is a separate process, so that writing delays no force.
"""

from __future__ import annotations

from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.coupler import Coupler
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.master_device import build_master_device
from haptic_accel.nodes.scheduling import run_nodes
from haptic_accel.nodes.slave_device import build_slave_device


def main() -> None:
    """Run the nodes."""
    # The order of lockstep: the master is sampled first, then the slave; the resulting forces are
    # due at the next tick.
    run_nodes("composed", build_master_device, build_slave_device, Coupler, Compensator, join=join)


if __name__ == "__main__":
    main()
