# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded accelerations as input: read from CSV or WAV files, and resampled.

Sizes and metadata of a WAV file are checked before its samples are decoded.
"""

from __future__ import annotations

import errno
import io
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from haptic_accel.core import sampling
from haptic_accel.core.files import opened
from haptic_accel.core.model import FloatArray
from haptic_accel.core.outliers import without_outliers
from haptic_accel.core.parameters import ParameterError, shown, warn_once
from haptic_accel.materials import columns as tables

MOST_CHUNKS = 1000
"""Maximum number of chunks in a file; programs write fewer than ten."""

FORMAT, DATA = b"fmt ", b"data"
"""Names of the chunks that each file has once."""

ORDERS: Mapping[bytes, Literal["little", "big"]] = {b"RIFF": "little", b"RIFX": "big"}
"""Byte order by the first four bytes of a file."""

STREAMED = 0x7FFFF000
"""Size, bytes, from which on a stated size means unknown, as 0 does: streams state such sizes, and
no accepted file is that large."""

SILENT = 1e-3
"""Standard deviation relative to that of the loudest channel below which a channel is silent."""


def is_wav(start: bytes) -> bool:
    """Return whether a file begins with the bytes of a WAV file."""
    return start[:4] in ORDERS


def read_wav(
    name: str, content: bytes, requested: Sequence[str], wording: tables.Wording
) -> tuple[float, list[FloatArray]]:
    """Return sampling rate and channels of a WAV file, relative to full scale.

    All encodings are scaled to -1 to 1. Floating-point samples may exceed this range. A chunk of
    unknown size, as in streams, extends to the end of the file. The byte after a chunk of odd
    length may be missing.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    content : bytes
        The whole file.
    requested : sequence of str
        Numbers of the channels, from 1; an empty text for the first that is not silent. Other
        channels are logged.
    wording : Wording

    Returns
    -------
    rate : float
        Samples per second.
    channels : list of ndarray, shape (n,)

    Raises
    ------
    ParameterError
        The file is cut off, has too many chunks, channels or samples, lacks a channel, or is not a
        WAV file of integer or floating-point samples.
    """
    order = ORDERS.get(content[:4])
    if not order or content[8:12] != b"WAVE":
        raise _not_wav(name, "it does not begin with RIFF and WAVE")
    rate, frames = _decoded(name, content[:4], order, _chunks(name, content, order))
    numbers = [str(number + 1) for number in range(frames.shape[1])]
    for channel in requested:
        if channel and channel not in numbers:
            raise tables.missing(name, "channel", (channel,), numbers, wording)
    chosen = [numbers.index(each) if each else _heard(name, frames, wording) for each in requested]
    own_rate = sampling.checked_rate(f"{name}: sampling rate", rate)
    return own_rate, [_relative(frames[:, number]) for number in chosen]


def _chunks(name: str, content: bytes, order: Literal["little", "big"]) -> dict[bytes, memoryview]:
    """Return the chunks of format and samples; their sizes must match that of the file."""
    size, stated = len(content), int.from_bytes(content[4:8], order)
    end = stated + 8 if 0 < stated < STREAMED else size
    if end > size + 1:  # the last pad byte may be missing
        raise ParameterError(f"{name}: is cut off after {size} bytes, its header says {end}")
    found: dict[bytes, memoryview] = {}
    offset, count = 12, 0
    while offset + 8 <= end and _is_name(kind := content[offset : offset + 4]):
        count += 1
        if count > MOST_CHUNKS:
            raise ParameterError(f"{name}: has more than {MOST_CHUNKS} chunks")
        begin = offset + 8
        length = int.from_bytes(content[offset + 4 : begin], order)
        left = max(min(end, size) - begin, 0)
        if kind == DATA and (
            length >= STREAMED or not (length or _is_name(content[begin : begin + 4]))
        ):
            length = left
        if kind == DATA and length > left:
            raise ParameterError(
                f"{name}: its samples have {length} bytes, but it ends after {left} of them"
            )
        if kind in found:
            raise ParameterError(f"{name}: has 2 chunks {kind.decode()!r}: must have one")
        offset = begin + length
        if kind in (FORMAT, DATA):
            found[kind] = memoryview(content)[begin:offset]
        if length % 2 and not _is_name(content[offset : offset + 4]):
            offset += 1  # some programs omit this byte
    if (left := size - offset) > 0:
        warn_once(f"{name}: {left} bytes after its samples are not read")
    return found


def _is_name(text: bytes) -> bool:
    """Return whether four bytes can be the name of a chunk."""
    return len(text) == 4 and text.isascii() and text.decode().isprintable()


def _decoded(
    name: str, mark: bytes, order: Literal["little", "big"], chunks: Mapping[bytes, memoryview]
) -> tuple[int, npt.NDArray[Any]]:
    """Return the sampling rate and the samples of all channels, shape (n, channels)."""
    from scipy.io import wavfile

    missed = [kind.decode() for kind in (FORMAT, DATA) if kind not in chunks]
    if missed:
        raise _not_wav(name, f"it has no chunk {missed[0]!r}")
    count, frame = (int.from_bytes(chunks[FORMAT][at : at + 2], order) for at in (2, 12))
    if len(chunks[DATA]) > sampling.MOST_SAMPLES * max(frame, 1) or count > tables.MOST_CHANNELS:
        raise ParameterError(
            f"{name}: {len(chunks[DATA])} bytes of {count} channels: must be at most"
            f" {sampling.MOST_SAMPLES} samples of {tables.MOST_CHANNELS}"
        )
    parts = b"WAVE"
    for kind in (FORMAT, DATA):
        length = len(chunks[kind])
        parts += kind + length.to_bytes(4, order) + chunks[kind] + bytes(length % 2)
    try:
        rate, samples = wavfile.read(io.BytesIO(mark + len(parts).to_bytes(4, order) + parts))
        _relative(samples[:1])
    except Exception:  # scipy raises a dozen kinds of errors for a malformed format
        raise _not_wav(name, "its format is unknown, or contradicts itself") from None
    channels = samples if samples.ndim > 1 else samples[:, np.newaxis]
    return rate, channels


def _heard(name: str, frames: npt.NDArray[Any], wording: tables.Wording) -> int:
    """Return the first channel that is not silent, and log the other channels."""
    if frames.shape[1] == 1:
        return 0
    with np.errstate(all="ignore"):  # values are checked later
        spreads = [float(_relative(each).std()) if len(each) else 0.0 for each in frames.T]
    found = next((at for at, each in enumerate(spreads) if each > SILENT * max(spreads)), 0)
    advice = f"; choose another with {wording.column}" if wording.column else ""
    warn_once(
        f"{name}: channel {found + 1} of {len(spreads)} is read; their standard deviations are"
        f" {', '.join(f'{each:.2g}' for each in spreads)} of full scale{advice}"
    )
    return found


def _relative(samples: npt.NDArray[Any]) -> FloatArray:
    """Return samples relative to full scale; see `read_wav`."""
    relative = samples.astype(np.float64)
    if samples.dtype.kind == "f":
        return relative
    scale = 2.0 ** (8 * samples.dtype.itemsize - 1)
    # WAV files store samples of up to 8 bits as offset binary.
    return (relative - scale * (samples.dtype.kind == "u")) / scale


def _not_wav(name: str, reason: str) -> ParameterError:
    return ParameterError(
        f"{name}: is not a WAV file of integer or floating-point samples ({reason})"
    )


FULL_SCALE = 5 * tables.STANDARD_GRAVITY
"""Acceleration at full scale of a WAV file, m/s^2: the +-5 g of the paper's ADXL320J."""

UNCALIBRATED = "calibration = nothing: must be the acceleration at full scale, m/s^2"
"""Error message for files with relative values."""

SHORTEST = 1.0
"""Minimum duration of a recording, s."""

EXPORTED = (b"LabVIEW Measurement", b"TDSm", b"MATLAB", b"\x89HDF")
"""First bytes of LabVIEW's LVM and TDMS, and of MATLAB's MAT (also as HDF5)."""

AXES = 3
"""Number of columns of a recording in x, y and z."""

MOST_BYTES = 300_000_000
"""Maximum size of a file: half an hour at 10 kHz."""


def read_recording(
    path: str | os.PathLike[str],
    recording_rate: float,
    rate: float,
    column: str | None = None,
    full_scale: float | None = None,
    most_columns: int = 1,
) -> FloatArray:
    """Read a recorded acceleration and resample it.

    A CSV file has a first row with the names of its columns; a unit in a name is converted.
    Commas, semicolons or tabs separate columns, empty lines and lines that begin with # are
    skipped. A column of times must agree with the rate. A WAV file (recognised by its first bytes,
    or by its name) has integer or floating-point samples relative to `full_scale`. An offset is
    kept. Outliers are replaced; see `cleaned`.

    Parameters
    ----------
    path : str or path-like
        File to read.
    recording_rate : float
        Sampling rate of the file, Hz, or 0 for that of a WAV file or of the times of a CSV file.
    rate : float
        Sampling rate of the result, Hz.
    column : str, optional
        Name of the column of a CSV file; default: the first of `COLUMNS` that exists. Number of
        the channel of a WAV file; default: the first that is not silent. The empty text also
        means the default.
    full_scale : float, optional
        Acceleration at full scale of a WAV file, m/s^2; default: `FULL_SCALE`, which
        floating-point samples must not exceed.
    most_columns : int
        Number of columns that may be chosen: 1, or 3 for x, y and z, separated by commas.

    Returns
    -------
    ndarray, shape (n,) or (n, 3)
        Acceleration, m/s^2; n is the length times `rate` / `recording_rate`, rounded up.

    Raises
    ------
    ParameterError
        The message is one line with the file, line, column or parameter, its value, and the
        allowed values. A recording shorter than `SHORTEST` is rejected, as are NaN and infinity,
        more than 1 % of outliers, and a file that contradicts itself or `recording_rate`.
    """
    rate = sampling.checked_rate("rate", rate)
    name = shown(os.fspath(path))
    samples, recording_rate = read_samples(
        path, recording_rate, column, full_scale, assumed=FULL_SCALE
    )
    seconds = len(samples) / recording_rate
    if seconds * rate > sampling.MOST_SAMPLES:
        raise ParameterError(
            f"{name}: {seconds:.3g} s are {seconds * rate:.3g} samples at {rate:g} Hz, "
            f"must be at most {sampling.MOST_SAMPLES}"
        )
    if samples.ndim > 1 and most_columns == 1:
        raise ParameterError(f"{name}: column = {shown(column or '')}: must be one column here")
    return sampling.resampled(samples, recording_rate, rate)


def read_samples(
    path: str | os.PathLike[str],
    recording_rate: float,
    column: str | None = None,
    full_scale: float | None = None,
    wording: tables.Wording | None = None,
    assumed: float | None = None,
) -> tuple[FloatArray, float]:
    """Read a recorded acceleration without resampling; see `read_recording`.

    Parameters
    ----------
    wording : Wording, optional
        Names of the arguments in messages.
    assumed : float, optional
        Full scale of a WAV file without a stated one, m/s^2; without `assumed`, such a file is
        rejected.

    Returns
    -------
    samples : ndarray, shape (n,) or (n, 3)
        Acceleration, m/s^2.
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        See `read_recording` for the conditions.
    """
    wording = wording or tables.Wording()
    recording_rate = _checked(recording_rate, wording)
    names = _listed(column or "")
    if full_scale is not None and not 0.0 < full_scale <= tables.LARGEST_VALUE:
        raise ParameterError(
            f"full_scale = {full_scale}: must be above 0 to {tables.LARGEST_VALUE:g} m/s^2"
        )
    name = shown(os.fspath(path))
    with _opened(name, path) as file:
        if is_wav(file.peek(4)) or Path(path).suffix.lower() == ".wav":
            if full_scale is None and assumed is None:
                raise ParameterError(f"{name}: {UNCALIBRATED}")
            own_rate, channels = read_wav(name, file.read(), names, wording)
            check_rate(name, own_rate, recording_rate, wording)
            found = [_scaled(name, each, full_scale, assumed) for each in channels]
        else:
            columns = [tables.ColumnChoice((each,) if each else tables.COLUMNS) for each in names]
            found, own_rate = tables.read_csv(name, file, columns, recording_rate, wording)
    labels = [f"{name}: {each}" if each else name for each in names]
    samples, own_rate = _signals(name, labels, found, own_rate, wording)
    warn_unlike(dict(zip(labels, samples.T, strict=True)))
    return samples if len(names) > 1 else samples[:, 0], own_rate


def read_columns(
    path: str | os.PathLike[str],
    recording_rate: float,
    columns: Sequence[tables.ColumnChoice],
    wording: tables.Wording,
    assumed_rate: float = 0.0,
) -> tuple[FloatArray, float]:
    """Read columns of a CSV file that were sampled together.

    Parameters
    ----------
    path : str or path-like
    recording_rate : float
        Samples per second, Hz; 0 to use the file's times.
    columns : sequence of ColumnChoice
    wording : Wording
        Names of the arguments in messages.
    assumed_rate : float
        Samples per second of a file without times, Hz; 0 to reject it.

    Returns
    -------
    samples : ndarray, shape (n, len(columns))
        Values in SI units.
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        See `read_recording` for the conditions.
    """
    name, recording_rate = shown(os.fspath(path)), _checked(recording_rate, wording)
    with _opened(name, path) as file:
        if is_wav(file.peek(4)):
            names = ", ".join(column.names[0] for column in columns)
            raise ParameterError(f"{name}: is a WAV file, must be a CSV file with columns {names}")
        found, own_rate = tables.read_csv(name, file, columns, recording_rate, wording)
    labels = [f"{name}: {column.names[0]}" for column in columns]
    return _signals(name, labels, found, own_rate or assumed_rate, wording)


def _listed(column: str) -> list[str]:
    """Return the three names in a text, or else the text as one name, which may have commas."""
    names = [each.strip() for each in column.split(",")]
    return names if len(names) == AXES and all(names) else [column]


def check_rate(name: str, own: float, stated: float, wording: tables.Wording) -> None:
    """Reject a stated rate that contradicts a file's rate; 0 means not stated."""
    if stated and not math.isclose(stated, own, rel_tol=sampling.RATE_TOLERANCE):
        raise ParameterError(
            f"{wording.rate} = {stated:g}: must be 0 or {own:g} Hz as {name} says"
        )


def _checked(recording_rate: float, wording: tables.Wording) -> float:
    return recording_rate and sampling.checked_rate(wording.rate, recording_rate)


def _signals(
    name: str,
    labels: Sequence[str],
    found: Sequence[FloatArray],
    rate: float,
    wording: tables.Wording,
) -> tuple[FloatArray, float]:
    """Return signals without outliers, shape (n, signals), and their rate; reject short ones."""
    samples = len(found[0])
    if not rate:
        raise ParameterError(
            f"{wording.rate} = 0: must be given for a CSV file without times such as {name}, "
            f"from {sampling.LOWEST_RATE:g} to {sampling.HIGHEST_RATE:g} Hz"
        )
    if samples / rate < SHORTEST:
        raise ParameterError(
            f"{name}: {samples} samples at {rate:g} Hz last {samples / rate:.3g} s, "
            f"must be at least {SHORTEST:g} s"
        )
    clean = [cleaned(label, each, rate) for label, each in zip(labels, found, strict=True)]
    return np.column_stack(clean), rate


def _scaled(
    name: str, relative: FloatArray, full_scale: float | None, assumed: float | None
) -> FloatArray:
    """Return the acceleration of samples relative to full scale, m/s^2."""
    scale = full_scale or assumed or 1.0
    acceleration = relative * scale
    wrong = np.flatnonzero(~(np.abs(acceleration) <= tables.LARGEST_VALUE))
    if len(wrong):
        raise ParameterError(
            f"{name}: sample {wrong[0]} = {acceleration[wrong[0]]:g}: "
            f"must be from {-tables.LARGEST_VALUE:g} to {tables.LARGEST_VALUE:g} m/s^2"
        )
    peak = float(np.abs(relative).max(initial=0.0))
    if peak > 1.0:
        beyond = f"{name}: samples reach {peak:g}, beyond the full scale of 1"
        if full_scale is None:
            raise ParameterError(
                f"{beyond}, which is {scale:.2f} m/s^2: must be from -1 to 1; save values in m/s^2"
                " as CSV"
            )
        warn_once(f"{beyond}: read as up to {peak * scale:g} m/s^2")
    return acceleration


# Sensors

LEAST_SAMPLES = 10
"""Minimum number of samples at an extreme of a saturated signal."""

PILED = 4
"""Minimum ratio of the number of samples at an extreme to the number at each of the `NEIGHBOURS`
nearest values; a sinusoid in steps of a converter has 2.4."""

NEIGHBOURS = 5

DIGITS = 9
"""Decimal places, relative to full range, to which equal values agree: far finer than any
converter."""

LEAST_RUNS = 50
"""Minimum number of held values that show that a sensor is slower than its file."""

HELD = 1.5
"""Minimum mean number of samples per held value for a slower sensor."""

UNLIKE = 100.0
"""Ratio of the standard deviations of two axes above which a message is logged: 40 dB."""


def cleaned(name: str, samples: FloatArray, rate: float) -> FloatArray:
    """Replace the outliers of a signal, and log them and the sensor's limits.

    The values of a slower sensor have equal durations, within one sample. The values of a quiet
    sensor, which change in steps of its converter, do not.

    Raises
    ------
    ParameterError
        There are too many outliers; see `without_outliers`.
    """
    samples, rejected = without_outliers(name, samples)
    if rejected:
        warn_once(
            f"{name}: {rejected} of {len(samples)} samples are outliers: replaced by interpolation"
        )
    for extreme, count in _piled(samples):
        warn_once(f"{name}: {count} samples are at the extreme {extreme:.4g}: saturated")
    lengths = np.diff(np.flatnonzero(np.diff(samples)))
    if len(lengths) >= LEAST_RUNS and np.ptp(usual := np.percentile(lengths, (5, 95))) <= 1:
        mean = float(lengths[lengths <= usual[1]].mean())
        if mean >= HELD:
            warn_once(
                f"{name}: each value is held for {mean:.3g} samples: its sensor measures at about"
                f" {rate / mean:.3g} Hz, not {rate:g} Hz"
            )
    return samples


def warn_unlike(axes: Mapping[str, FloatArray]) -> None:
    """Log axes of an acceleration, by name, that are much weaker than the other axes."""
    spreads = {name: float(each.std()) for name, each in axes.items()}
    for name, spread in spreads.items():
        if UNLIKE * spread <= (largest := max(spreads.values())) > 0:
            warn_once(
                f"{name}: has a standard deviation of {spread:.2g} m/s^2, another axis"
                f" {largest:.2g}: its sensor may not work"
            )


def _piled(samples: FloatArray) -> Iterator[tuple[float, int]]:
    """Yield the extremes that are much more frequent than the neighbouring values."""
    scale = float(np.ptp(samples)) or 1.0
    values, counts = np.unique(np.round(samples / scale, DIGITS), return_counts=True)
    for at, nearby in ((0, counts[1 : NEIGHBOURS + 1]), (-1, counts[-NEIGHBOURS - 1 : -1])):
        most = max([LEAST_SAMPLES, *PILED * nearby])
        if len(nearby) and values[at] and counts[at] >= most:
            yield float(values[at]) * scale, int(counts[at])


# Files


@contextmanager
def _opened(name: str, path: str | os.PathLike[str]) -> Iterator[io.BufferedReader]:
    """Open a file that is not empty."""
    try:
        with opened(path, MOST_BYTES) as file:
            start = file.peek(1)
            if not start:
                raise OSError(errno.EINVAL, "is empty")
            if start.startswith(EXPORTED):
                kind = "is an LVM, TDMS, MAT or HDF5 file: export its table as text there, such as"
                raise OSError(errno.EINVAL, f"{kind} writematrix(data, 'a.csv') in MATLAB")
            yield file
    except OSError as error:
        what = name or "recording = ''"
        reason = error.strerror or type(error).__name__
        raise ParameterError(f"{what}: {reason}, must be a CSV or WAV file") from None
