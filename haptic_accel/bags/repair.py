"""Mends bags whose recording was cut off: by kill -9, by a power cut, by a full disk."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.rosbag2 import Reader

from haptic_accel.bags.compression import MAGIC as COMPRESSED_MAGIC
from haptic_accel.bags.compression import compress_file, decompress_file, is_compressed
from haptic_accel.bags.inspection import (
    JOURNAL,
    Contents,
    DamagedError,
    inspect,
    merged,
    storage_files,
    storage_of,
)
from haptic_accel.bags.metadata import (
    FILE_NAME,
    Metadata,
    MetadataError,
    read_metadata,
)
from haptic_accel.bags.rebuilding import (
    custom_data_of,
    rebuild_mcap,
    rebuild_sqlite,
    undo_transaction,
)
from haptic_accel.bags.recording_options import FILE, MCAP, MESSAGE, ZSTD
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS

DAMAGED = ".damaged"
"""Behind the name of what was there before."""

_LEFT_OVERS = (f"*.{ZSTD}.tmp", f"{FILE_NAME}.tmp")
"""What was being written when the recording was cut off."""


@dataclass
class Repair:
    """What was done to a bag.

    Attributes
    ----------
    path : Path
    messages : int
        In the bag now.
    duration : float
        From the first to the last, s.
    mended : list of str
        A line for each change; empty where nothing had to be changed.
    problems : list of str
        What could not be mended, a line each.
    """

    path: Path
    messages: int = 0
    duration: float = 0.0
    mended: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def repair(path: Path) -> Repair:
    """Make a bag whole again; one that is whole stays as it is.

    What is replaced is kept beside, its name with `DAMAGED` behind.

    Parameters
    ----------
    path : Path
        A bag's folder.

    Raises
    ------
    ParameterError
        It is no bag.
    OSError
        Something cannot be written.
    """
    if not path.is_dir():
        raise ParameterError(f"{path}: must be the folder of a bag")
    if not storage_files(path):
        raise ParameterError(f"{path}: must be a bag: it has no .mcap or .db3 file")
    return _Mender(path).mend()


class _Mender:
    """Goes through a bag's files, then through its metadata."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._done = Repair(folder)
        self._metadata: Metadata | None = None
        try:
            self._metadata = read_metadata(folder)
        except MetadataError:
            self._custom = self._custom_of_files()
        else:
            self._custom = dict(self._metadata.custom)

    def mend(self) -> Repair:
        for pattern in _LEFT_OVERS:
            for left_over in self._folder.glob(pattern):
                left_over.unlink()
        found = [self._file(path) for path in self._without_doubles()]
        contents = self._compressed_alike([kept for kept in found if kept])
        self._renew_metadata(contents)
        return self._done

    def _without_doubles(self) -> list[Path]:
        """Return the bag's files; of one both plain and compressed, the compressed."""
        files = storage_files(self._folder)
        names = {path.name for path in files}
        doubles = [path for path in files if f"{path.name}.{ZSTD}" in names]
        for path in doubles:
            self._set_aside(path)
            self._done.mended.append(f"{path.name}: is there compressed")
        return [path for path in files if path not in doubles]

    def _file(self, path: Path) -> Contents | None:
        """Return what a file holds, mended if need be; None where it is beyond that."""
        with TemporaryDirectory(dir=self._folder) as work:
            plain = path
            if is_compressed(path.name):
                plain = Path(work) / path.name.removesuffix(f".{ZSTD}")
                decompress_file(path, plain)
            try:
                contents = inspect(plain)
            except DamagedError as damage:
                try:
                    rebuilt = self._rebuilt(plain, Path(work))
                    contents = inspect(rebuilt)
                except DamagedError as error:
                    self._done.problems.append(f"{error}: set aside")
                    self._set_aside(path)
                    return None
                if is_compressed(path.name):
                    rebuilt = compress_file(rebuilt)
                self._replace(path, rebuilt)
                self._done.mended.append(f"{damage}: {contents.file.messages} messages kept")
        return replace(contents, file=replace(contents.file, name=path.name))

    def _rebuilt(self, plain: Path, work: Path) -> Path:
        """Return a whole file of the same name made from one that is not."""
        rebuilt = work / "rebuilt" / plain.name
        rebuilt.parent.mkdir()
        if storage_of(plain) == MCAP:
            self._done.problems += rebuild_mcap(plain, rebuilt, self._custom)
            return rebuilt
        # On a copy, with its journal: the original is kept as it was found.
        shutil.copy2(plain, rebuilt)
        journal = plain.with_name(plain.name + JOURNAL)
        if journal.exists():
            shutil.copy2(journal, rebuilt.with_name(rebuilt.name + JOURNAL))
        try:
            undo_transaction(rebuilt)
        except DamagedError:
            rescued = work / "rescued" / plain.name
            rescued.parent.mkdir()
            self._done.problems += rebuild_sqlite(rebuilt, rescued)
            return rescued
        return rebuilt

    def _compressed_alike(self, files: Sequence[Contents]) -> list[Contents]:
        """Compress what is not where other files of the bag are: it is all or none."""
        names = [contents.file.name for contents in files]
        if not any(map(is_compressed, names)):
            return list(files)
        alike = []
        for contents in files:
            name = contents.file.name
            if not is_compressed(name):
                plain = self._folder / name
                name = compress_file(plain).name
                plain.unlink()
                self._done.mended.append(f"{name}: compressed as the others are")
            alike.append(replace(contents, file=replace(contents.file, name=name)))
        return alike

    def _renew_metadata(self, files: Sequence[Contents]) -> None:
        """Write the metadata anew where it says something else than the files."""
        topics = merged(files)
        before = self._metadata
        now = Metadata(
            storage_of(self._folder / files[0].file.name) if files else MCAP,
            tuple(contents.file for contents in files),
            topics,
            custom=self._custom,
        )
        mode = self._compression_mode(files)
        now = replace(now, compression_mode=mode, compression_format=ZSTD if mode else "")
        if before:
            now = replace(now, distro=before.distro)
        self._done.messages = now.messages
        self._done.duration = now.duration / NANOSECONDS if now.messages else 0.0
        if not files or (before and _said(before) == _said(now)):
            return
        if before or (self._folder / FILE_NAME).exists():
            self._set_aside(self._folder / FILE_NAME)
        now.write(self._folder)
        self._done.mended.append(f"{FILE_NAME}: written anew")

    def _compression_mode(self, files: Sequence[Contents]) -> str:
        if any(is_compressed(contents.file.name) for contents in files):
            return FILE
        if self._metadata and self._metadata.compression_mode != FILE:
            return self._metadata.compression_mode
        return MESSAGE if self._compressed_messages(files) else ""

    def _compressed_messages(self, files: Sequence[Contents]) -> bool:
        """Look at the first message: one that is not compressed does not begin like that."""
        for contents in files:
            with Reader(self._folder / contents.file.name) as reader:
                for _, _, data in reader.messages():
                    return bytes(data[:4]) == COMPRESSED_MAGIC
        return False

    def _custom_of_files(self) -> dict[str, str]:
        """Return what a bag without metadata says of itself in those of its files it closed."""
        for path in storage_files(self._folder):
            if storage_of(path) == MCAP and not is_compressed(path.name):
                custom = custom_data_of(path)
                if custom:
                    return custom
        return {}

    def _replace(self, path: Path, by: Path) -> None:
        self._set_aside(path)
        by.replace(path)

    def _set_aside(self, path: Path) -> None:
        """Rename what was there before, with its journal."""
        for found in (path, path.with_name(path.name + JOURNAL)):
            if found.exists():
                found.rename(_free(found.with_name(found.name + DAMAGED)))


def _said(metadata: Metadata) -> tuple[object, ...]:
    """Return what of metadata must agree with the files."""
    return (
        [(file.name, file.messages) for file in metadata.files],
        sorted((t.name, t.type, t.messages) for t in metadata.topics),
        metadata.compression_mode,
    )


def _free(path: Path) -> Path:
    """Return a name that is not taken."""
    found, number = path, 2
    while found.exists():
        found = path.with_name(f"{path.name}-{number}")
        number += 1
    return found
