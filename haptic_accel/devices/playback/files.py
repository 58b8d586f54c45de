"""Recorded tool accelerations as input: read from CSV or WAV, resampled, made to loop."""

from __future__ import annotations

import csv
import io
import math
import os
import stat
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.resampling import (
    HIGHEST_RATE,
    LOWEST_RATE,
    MOST_SAMPLES,
    RATE_TOLERANCE,
    checked_rate,
    resampled,
)

# scipy.signal and scipy.io take half a second to import: only who reads a file waits for them.


COLUMNS = ("acceleration", "accel", "acc", "a")
"""Names that a CSV column of acceleration in m/s^2 is looked for by, the first found."""

FULL_SCALE = 5 * 9.80665
"""Acceleration at full scale of integer samples, m/s^2: the +-5 g of the paper's ADXL320J."""

SHORTEST = 1.0
"""A recording must last this long, s."""

LARGEST = 1.0e6
"""No acceleration may exceed this, m/s^2: beyond it a file holds something else."""


MOST_BYTES = 500_000_000
"""Limit of a file's size."""


def read_recording(
    path: str | os.PathLike[str],
    recording_rate: float,
    rate: float,
    column: str | None = None,
    full_scale: float = FULL_SCALE,
) -> FloatArray:
    """Read a recorded acceleration and resample it.

    A CSV file has a first row naming its columns; commas, semicolons or tabs separate, the
    decimal mark is a point, empty lines are skipped. A WAV file (told by its first bytes, or by
    its name) has integer samples, of which full scale is `full_scale`, or floating-point
    samples, which are taken as m/s^2. An offset is kept.

    Parameters
    ----------
    path : str or path-like
        The file.
    recording_rate : float
        Samples per second of the file. A CSV file needs it; with a WAV file it is 0, or what
        the file itself says.
    rate : float
        Samples per second wanted.
    column : str, optional
        Name of the column of a CSV file, by default the first of `COLUMNS` that it has. Number
        of the channel of a WAV file, by default ``"1"``, the first. The empty text is the
        default too.
    full_scale : float
        Acceleration that integer samples of a WAV file reach at full scale, m/s^2.

    Returns
    -------
    ndarray, shape (n,)
        Acceleration, m/s^2, n being the length times `rate` / `recording_rate`, rounded up.

    Raises
    ------
    ParameterError
        In one line: which file, row, column or parameter is wrong, its value, and what is
        allowed. A recording shorter than `SHORTEST` is refused, as are NaN and infinity.
    """
    rate = checked_rate("rate", rate)
    if recording_rate != 0.0:
        recording_rate = checked_rate("recording_rate", recording_rate)
    if not 0.0 < full_scale <= LARGEST:
        raise ParameterError(f"full_scale = {full_scale}: must be above 0 to {LARGEST:g} m/s^2")
    content = _content(path)
    name = _shown(os.fspath(path))
    if content[:4] == b"RIFF" or Path(path).suffix.lower() == ".wav":
        recording_rate, samples = _read_wav(name, content, recording_rate, column, full_scale)
    else:
        if recording_rate == 0.0:
            raise ParameterError(
                f"recording_rate = 0: must be given for a CSV file such as {name}, "
                f"from {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz"
            )
        samples = _read_csv(name, content, column)
    seconds = len(samples) / recording_rate
    if seconds < SHORTEST:
        raise ParameterError(
            f"{name}: {len(samples)} samples at {recording_rate:g} Hz last {seconds:.3g} s, "
            f"must be at least {SHORTEST:g} s"
        )
    if seconds * rate > MOST_SAMPLES:
        raise ParameterError(
            f"{name}: {seconds:.3g} s are {seconds * rate:.3g} samples at {rate:g} Hz, "
            f"must be at most {MOST_SAMPLES}"
        )
    return resampled(samples, recording_rate, rate)


# Files


def _content(path: str | os.PathLike[str]) -> bytes:
    """Return all bytes of a regular file."""
    name = _shown(os.fspath(path)) or "recording = ''"
    content = b""
    try:
        # Looked at before it is opened: a pipe or a device would be read for ever.
        wrong = _unfit(os.stat(path))
        if not wrong:
            content = Path(path).read_bytes()
    except OSError as error:
        wrong = error.strerror or type(error).__name__
    except ValueError as error:  # a NUL in the name
        wrong = str(error)
    if wrong:
        raise ParameterError(f"{name}: {wrong}, must be a CSV or WAV file")
    return content


def _unfit(status: os.stat_result) -> str:
    """Tell what keeps a file from being read, nothing if it may be."""
    if stat.S_ISDIR(status.st_mode):
        return "is a folder"
    if not stat.S_ISREG(status.st_mode):
        return "is not a regular file"
    if status.st_size == 0:
        return "is empty"
    if status.st_size > MOST_BYTES:
        return f"has {status.st_size} bytes, more than {MOST_BYTES}"
    return ""


def _shown(value: str) -> str:
    """Fit a text from outside into a one-line message."""
    shown = value if value.isprintable() else repr(value)
    return shown if len(shown) <= 200 else shown[:200] + "..."


def _listed(names: Sequence[str]) -> str:
    listed = ", ".join(_shown(name) or "''" for name in names[:20])
    return listed if len(names) <= 20 else f"{listed} and {len(names) - 20} more"


# CSV


def _read_csv(name: str, content: bytes, column: str | None) -> FloatArray:
    """Return one column of numbers."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ParameterError(
            f"{name}: is not text (byte {error.start} is not UTF-8), must be a CSV or WAV file"
        ) from None
    if "\0" in text:
        raise ParameterError(f"{name}: is not text (holds NUL), must be a CSV or WAV file")
    return _column(name, _rows(name, text), column)


def _rows(name: str, text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the line and the values of each row that is not empty."""
    lines = io.StringIO(text, newline="")
    rows = csv.reader(lines, delimiter=_delimiter(text), skipinitialspace=True, strict=True)
    try:
        for row in rows:
            if row:
                yield rows.line_num, row
    except csv.Error as error:
        raise ParameterError(
            f"{name}: line {rows.line_num}: {error}; must be comma-separated values"
        ) from None


def _delimiter(text: str) -> str:
    header = text.lstrip("\r\n").partition("\n")[0]
    return max(",;\t", key=header.count)


def _column(name: str, rows: Iterator[tuple[int, list[str]]], column: str | None) -> FloatArray:
    """Return the wanted column of rows, the first of which names the columns."""
    _, titles = next(rows, (1, []))
    header = [title.strip() for title in titles]
    index = _column_index(name, header, column)
    values: list[float] = []
    for line, row in rows:
        if len(row) != len(header):
            raise ParameterError(
                f"{name}: line {line}: {len(row)} values, must be {len(header)} as in the header"
            )
        value = _number(row[index])
        if not -LARGEST <= value <= LARGEST:
            raise ParameterError(
                f"{name}: line {line}: {_shown(header[index])} = {row[index][:40]!r}: "
                f"must be a number from {-LARGEST:g} to {LARGEST:g} m/s^2"
            )
        values.append(value)
        if len(values) > MOST_SAMPLES:
            raise ParameterError(f"{name}: more than {MOST_SAMPLES} rows, the most allowed")
    return np.array(values, dtype=np.float64)


def _column_index(name: str, header: Sequence[str], column: str | None) -> int:
    wanted = (column,) if column else COLUMNS
    found = next((title for title in wanted if title in header), None)
    if found is None:
        raise ParameterError(
            f"{name}: column = {_shown(' or '.join(wanted))}: no such column; "
            f"there are {_listed(header)}"
        )
    if header.count(found) > 1:
        raise ParameterError(f"{name}: column = {_shown(found)}: is there more than once")
    return header.index(found)


def _number(text: str) -> float:
    """Return a number, or NaN for anything else."""
    try:
        return float(text)
    except ValueError:
        return math.nan


# WAV


def _read_wav(
    name: str, content: bytes, recording_rate: float, column: str | None, full_scale: float
) -> tuple[float, FloatArray]:
    """Return sampling rate and acceleration of one channel."""
    stated, channels = _decode_wav(name, content)
    own_rate = checked_rate(f"{name}: sampling rate", stated)
    if recording_rate != 0.0 and not math.isclose(
        recording_rate, own_rate, rel_tol=RATE_TOLERANCE
    ):
        raise ParameterError(
            f"recording_rate = {recording_rate:g}: must be 0 or {own_rate:g} Hz as {name} says"
        )
    samples = channels[:, _channel_index(name, channels.shape[1], column)]
    if len(samples) > MOST_SAMPLES:
        raise ParameterError(f"{name}: {len(samples)} samples, must be at most {MOST_SAMPLES}")
    acceleration = _acceleration(samples, full_scale)
    wrong = np.flatnonzero(~(np.abs(acceleration) <= LARGEST))
    if len(wrong):
        raise ParameterError(
            f"{name}: sample {wrong[0]} = {acceleration[wrong[0]]:g}: "
            f"must be from {-LARGEST:g} to {LARGEST:g} m/s^2"
        )
    return own_rate, acceleration


def _decode_wav(name: str, content: bytes) -> tuple[int, npt.NDArray[Any]]:
    """Return sampling rate and samples, shape (n, channels), as they are in the file."""
    stated_size = int.from_bytes(content[4:8], "little") + 8
    if content[:4] == b"RIFF" and stated_size > len(content) + 1:  # a last pad byte may lack
        raise ParameterError(
            f"{name}: is cut off after {len(content)} bytes, its header says {stated_size}"
        )
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of other programs
            rate, samples = wavfile.read(io.BytesIO(content))
        if not np.issubdtype(samples.dtype, np.number):
            raise TypeError(f"samples of type {samples.dtype}")
    except Exception as error:  # scipy raises a dozen kinds on a malformed header
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ParameterError(
            f"{name}: is not a WAV file of integer or floating-point samples ({_shown(reason)})"
        ) from None
    return rate, samples if samples.ndim == 2 else samples[:, np.newaxis]


def _channel_index(name: str, channels: int, column: str | None) -> int:
    numbers = [str(number) for number in range(1, channels + 1)]
    wanted = column or numbers[0]
    if wanted not in numbers:
        raise ParameterError(
            f"{name}: column = {_shown(wanted)}: no such channel; there are {_listed(numbers)}"
        )
    return numbers.index(wanted)


def _acceleration(samples: npt.NDArray[Any], full_scale: float) -> FloatArray:
    """Convert a WAV file's samples to m/s^2."""
    values = samples.astype(np.float64)
    if samples.dtype.kind == "f":
        return values
    half = 2.0 ** (8 * samples.dtype.itemsize - 1)
    if samples.dtype.kind == "u":  # WAV files hold 8 bits and fewer as offset binary
        values -= half
    return values * (full_scale / half)
