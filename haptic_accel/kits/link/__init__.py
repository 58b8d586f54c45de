# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Link of two hosts: transports, keys, half couplers and the processes that carry datagrams."""

# First of all, to limit the threads of BLAS before NumPy is loaded.
import haptic_accel.nodes  # noqa: F401
from haptic_accel.commands import KitVerb

VERB = KitVerb("Machine", "make keys for two hosts", "haptic_accel.kits.link.keys")

NETWORK = KitVerb(
    "Network",
    "delay, jitter and loss between two hosts",
    "haptic_accel.kits.link.emulated_network",
)
