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

"""Recorded accelerations as input: read from CSV or WAV files, and resampled."""

from __future__ import annotations

import csv
import errno
import io
import itertools
import math
import os
import warnings
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core import resampling
from haptic_accel.core.bounded_files import opened
from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import FloatArray
from haptic_accel.core.outliers import without_outliers
from haptic_accel.core.parameters import ParameterError, one_line, shown
from haptic_accel.core.warning import warn_once

# scipy.io is slow to import: only reading a WAV file needs it.

COLUMNS = ("acceleration", "accel", "acc", "a")
"""Default column names for acceleration in m/s^2 in a CSV file, in order of preference."""

FULL_SCALE = 5 * 9.80665
"""Acceleration at full scale of integer samples, m/s^2: the +-5 g of the paper's ADXL320J."""

UNCALIBRATED = "calibration = nothing: must be the acceleration at full scale, m/s^2"
"""Error message for files with relative values."""

SHORTEST = 1.0
"""Minimum duration of a recording, s."""

LARGEST = 1.0e6
"""Maximum magnitude of an acceleration, m/s^2; a file that exceeds it contains something else."""

MOST_BYTES = 300_000_000
"""Maximum size of a file: half an hour at 10 kHz."""

LONGEST_LINE = 1 << 16
"""Maximum length of a line of a CSV file, characters."""


def read_recording(
    path: str | os.PathLike[str],
    recording_rate: float,
    rate: float,
    column: str | None = None,
    full_scale: float = FULL_SCALE,
) -> FloatArray:
    """Read a recorded acceleration and resample it.

    A CSV file has a first row with the names of its columns. Commas, semicolons or tabs separate
    columns, decimals use a point, empty lines are skipped. A WAV file (recognised by its first
    bytes, or by its name) has integer samples with full scale `full_scale`, or floating-point
    samples in m/s^2. An offset is kept. Outliers are replaced, see `cleaned`.

    Parameters
    ----------
    path : str or path-like
        File to read.
    recording_rate : float
        Sampling rate of the file, Hz. Required for a CSV file; for a WAV file 0, or the rate in
        the file.
    rate : float
        Sampling rate of the result, Hz.
    column : str, optional
        Name of the column of a CSV file; default: the first of `COLUMNS` that exists. Number of
        the channel of a WAV file; default: ``"1"``, the first. The empty text also means the
        default.
    full_scale : float
        Acceleration at full scale of integer samples in a WAV file, m/s^2.

    Returns
    -------
    ndarray, shape (n,)
        Acceleration, m/s^2; n is the length times `rate` / `recording_rate`, rounded up.

    Raises
    ------
    ParameterError
        The message is one line with the file, line, column or parameter, its value, and the
        allowed values. A recording shorter than `SHORTEST` is rejected, as are NaN and infinity,
        and more than 1 % of outliers.
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
    """Read a recorded acceleration without resampling; see `read_recording`.

    Returns
    -------
    samples : ndarray, shape (n,)
        Acceleration, m/s^2.
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        As for `read_recording`; also for integer samples without `full_scale`.
    """
    if recording_rate != 0.0:
        recording_rate = resampling.checked_rate("recording_rate", recording_rate)
    if full_scale is not None and not 0.0 < full_scale <= LARGEST:
        raise ParameterError(f"full_scale = {full_scale}: must be above 0 to {LARGEST:g} m/s^2")
    name = shown(os.fspath(path))
    with _opened(name, path) as file:
        start = file.peek(8)[:8]
        if start[:4] == b"RIFF" or Path(path).suffix.lower() == ".wav":
            own_rate, channels = _decode_wav(name, file, start)
            tolerance = resampling.RATE_TOLERANCE
            if recording_rate and not math.isclose(recording_rate, own_rate, rel_tol=tolerance):
                raise ParameterError(
                    f"recording_rate = {recording_rate:g}: must be 0 or {own_rate:g} Hz"
                    f" as {name} says"
                )
            recording_rate = own_rate
            samples = _acceleration(name, channels, column or "1", full_scale)
        elif recording_rate == 0.0:
            raise ParameterError(
                f"recording_rate = 0: must be given for a CSV file such as {name}, "
                f"from {resampling.LOWEST_RATE:g} to {resampling.HIGHEST_RATE:g} Hz"
            )
        else:
            samples = _read_csv(name, file, column)
    seconds = len(samples) / recording_rate
    if seconds < SHORTEST:
        raise ParameterError(
            f"{name}: {len(samples)} samples at {recording_rate:g} Hz last {seconds:.3g} s, "
            f"must be at least {SHORTEST:g} s"
        )
    return cleaned(f"{name}: {column}" if column else name, samples), recording_rate


def cleaned(name: str, samples: FloatArray) -> FloatArray:
    """Replace the outliers of a recorded signal, and tell the user their number once.

    Raises
    ------
    ParameterError
        There are too many, see `without_outliers`.
    """
    samples, rejected = without_outliers(name, samples)
    if rejected:
        warn_once(
            f"{name}: {rejected} of {len(samples)} samples are outliers: replaced by interpolation"
        )
    return samples


def _too_long(name: str, samples: int) -> ParameterError:
    return ParameterError(f"{name}: {samples} samples: must be at most {resampling.MOST_SAMPLES}")


@contextmanager
def _opened(name: str, path: str | os.PathLike[str]) -> Iterator[io.BufferedReader]:
    """Open a file that is not empty."""
    try:
        with opened(path, MOST_BYTES) as file:
            if not file.peek(1):
                raise OSError(errno.EINVAL, "is empty")
            yield file
    except OSError as error:
        what = name or "recording = ''"
        reason = error.strerror or type(error).__name__
        raise ParameterError(f"{what}: {reason}, must be a CSV or WAV file") from None


def _read_csv(name: str, file: io.BufferedReader, column: str | None) -> FloatArray:
    """Return one column of numbers."""
    values = array("d")
    try:
        lines = _lines(name, file)
        blank, header = next(
            ((number, line) for number, line in enumerate(lines) if not line.isspace()), (0, "")
        )
        separator = max(",;\t", key=header.count)
        rows = csv.reader(
            itertools.chain([header], lines),
            delimiter=separator,
            skipinitialspace=True,
            strict=True,
        )
        titles = [title.strip() for title in next(rows)]
        found = _found(name, "column", (column,) if column else COLUMNS, titles)
        if titles.count(found) > 1:
            raise ParameterError(f"{name}: column = {shown(found)}: exists more than once")
        place = titles.index(found)
        for row in rows:
            if not any(row):
                continue
            text = row[place] if place < len(row) else ""
            value = _number(text) if len(row) <= len(titles) else math.nan
            if not abs(value) <= LARGEST:
                line = f"{name}: line {blank + rows.line_num}"
                if len(row) > len(titles):
                    raise ParameterError(
                        f"{line}: {len(row)} values: must be {len(titles)} at most, as the header"
                    )
                raise ParameterError(
                    f"{line}: {shown(found)} = {text[:40]!r}: "
                    f"must be a number from {-LARGEST:g} to {LARGEST:g} m/s^2"
                )
            values.append(value)
            if len(values) > resampling.MOST_SAMPLES:
                raise _too_long(name, len(values))
    except UnicodeError:
        raise ParameterError(f"{name}: is not text, must be a CSV or WAV file") from None
    except csv.Error as error:
        raise ParameterError(
            f"{name}: {shown(str(error))}: must be comma-separated values"
        ) from None
    return np.array(values, dtype=np.float64)


def _lines(name: str, file: io.BufferedReader) -> Iterator[str]:
    """Yield the lines of a text; long lines are rejected."""
    text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
    while line := text.readline(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise ParameterError(f"{name}: a line has more than {LONGEST_LINE} characters")
        if "\0" in line:
            raise UnicodeError
        yield line


def _found(name: str, kind: str, wanted: Sequence[str], titles: Sequence[str]) -> str:
    """Return the first of the given column titles that a file has."""
    found = next((title for title in wanted if title in titles), None)
    if found is None:
        raise ParameterError(
            f"{name}: column = {shown(' or '.join(wanted))}: no such {kind}; "
            f"there are {shown(', '.join(titles))}"
        )
    return found


def _number(text: str) -> float:
    """Return a number; NaN for any other text."""
    try:
        return read_decimal(text)
    except ValueError:
        return math.nan


def _decode_wav(
    name: str, file: io.BufferedReader, start: bytes
) -> tuple[float, npt.NDArray[Any]]:
    """Return sampling rate and unconverted samples, shape (n, channels)."""
    from scipy.io import wavfile

    size, stated_size = os.fstat(file.fileno()).st_size, int.from_bytes(start[4:], "little") + 8
    if start[:4] == b"RIFF" and stated_size > size + 1:  # the last pad byte may be missing
        raise ParameterError(
            f"{name}: is cut off after {size} bytes, its header says {stated_size}"
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks of other programs
            rate, samples = wavfile.read(file)
        if not np.issubdtype(samples.dtype, np.number):
            raise TypeError(f"samples of type {samples.dtype}")
    except Exception as error:  # scipy raises a dozen kinds of errors for a malformed header
        reason = shown(one_line(error))
        raise ParameterError(
            f"{name}: is not a WAV file of integer or floating-point samples ({reason})"
        ) from None
    own_rate = resampling.checked_rate(f"{name}: sampling rate", rate)
    return own_rate, samples if samples.ndim == 2 else samples[:, np.newaxis]


def _acceleration(
    name: str, channels: npt.NDArray[Any], channel: str, full_scale: float | None
) -> FloatArray:
    """Return the acceleration in one channel of a WAV file, m/s^2."""
    numbers = [str(number + 1) for number in range(channels.shape[1])]
    if len(channels) > resampling.MOST_SAMPLES:
        raise _too_long(name, len(channels))
    samples = channels[:, numbers.index(_found(name, "channel", (channel,), numbers))]
    acceleration = samples.astype(np.float64)
    if samples.dtype.kind != "f":
        if full_scale is None:
            raise ParameterError(f"{name}: {UNCALIBRATED}")
        half = 2.0 ** (8 * samples.dtype.itemsize - 1)
        # WAV files store 8 bits and fewer as offset binary.
        acceleration -= half if samples.dtype.kind == "u" else 0.0
        acceleration *= full_scale / half
    wrong = np.flatnonzero(~(np.abs(acceleration) <= LARGEST))
    if len(wrong):
        raise ParameterError(
            f"{name}: sample {wrong[0]} = {acceleration[wrong[0]]:g}: "
            f"must be from {-LARGEST:g} to {LARGEST:g} m/s^2"
        )
    return acceleration
