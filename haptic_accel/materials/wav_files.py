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

"""Reader of WAV files that checks the sizes and facts of a file before it decodes the samples."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from haptic_accel.core import sampling
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.warning import warn_once
from haptic_accel.materials.columns import MOST_CHANNELS, Wording, missing

MOST_CHUNKS = 1000
"""Maximum number of chunks in a file; programs write fewer than ten."""

FORMAT, DATA = b"fmt ", b"data"
"""Names of the chunks that each file has once."""

ORDERS: Mapping[bytes, Literal["little", "big"]] = {b"RIFF": "little", b"RIFX": "big"}
"""Order of bytes by the first four of a file."""

STREAMED = 0x7FFFF000
"""Size, bytes, from which on a stated size is unknown, as 0 is: streams are written so, and no
file that is read is so large."""

SILENT = 1e-3
"""Standard deviation relative to that of the loudest channel below which a channel is silent."""


def is_wav(start: bytes) -> bool:
    """Return whether the first bytes of a file are those of a WAV file."""
    return start[:4] in ORDERS


def read_wav(
    name: str, content: bytes, requested: Sequence[str], wording: Wording
) -> tuple[float, list[FloatArray]]:
    """Return sampling rate and channels of a WAV file, relative to full scale.

    All encodings have one scale, from -1 to 1. Floating-point samples may exceed it. Sizes that
    are unknown, as in streams, reach to the end of the file. The byte after a chunk of odd length
    may be missing.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    content : bytes
        The whole file.
    requested : sequence of str
        Numbers of the channels, from 1; an empty text for the first that is not silent. The user
        is told of the others.
    wording : Wording

    Returns
    -------
    rate : float
        Samples per second.
    channels : list of ndarray, shape (n,)

    Raises
    ------
    ParameterError
        The file is cut off, has too many chunks, channels or samples, lacks a channel, or is no
        WAV file of integer or floating-point samples.
    """
    order = ORDERS.get(content[:4])
    if not order or content[8:12] != b"WAVE":
        raise _not_wav(name, "it does not begin with RIFF and WAVE")
    rate, frames = _decoded(name, content[:4], order, _chunks(name, content, order))
    numbers = [str(number + 1) for number in range(frames.shape[1])]
    for channel in requested:
        if channel and channel not in numbers:
            raise missing(name, "channel", (channel,), numbers, wording)
    chosen = [numbers.index(each) if each else _heard(name, frames, wording) for each in requested]
    own_rate = sampling.checked_rate(f"{name}: sampling rate", rate)
    return own_rate, [_relative(frames[:, number]) for number in chosen]


def _chunks(name: str, content: bytes, order: Literal["little", "big"]) -> dict[bytes, memoryview]:
    """Return format and samples, whose sizes must not contradict that of the file."""
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
    """Return whether a chunk may begin with these bytes."""
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
    if len(chunks[DATA]) > sampling.MOST_SAMPLES * max(frame, 1) or count > MOST_CHANNELS:
        raise ParameterError(
            f"{name}: {len(chunks[DATA])} bytes of {count} channels: must be at most"
            f" {sampling.MOST_SAMPLES} samples of {MOST_CHANNELS}"
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


def _heard(name: str, frames: npt.NDArray[Any], wording: Wording) -> int:
    """Return the first channel that is not silent, and tell the user if there are others."""
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
    half = 2.0 ** (8 * samples.dtype.itemsize - 1)
    # WAV files store 8 bits and fewer as offset binary.
    return (relative - half * (samples.dtype.kind == "u")) / half


def _not_wav(name: str, reason: str) -> ParameterError:
    return ParameterError(
        f"{name}: is not a WAV file of integer or floating-point samples ({reason})"
    )
