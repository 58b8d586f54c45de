# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel emulate network``: a bad network between two hosts."""

from __future__ import annotations

import os
import sys

from haptic_accel import commands
from haptic_accel.core import host_and_port, is_loopback
from haptic_accel.graph import hurry
from haptic_accel.kits.link.relaying import RELAY_PRIORITY, RelayArguments, open_relay, serve_relay


@commands.verb(
    "haptic-accel emulate network delay:=0.05",
    "haptic-accel emulate network delay:=0.05 jitter:=0.01 loss:=0.02",
    "haptic-accel emulate network master:=desk.lab slave:=robot.lab delay:=0.1",
    name="network",
)
@commands.arguments(RelayArguments)
def emulate_network(arguments: RelayArguments) -> None:
    """Emulate a bad network between two hosts until Ctrl-C.

    Each host has the address of this machine as its peer. Meanwhile, a line of words changes the
    network: delay:=0.1 loss:=0 for a longer delay and no loss.
    """
    print(
        "emulating a network; in another terminal each, with this machine's address:\n"
        f"  {_side('master', arguments.master)}\n"
        f"  {_side('slave', arguments.slave)}\n"
        "on one machine, the second with another ROS_DOMAIN_ID",
        flush=True,
    )
    with commands.stop_on_signal() as stopped:
        try:
            relay = open_relay(arguments)
            hurry(RELAY_PRIORITY)
            serve_relay(relay, commands.print_line, stopped, _words_source())
        except OSError as error:
            raise commands.StoppedError(str(error)) from None


def _side(side: str, host: str) -> str:
    """Return the command line that runs a side."""
    address, port = host_and_port(host)
    here, keys = ("127.0.0.1", "") if is_loopback(address) else ("THIS_MACHINE", " keys:=KEYS")
    return f"haptic-accel teleop side:={side} peer:={here}{f':{port}' if port else ''}{keys}"


def _words_source() -> int | None:
    """Return the standard input; None if missing or the terminal of another program."""
    try:
        source = sys.stdin.fileno()
    except (AttributeError, OSError):  # standard input is closed, or no file
        return None
    return None if os.isatty(source) and not commands.is_ours(source) else source
