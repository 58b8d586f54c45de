# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel keys``: keys and certificates for the authentication of two hosts."""

from __future__ import annotations

from pathlib import Path

import click

from haptic_accel.commands import FILE, make_folder, next_command, verb
from haptic_accel.kits.link.datagrams import write_new, write_new_key

FOLDERS = {"robot": "slave", "operator": "master"}
"""Sides of the two hosts by folder."""


@verb(
    "haptic-accel keys robot.lab desk.lab", "haptic-accel keys robot,10.8.0.2 10.8.0.3 --out vpn"
)
@click.argument("robot")
@click.argument("operator")
@click.option(
    "--out", type=FILE, default="keys", metavar="FOLDER", help="New folder for both hosts' keys."
)
def keys(robot: str, operator: str, out: Path) -> None:
    """Make a key for the hosts ROBOT and OPERATOR, which both need, and certificates for zenoh.

    Each is a name or an address by which the other reaches it, or several separated by commas.
    The authority that signs both certificates keeps no key, so that nobody can make a third.
    """
    hosts = [robot.split(","), operator.split(",")]
    try:
        from haptic_accel.kits.link.certificates import certified_pair
    except ImportError:
        pair = []
        print("without certificates for transport:=zenoh: needs pip install 'haptic_accel[zenoh]'")
    else:
        pair = certified_pair(hosts)
    make_folder(out)
    folders = [out / name for name in FOLDERS]
    for folder in folders:
        folder.mkdir(mode=0o700)
    write_new_key(*folders)
    for folder, files in zip(folders, pair, strict=False):
        write_new(folder, files)
    (robot, *_), (operator, *_) = hosts
    for folder, own, peer in zip(folders, (robot, operator), (operator, robot), strict=True):
        print(f"{folder}: copy it to {own}")
        words = (f"side:={FOLDERS[folder.name]}", f"peer:={peer}", f"keys:={folder.name}")
        print(next_command("teleop", *words, host=own))
