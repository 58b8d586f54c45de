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

"""Reader of WAV files that checks the sizes and facts of a file before it reads the samples."""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from haptic_accel.core import resampling
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, one_line, shown
from haptic_accel.core.warning import warn_once
from haptic_accel.materials.columns import Wording, missing
from haptic_accel.materials.csv_files import too_long

# scipy.io is slow to import: only reading a WAV file needs it.

MOST_CHUNKS = 1000
"""Maximum number of chunks in a file; programs write fewer than ten."""

FORMAT, DATA = b"fmt ", b"data"
"""Names of the chunks that each file has once."""


def read_wav(
    name: str, file: io.BufferedReader, requested: Sequence[str], wording: Wording
) -> tuple[float, list[FloatArray]]:
    """Return sampling rate and channels of a WAV file, relative to full scale.

    All encodings have one scale, from -1 to 1. Floating-point samples may exceed it.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    file : BufferedReader
        The open file, at its start.
    requested : sequence of str
        Numbers of the channels, from 1.
    wording : Wording

    Returns
    -------
    rate : float
        Samples per second.
    channels : list of ndarray, shape (n,)

    Raises
    ------
    ParameterError
        The file is cut off, has too many chunks or samples, lacks a channel, or is no WAV file
        of integer or floating-point samples.
    """
    from scipy.io import wavfile

    _check_chunks(name, file)
    file.seek(0)
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
    if len(samples) > resampling.MOST_SAMPLES:
        raise too_long(name, len(samples))
    channels = samples if samples.ndim == 2 else samples[:, np.newaxis]
    numbers = [str(number + 1) for number in range(channels.shape[1])]
    for channel in requested:
        if channel not in numbers:
            raise missing(name, "channel", (channel,), numbers, wording)
    return own_rate, [_relative(channels[:, numbers.index(each)]) for each in requested]


def _check_chunks(name: str, file: io.BufferedReader) -> None:
    """Reject a file whose chunks are too many, contradict its size, or hold two recordings."""
    size = os.fstat(file.fileno()).st_size
    start = file.read(12)
    if start[:4] not in (b"RIFF", b"RIFX") or start[8:] != b"WAVE":
        return  # scipy reads it, or says what is wrong
    order: Any = "little" if start[:4] == b"RIFF" else "big"
    end = int.from_bytes(start[4:8], order) + 8
    if end > size + 1:  # the last pad byte may be missing
        raise ParameterError(f"{name}: is cut off after {size} bytes, its header says {end}")
    found: list[bytes] = []
    while (offset := file.tell()) < end and len(head := file.read(8)) == 8:
        if len(found) == MOST_CHUNKS:
            raise ParameterError(f"{name}: has more than {MOST_CHUNKS} chunks")
        length = int.from_bytes(head[4:], order)
        found.append(head[:4])
        if head[:4] == DATA and offset + 8 + length > end:
            raise ParameterError(
                f"{name}: its samples have {length} bytes, but it ends after"
                f" {max(end - offset - 8, 0)} of them"
            )
        file.seek(offset + 8 + length + length % 2)
    for chunk in (FORMAT, DATA):
        if found.count(chunk) > 1:
            raise ParameterError(
                f"{name}: has {found.count(chunk)} chunks {chunk.decode()!r}: must have one"
            )
    if size > end + 1:
        warn_once(f"{name}: {size - end} bytes after the end that its header says are not read")


def _relative(samples: npt.NDArray[Any]) -> FloatArray:
    """Return samples relative to full scale; see `read_wav`."""
    relative = samples.astype(np.float64)
    if samples.dtype.kind != "f":
        half = 2.0 ** (8 * samples.dtype.itemsize - 1)
        # WAV files store 8 bits and fewer as offset binary.
        relative -= half if samples.dtype.kind == "u" else 0.0
        relative /= half
    return relative
