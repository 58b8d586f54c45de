# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `composed_master`: the nodes of the master's host, as in `composed`, but the link.

The link stays apart: it is the only process that the network reaches.
"""

from __future__ import annotations

from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.half_coupler import HalfCoupler
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.master_device import MasterDevice
from haptic_accel.nodes.scheduling import run


def main() -> None:
    """Run the nodes."""
    # The arm is sampled first; what it and the peer's sample cause is due at the next tick.
    run("composed_master", MasterDevice, HalfCoupler, Compensator, join=join)


if __name__ == "__main__":
    main()
