# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated boards and drives behind pseudo-terminals, with fault injection."""

from haptic_accel.commands import KitVerb, LazyGroup

GROUP = LazyGroup(
    "emulate",
    {
        "Hardware": {
            "can": "two arms of ODrives on CAN",
            "serial": "boards of handle and tool on USB serial",
        }
    },
    module="haptic_accel.kits.emulators.command_line",
    entry_points="haptic_accel.emulators",
    help="Emulate boards or arms to test the drivers without hardware, or a bad network.",
    examples=["haptic-accel emulate serial", "haptic-accel emulate can faults:=estimates@2"],
)

VERB = KitVerb("Devices", "emulate boards or arms without hardware, or a bad network", group=GROUP)
