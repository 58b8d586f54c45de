# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Deletion of a participant's data: removed and remaining files.

No link is followed but `bags` in the participant's folder, with which an operator may keep bags on
another disk; there, nothing but the recorder's bags is removed.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from haptic_accel.bags.folder import MCAP, METADATA
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.log import LOG

BAGS = "bags"
"""Name in a participant's folder: a folder of bags, or a link to one."""

BAG = re.compile(r"[0-9]{3,}")
"""Names of bags, counted from 000."""


@dataclass(frozen=True)
class Deletion:
    """Files, folders and links that a deletion removes, and those that it leaves.

    Attributes
    ----------
    removed : tuple of Path
        In this order; the log and its folder come last, so that an interrupted deletion can be
        repeated.
    left : tuple of Path
        Targets of links, and what is beside the bags in the target of `BAGS`.
    """

    removed: tuple[Path, ...]
    left: tuple[Path, ...]

    def carry_out(self) -> None:
        """Remove all that is to be removed."""
        for path in self.removed:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()


def plan_deletion(folder: Path, results: tuple[Path, ...]) -> Deletion:
    """Return the data that the deletion of a participant removes, and the data that stay.

    Parameters
    ----------
    folder : Path
        Folder of the participant, with a log.
    results : tuple of Path
        Folders of results, which hold all participants.

    Raises
    ------
    ParameterError
        The folder is a link or behind one, or shares a linked folder of bags.
    """
    for each in (folder, folder.parent):
        if each.is_symlink():
            raise ParameterError(
                f"{each}: is a link to {each.resolve()}: must be a folder; nothing is deleted"
                " behind a link, but bags"
            )
    bags = tuple(_linked_bags(folder / BAGS))
    own = sorted(each for each in folder.iterdir() if each.name != LOG)
    there = [each for each in results if each.is_symlink() or each.exists()]
    removed = (*there, *bags, *own, folder / LOG, folder)
    links = [each.resolve() for each in (*there, *own, folder / LOG) if each.is_symlink()]
    beside = [
        each
        for target in ([(folder / BAGS).resolve()] if (folder / BAGS).is_symlink() else [])
        if target.is_dir()
        for each in sorted(target.iterdir())
        if each not in bags
    ]
    return Deletion(removed, (*links, *beside))


def _linked_bags(link: Path) -> Iterator[Path]:
    """Yield the bags in the target of a link."""
    if not (link.is_symlink() and link.is_dir()):
        return
    target = link.resolve()
    for other in link.parent.parent.glob(f"*/{BAGS}"):
        folder = other.resolve()
        if other != link and (target in (folder, *folder.parents) or folder in target.parents):
            raise ParameterError(
                f"{link}: leads to {target}, as {other} does: must be a folder of its own, as it"
                " is not known whose bags are there"
            )
    yield from sorted(each for each in target.iterdir() if _is_bag(each))


def _is_bag(path: Path) -> bool:
    """Return whether a path is a folder as the recorder makes them, and holds nothing else."""
    if not BAG.fullmatch(path.name) or path.is_symlink() or not path.is_dir():
        return False
    return all(
        each.is_file() and not each.is_symlink() and (each.name == METADATA or MCAP in each.name)
        for each in path.iterdir()
    )
