# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One study in many guises: the same figures to the last digit, or a line that says why not.

A right study is copied, renamed, synchronised, cut, and mixed with files of other programs.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kits.study.studies import TEXT, write_study

from fuzzing import fuzz_few
from haptic_accel.analysis.frames import csv_text
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study.folder import JOURNAL, PARTICIPANTS, PROTOCOL, Study
from haptic_accel.kits.study.log import LOG
from haptic_accel.kits.study.planned_tests import planned_tests
from haptic_accel.kits.study.session import write_simulated
from haptic_accel.kits.study.tables import exclusions, tables

Change = Callable[[Path], object]
"""Change of a study's folder."""

NAMES = ("S01", "S02", "S03")

STRAY = (
    *(".DS_Store", "Thumbs.db", "desktop.ini", "log.jsonl~", ".log.jsonl.swp", "#log.jsonl#"),
    *("._log.jsonl", ".syncthing.log.jsonl.tmp", ".journal.jsonl.swp", "notes on P01.txt"),
)
"""Files that file managers, editors and synchronising programs leave."""

CONFLICTS = (
    *("{} (1)", "{} copy", "{} 2", "{} - Copy", "{} (conflicted copy 2026-11-26)"),
    *("{}.sync-conflict-20261126-101112-ABCDEFG", "{}-HOST", "{}a", "Copy of {}"),
)
"""Names that such programs give to copies."""


@pytest.fixture(scope="module")
def right(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a study of three simulated observers."""
    text = TEXT.replace("repeats: 12", "repeats: 6") + "rules: {participants: 3}\n"
    study = write_study(tmp_path_factory.mktemp("right") / "study", text)
    assert len(list(write_simulated(study, len(NAMES), 1))) == len(NAMES)
    return study.folder


def figures(folder: Path) -> str:
    """Return all numbers of a study."""
    study = Study(folder)
    sessions = study.sessions
    found = tables(study.protocol, sessions).by_name.items()
    results = planned_tests(study.protocol, sessions)
    planned = [(each.values, vars(each.outcome)) for each in results]
    return "".join(f"{name}\n{csv_text(frame)}" for name, frame in found) + repr(planned)


def rewrite(file: Path, change: Callable[[bytes], bytes]) -> None:
    if file.exists():
        file.write_bytes(change(file.read_bytes()))


def log(folder: Path, name: str) -> Path:
    return folder / PARTICIPANTS / name / LOG


def crlf(content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def scatter(folder: Path) -> None:
    """Put stray files everywhere."""
    for place in [folder, *(each for each in folder.rglob("*") if each.is_dir())]:
        for name in STRAY:
            (place / name).write_bytes(b"{}\n")


def behind_a_link(folder: Path) -> None:
    moved = folder.with_name("elsewhere")
    folder.rename(moved)
    folder.symlink_to(moved)


def in_reverse(folder: Path) -> None:
    """Write all files again in the reverse order, with other times."""
    for place, file in enumerate(sorted(folder.rglob("*.jsonl"), reverse=True)):
        content = file.read_bytes()
        file.unlink()
        file.write_bytes(content)
        os.utime(file, (place, place))


def bags_elsewhere(folder: Path) -> None:
    (folder.parent / "disk").mkdir()
    (folder / PARTICIPANTS / "S02" / "bags").symlink_to(folder.parent / "disk")


def broken_off(folder: Path) -> None:
    rewrite(log(folder, "S01"), lambda content: content + content[:50])


HARMLESS: dict[str, Change] = {
    "nothing": lambda folder: None,
    "stray files": scatter,
    "behind a link": behind_a_link,
    "in another order": in_reverse,
    "a protocol from Windows": lambda folder: rewrite(folder / PROTOCOL, crlf),
    "a byte-order mark": lambda folder: rewrite(folder / PROTOCOL, b"\xef\xbb\xbf".__add__),
    "a comment": lambda folder: rewrite(folder / PROTOCOL, b"# Pilot\n".__add__),
    "a copy of the protocol": lambda folder: shutil.copy(folder / PROTOCOL, folder / "old.yaml"),
    "results": lambda folder: shutil.copytree(folder / PARTICIPANTS, folder / "export" / "csv"),
    "an empty folder": lambda folder: (folder / PARTICIPANTS / "S09").mkdir(),
    "bags elsewhere": bags_elsewhere,
    "a line of a write that broke off": broken_off,
}
"""Guises that leave all figures as they are."""

FOLDERS = ("study", "a b", "#1?%20", "-x", "Ünï")
"""Names of a study's folder, one after the other."""


@pytest.mark.parametrize(
    ("change", "name"), [*zip(HARMLESS.values(), cycle(FOLDERS), strict=False)], ids=HARMLESS
)
def test_a_harmless_guise_changes_no_figure(
    right: Path, change: Change, name: str, tmp_path: Path
) -> None:
    folder = tmp_path / name
    shutil.copytree(right, folder)
    change(folder)
    assert figures(folder) == figures(right)
    assert Study(folder).doubts == []


def copied(folder: Path, name: str, form: str, lines: int | None) -> None:
    source, copy = folder / PARTICIPANTS / name, folder / PARTICIPANTS / form.format(name)
    if source.is_dir() and not copy.exists():
        shutil.copytree(source, copy)
        rewrite(copy / LOG, lambda content: b"".join(content.splitlines(keepends=True)[:lines]))


def renamed(folder: Path, name: str, other: str) -> None:
    source, target = folder / PARTICIPANTS / name, folder / PARTICIPANTS / other
    if source.is_dir() and not target.exists():
        source.rename(target)


def swapped(content: bytes, first: int, second: int) -> bytes:
    """Return lines with two of them in each other's place."""
    lines = content.splitlines(keepends=True)
    if lines:
        one, other = first % len(lines), second % len(lines)
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def without_lines(content: bytes, count: int) -> bytes:
    """Return a file without the last lines."""
    return b"".join(content.splitlines(keepends=True)[: -count or None])


names, numbers = st.sampled_from(NAMES), st.integers(0, 40)
files = st.one_of(st.just(Path(JOURNAL)), names.map(lambda name: Path(PARTICIPANTS, name, LOG)))


def on_folder(
    change: Callable[..., None], *values: st.SearchStrategy[Any]
) -> st.SearchStrategy[Change]:
    """Return changes of a folder with some values."""
    return st.builds(lambda *given_: lambda folder: change(folder, *given_), *values)


def on_file(
    change: Callable[..., bytes], *values: st.SearchStrategy[int]
) -> st.SearchStrategy[Change]:
    """Return changes of the content of a file."""

    def made(file: Path, *given_: int) -> Change:
        return lambda folder: rewrite(folder / file, lambda content: change(content, *given_))

    return st.builds(made, files, *values)


def duplicate(folder: Path, file: Path, form: str) -> None:
    """Copy a file of a study to one of another name."""
    if (folder / file).exists():
        shutil.copy(folder / file, folder / file.with_name(form.format(file.stem) + file.suffix))


CHANGES: st.SearchStrategy[Change] = st.one_of(
    st.sampled_from([scatter, in_reverse]),
    on_folder(copied, names, st.sampled_from(CONFLICTS), st.none() | numbers),
    on_folder(renamed, names, st.just("S10")),
    st.builds(lambda name: lambda path: shutil.rmtree(path / PARTICIPANTS / name, True), names),
    on_folder(duplicate, files, st.sampled_from(CONFLICTS[:-1])),
    st.builds(lambda file: lambda folder: (folder / file).unlink(missing_ok=True), files),
    on_file(without_lines, numbers),
    on_file(lambda content, cut: content[: -cut or None], st.integers(0, 3000)),
    on_file(swapped, numbers, numbers),
    on_file(crlf),
    on_file(lambda content: content + content[-400:]),
)


def is_smaller(study: Study) -> bool:
    """Return whether the last participants are in no log and not in the journal, as never there.

    Only the heads in the operator's notebook tell this from a smaller study.
    """
    logs = (study.folder / PARTICIPANTS).glob(f"*/{LOG}")
    written = sum(b"\n" in each.read_bytes() for each in logs)
    ends = sum(entry["kind"] == "head" for entry in study.journal)
    return written == ends == len(study.sessions) < len(NAMES)


@fuzz_few
@given(st.lists(CHANGES, min_size=1, max_size=3))
def test_any_guise_has_the_same_figures_or_a_line(right: Path, changes: list[Change]) -> None:
    with TemporaryDirectory() as place:
        folder = Path(place) / "study"
        shutil.copytree(right, folder)
        for change in changes:
            change(folder)
        study = Study(folder)
        try:
            same = figures(folder) == figures(right)
            said = [*study.doubts, *exclusions(study.protocol, study.sessions).values()]
        except ParameterError as error:
            same, said = False, [str(error)]
        assert same or said or is_smaller(study)
        assert all(len(line.splitlines()) == 1 for line in said)
