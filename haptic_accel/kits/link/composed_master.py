# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `composed_master`: the master host's nodes, as in `composed`, without the link.

The link is a separate process, the only one that the network can reach.
"""

from __future__ import annotations

from haptic_accel.kits.link.half_coupler import HalfCoupler
from haptic_accel.nodes import Compensator, build_master_device, join, run_nodes


def main() -> None:
    """Run the nodes."""
    # The arm is sampled first; the resulting forces are due at the next tick.
    run_nodes("composed_master", build_master_device, HalfCoupler, Compensator, join=join)


if __name__ == "__main__":
    main()
