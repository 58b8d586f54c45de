# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel export``: bags in the formats of other programs."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import click
from rich.progress import TaskID

from haptic_accel import Bag, ParameterError, commands
from haptic_accel.bags import spooled_bags
from haptic_accel.core import whole_folder
from haptic_accel.core.parameters import one_line, printable
from haptic_accel.kits.export.signals import PUBLISHED, Writer, name_of

FPS = 30
"""Default frames per second, as of most cameras in learning datasets."""

LEROBOT, HDF5 = "lerobot", "hdf5"

FORMS = (LEROBOT, "parquet", HDF5, "csv", "wav", "mcap-audio")


@dataclass
class _Folders(Writer):
    """Writer that makes a folder for each bag."""

    folder: Path
    write: Callable[[Bag, Path], None]

    def add(self, name: str, bag: Bag) -> None:
        own = self.folder / name
        own.mkdir()
        self.write(bag, own)


@commands.verb(
    "haptic-accel export bags/plywood --format lerobot --out plywood_set",
    "haptic-accel export bags/* --format parquet --out series",
    "haptic-accel export bags/plywood --format lerobot --camera /camera/image_raw --out set",
    name="export",
)
@click.argument("bags", type=commands.FILE, metavar="BAG...", nargs=-1, required=True)
@click.option("--format", "form", type=click.Choice(FORMS), required=True, help="Format.")
@click.option("--out", type=commands.FILE, metavar="FOLDER", required=True, help="New folder.")
@click.option(
    "--fps",
    type=click.IntRange(1, 1000),
    show_default=False,
    help=f"Frames per second, {FPS} by default.",
)
@click.option(
    "--rate",
    type=click.FloatRange(1),
    metavar="HZ",
    show_default="recorded rate, or fps times a power of two below it",
    help="Samples per second of a frame's vibration: a multiple of fps.",
)
@click.option(
    "--task", metavar="TEXT", default="", show_default="from the surface", help="Task, in words."
)
@click.option(
    "--camera",
    "cameras",
    metavar="TOPIC",
    multiple=True,
    help="Images of a recorded topic; may be given several times.",
)
@click.option("--licence", metavar="TEXT", default="", help="Licence of the data, for readers.")
@click.option("--author", metavar="TEXT", default="", help="Author of the data, for readers.")
def export(
    bags: Sequence[Path],
    form: str,
    out: Path,
    fps: int | None,
    rate: float | None,
    task: str,
    cameras: Sequence[str],
    licence: str,
    author: str,
) -> None:
    """Write bags in a format that other programs open.

    lerobot is a LeRobotDataset v3.0 with a window of vibration for each frame, an episode for
    each engagement, and all signals as recorded beside it. parquet, csv and hdf5 (ALOHA's layout)
    have every sample with units; wav has tool and handle aligned, and mcap-audio is heard in
    Foxglove. fps and rate are for lerobot and hdf5, task and camera for lerobot.
    """
    framed = {"fps": fps, "rate": rate}
    named = {"task": task, "camera": ", ".join(cameras)}
    unused = {} if form == LEROBOT else named if form == HDF5 else framed | named
    for name, given in unused.items():
        if given:
            raise ParameterError(
                f"{name} = {printable(str(given))}: {form} has none: leave it out"
            )
    if out.exists():
        raise ParameterError(f"out = '{out}': must be a new folder")
    # Load libraries before handling signals: an interruption while loading may crash them.
    made_for = _writer(form, fps or FPS, rate or 0.0, task, cameras)
    try:
        with commands.interrupted_by_signals(), whole_folder(out) as folder:
            writer = made_for(folder)
            _write(writer, bags, folder.parent, {"licence": licence, "author": author})
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise commands.StoppedError(f"out = '{out}': cannot be written: {reason}") from None
    for note in writer.notes:
        print(note)
    print(f"{form}: {out}")


def _write(writer: Writer, bags: Sequence[Path], beside: Path, published: dict[str, str]) -> None:
    """Write the bags in turn; write their signals to the folder `beside` the result."""
    taken: set[str] = set()
    with commands.progress_bar() as progress:
        for path in bags:
            task = progress.add_task(f"reading {name_of(path)}", total=1.0)

            def advance(share: float, task: TaskID = task) -> None:
                progress.update(task, completed=share)

            with TemporaryDirectory(dir=beside) as spool:
                for bag in spooled_bags(path, Path(spool), advance):
                    if not bag.signals:
                        raise ParameterError(f"{path}: must have a signal of this graph")
                    bag.metadata[PUBLISHED] = published
                    base = name_of(path)
                    names = (f"{base}_{n}" if n > 1 else base for n in itertools.count(1))
                    name = next(each for each in names if each not in taken)
                    taken.add(name)
                    writer.notes.extend(f"{name}: {problem}" for problem in bag.problems)
                    progress.update(task, description=f"writing {name}", completed=1.0)
                    writer.add(name, bag)
        writer.close()


def _writer(
    form: str, fps: int, rate: float, task: str, cameras: Sequence[str]
) -> Callable[[Path], Writer]:
    """Return a function that makes the writer of a format for a folder."""
    if form == LEROBOT:
        from haptic_accel.kits.export.lerobot import LeRobotWriter

        return partial(LeRobotWriter, fps=fps, rate=rate, task=task, cameras=cameras)
    if form == HDF5:
        from haptic_accel.kits.export.hdf5 import Hdf5Writer

        return partial(Hdf5Writer, fps=fps, rate=rate)
    if form in ("parquet", "csv"):
        from haptic_accel.kits.export.tables import write_csv, write_parquet

        return partial(_Folders, write=write_csv if form == "csv" else write_parquet)
    from haptic_accel.kits.export.sound import write_audio, write_wav

    return partial(_Folders, write=write_wav if form == "wav" else write_audio)
