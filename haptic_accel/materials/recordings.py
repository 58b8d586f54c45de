# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded accelerations as input: read from CSV or WAV files, and resampled."""

from __future__ import annotations

import math
import os
import stat
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core import resampling
from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, shown

# pandas and scipy.io take half a second to import: only who reads a file waits for them.

COLUMNS = ("acceleration", "accel", "acc", "a")
"""Default names of a CSV file's column of acceleration in m/s^2, in order of preference."""

FULL_SCALE = 5 * 9.80665
"""Acceleration at full scale of integer samples, m/s^2: the +-5 g of the paper's ADXL320J."""

UNCALIBRATED = "calibration = nothing: must be the acceleration at full scale, m/s^2"
"""Requirement for files whose values are relative."""

SHORTEST = 1.0
"""Minimum duration of a recording, s."""

LARGEST = 1.0e6
"""Maximum magnitude of an acceleration, m/s^2; a file that exceeds it holds something else."""

MOST_BYTES = 500_000_000
"""Maximum size of a file."""

BLOCK = 1 << 20
"""Bytes that are looked at in one go."""


def read_recording(
    path: str | os.PathLike[str],
    recording_rate: float,
    rate: float,
    column: str | None = None,
    full_scale: float = FULL_SCALE,
) -> FloatArray:
    """Read a recorded acceleration and resample it.

    A CSV file has a first row naming its columns; commas, semicolons or tabs separate, the
    decimal mark is a point, empty lines are skipped. A WAV file (recognised by its first bytes,
    or by its name) has integer samples, of which full scale is `full_scale`, or floating-point
    samples, which are taken as m/s^2. An offset is kept.

    Parameters
    ----------
    path : str or path-like
        The file.
    recording_rate : float
        Samples per second of the file. A CSV file needs it; with a WAV file it is 0, or the rate
        in the file itself.
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
        In one line: the file, line, column or parameter that is wrong, its value, and what is
        allowed. A recording shorter than `SHORTEST` is refused, as are NaN and infinity.
    """
    rate = resampling.checked_rate("rate", rate)
    name = shown(os.fspath(path))
    samples, recording_rate = read_samples(path, recording_rate, column, full_scale)
    seconds = len(samples) / recording_rate
    if seconds * rate > resampling.MOST_SAMPLES:
        raise ParameterError(
            f"{name}: {seconds:.3g} s are {seconds * rate:.3g} samples at {rate:g} Hz, "
            f"must be at most {resampling.MOST_SAMPLES}"
        )
    return resampling.resampled(samples, recording_rate, rate)


def read_samples(
    path: str | os.PathLike[str],
    recording_rate: float,
    column: str | None = None,
    full_scale: float | None = None,
) -> tuple[FloatArray, float]:
    """Read a recorded acceleration as it is, see `read_recording`.

    Returns
    -------
    samples : ndarray, shape (n,)
        Acceleration, m/s^2.
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        As `read_recording`; integer samples without `full_scale` are refused, too.
    """
    if recording_rate != 0.0:
        recording_rate = resampling.checked_rate("recording_rate", recording_rate)
    if full_scale is not None and not 0.0 < full_scale <= LARGEST:
        raise ParameterError(f"full_scale = {full_scale}: must be above 0 to {LARGEST:g} m/s^2")
    name = shown(os.fspath(path))
    start = _start(name, path)
    if start[:4] == b"RIFF" or Path(path).suffix.lower() == ".wav":
        own_rate, channels = _decode_wav(name, path, start)
        tolerance = resampling.RATE_TOLERANCE
        if recording_rate and not math.isclose(recording_rate, own_rate, rel_tol=tolerance):
            raise ParameterError(
                f"recording_rate = {recording_rate:g}: must be 0 or {own_rate:g} Hz as {name} says"
            )
        recording_rate = own_rate
        samples = _acceleration(name, channels, column or "1", full_scale)
    elif recording_rate == 0.0:
        raise ParameterError(
            f"recording_rate = 0: must be given for a CSV file such as {name}, "
            f"from {resampling.LOWEST_RATE:g} to {resampling.HIGHEST_RATE:g} Hz"
        )
    else:
        samples = _read_csv(name, path, column)
    seconds = len(samples) / recording_rate
    if seconds < SHORTEST:
        raise ParameterError(
            f"{name}: {len(samples)} samples at {recording_rate:g} Hz last {seconds:.3g} s, "
            f"must be at least {SHORTEST:g} s"
        )
    if len(samples) > resampling.MOST_SAMPLES:
        raise ParameterError(
            f"{name}: {len(samples)} samples: must be at most {resampling.MOST_SAMPLES}"
        )
    return samples, recording_rate


def _start(name: str, path: str | os.PathLike[str]) -> bytes:
    """Return the first bytes of a regular file."""
    try:
        # Checked before it is opened: a pipe or a device would be read for ever.
        status = os.stat(path)
        if stat.S_ISDIR(status.st_mode):
            wrong = "is a folder"
        elif not stat.S_ISREG(status.st_mode):
            wrong = "is not a regular file"
        elif status.st_size == 0:
            wrong = "is empty"
        elif status.st_size > MOST_BYTES:
            wrong = f"has {status.st_size} bytes, more than {MOST_BYTES}"
        else:
            with Path(path).open("rb") as file:
                return file.read(8)
    except OSError as error:
        wrong = error.strerror or type(error).__name__
    except ValueError as error:  # a NUL in the name
        wrong = str(error)
    what = name or "recording = ''"
    raise ParameterError(f"{what}: {wrong}, must be a CSV or WAV file")


def _read_csv(name: str, path: str | os.PathLike[str], column: str | None) -> FloatArray:
    """Return one column of numbers."""
    import pandas as pd

    try:
        _check_text(path)
        with Path(path).open(encoding="utf-8-sig") as file:
            blank, header = 0, file.readline()
            while header.isspace():
                blank, header = blank + 1, file.readline()
        # Lines are kept as they are in the file, for their numbers.
        table = pd.read_csv(
            path,
            sep=max(",;\t", key=header.count),
            header=None,
            skiprows=blank,
            skip_blank_lines=False,
            dtype=str,
            keep_default_na=False,
            skipinitialspace=True,
            encoding="utf-8-sig",
        )
    except UnicodeError:
        raise ParameterError(f"{name}: is not text, must be a CSV or WAV file") from None
    except ValueError as error:
        raise ParameterError(
            f"{name}: {shown(str(error).strip())}: must be comma-separated values"
        ) from None
    titles = [str(title).strip() for title in table.iloc[0]]
    found = _found(name, "column", (column,) if column else COLUMNS, titles)
    if titles.count(found) > 1:
        raise ParameterError(f"{name}: column = {shown(found)}: is there more than once")
    rows = table.iloc[1:]
    rows = rows[(rows.fillna("") != "").any(axis=1)]
    texts = rows[titles.index(found)]
    values = np.array(list(map(_number, texts)), dtype=np.float64)
    wrong = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if len(wrong):
        line = texts.index[wrong[0]] + blank + 1
        raise ParameterError(
            f"{name}: line {line}: {shown(found)} = {texts.iloc[wrong[0]][:40]!r}: "
            f"must be a number from {-LARGEST:g} to {LARGEST:g} m/s^2"
        )
    return values


def _check_text(path: str | os.PathLike[str]) -> None:
    """Raise UnicodeError for a file with a NUL, at which pandas 2.1 ends a number unnoticed."""
    with Path(path).open("rb") as file:
        while block := file.read(BLOCK):
            if b"\0" in block:
                raise UnicodeError


def _found(name: str, kind: str, wanted: Sequence[str], titles: Sequence[str]) -> str:
    """Return the first of the wanted titles that a file has."""
    found = next((title for title in wanted if title in titles), None)
    if found is None:
        raise ParameterError(
            f"{name}: column = {shown(' or '.join(wanted))}: no such {kind}; "
            f"there are {shown(', '.join(titles))}"
        )
    return found


def _number(text: str) -> float:
    """Return a number, or NaN for anything else."""
    try:
        return read_decimal(text)
    except ValueError:
        return math.nan


def _decode_wav(
    name: str, path: str | os.PathLike[str], start: bytes
) -> tuple[float, npt.NDArray[Any]]:
    """Return sampling rate and samples, shape (n, channels), as they are in the file."""
    from scipy.io import wavfile

    size, stated_size = os.stat(path).st_size, int.from_bytes(start[4:], "little") + 8
    if start[:4] == b"RIFF" and stated_size > size + 1:  # a last pad byte may lack
        raise ParameterError(
            f"{name}: is cut off after {size} bytes, its header says {stated_size}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of other programs
            rate, samples = wavfile.read(path)
        if not np.issubdtype(samples.dtype, np.number):
            raise TypeError(f"samples of type {samples.dtype}")
    except Exception as error:  # scipy raises a dozen kinds on a malformed header
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ParameterError(
            f"{name}: is not a WAV file of integer or floating-point samples ({shown(reason)})"
        ) from None
    own_rate = resampling.checked_rate(f"{name}: sampling rate", rate)
    return own_rate, samples if samples.ndim == 2 else samples[:, np.newaxis]


def _acceleration(
    name: str, channels: npt.NDArray[Any], channel: str, full_scale: float | None
) -> FloatArray:
    """Return the acceleration in one channel of a WAV file, m/s^2."""
    numbers = [str(number + 1) for number in range(channels.shape[1])]
    samples = channels[:, numbers.index(_found(name, "channel", (channel,), numbers))]
    acceleration = samples.astype(np.float64)
    if samples.dtype.kind != "f":
        if full_scale is None:
            raise ParameterError(f"{name}: {UNCALIBRATED}")
        half = 2.0 ** (8 * samples.dtype.itemsize - 1)
        # WAV files hold 8 bits and fewer as offset binary.
        acceleration -= half if samples.dtype.kind == "u" else 0.0
        acceleration *= full_scale / half
    wrong = np.flatnonzero(~(np.abs(acceleration) <= LARGEST))
    if len(wrong):
        raise ParameterError(
            f"{name}: sample {wrong[0]} = {acceleration[wrong[0]]:g}: "
            f"must be from {-LARGEST:g} to {LARGEST:g} m/s^2"
        )
    return acceleration
