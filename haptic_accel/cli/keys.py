# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel keys``: the certificates with which two hosts know each other."""

from __future__ import annotations

from pathlib import Path

import click

from haptic_accel.cli.options import FILE, verb
from haptic_accel.cli.output import make_folder
from haptic_accel.core.parameters import ParameterError

MISSING_LIBRARY = "keys need cryptography: pip install 'haptic_accel[zenoh]'"


@verb(
    "haptic-accel keys robot.lab desk.lab", "haptic-accel keys robot,10.8.0.2 10.8.0.3 --out vpn"
)
@click.argument("robot")
@click.argument("operator")
@click.option(
    "--out", type=FILE, default="keys", metavar="FOLDER", help="New folder for the certificates."
)
def keys(robot: str, operator: str, out: Path) -> None:
    """Make certificates for the hosts ROBOT and OPERATOR, for transport:=zenoh.

    Each is a name or an address by which the other reaches it, or several with commas between.
    The authority that signs both keeps no key, so that nobody can make a third.
    """
    try:
        from haptic_accel.links.certificates import FOLDERS, certified_pair
    except ImportError:
        raise ParameterError(MISSING_LIBRARY) from None
    hosts = [robot.split(","), operator.split(",")]
    pair = certified_pair(hosts)
    make_folder(out)
    for name, host, identity in zip(FOLDERS, hosts, pair, strict=True):
        identity.write(out / name)
        print(f"{out / name}: copy it to {host[0]}, and there add keys:=FOLDER to teleop")
