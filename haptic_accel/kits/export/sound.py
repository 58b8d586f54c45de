# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vibration of tool and handle as sound: WAV, and audio for Foxglove's panel."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import wavfile

from haptic_accel import Bag, FloatArray, ParameterError, resampled
from haptic_accel.core import REDUCTIONS
from haptic_accel.core.sampling import NANOSECONDS, SPARSE
from haptic_accel.kits.export import signals
from haptic_accel.kits.export.signals import CLOCKS, recorded_rate

RAW_AUDIO = "foxglove_msgs/msg/RawAudio"
FIELDS = (
    "builtin_interfaces/Time timestamp\nuint8[] data\nstring format\nuint32 sample_rate\n"
    "uint32 number_of_channels\n"
)
"""Type of a block of sound, and its fields, after https://docs.foxglove.dev (RawAudio)."""

PCM = "pcm-s16"
"""The only format of `RAW_AUDIO`: 16 bits, little-endian."""

SOUND_RATE = 8000
"""Sampling rate of sound that every player supports, Hz."""

BLOCK = 800
"""Number of samples of a message: a tenth of a second."""

MINUTE = 60
"""Length of the parts that are resampled separately, s."""

FULL = 32767
"""Largest sample of 16 bits."""


def write_wav(bag: Bag, folder: Path) -> None:
    """Write ``vibration.wav``, with tool and handle aligned as its channels, and ``signals.json``.

    Samples are 64-bit numbers, relative to a full scale that is a power of two, so that their
    product is the bag's value to the last digit.

    Raises
    ------
    ParameterError
        Tool and handle have no common rate, or not a whole one.
    """
    channels, about = _sound(bag)
    if about["rate_hz"] != (rate := round(about["rate_hz"])):
        raise ParameterError(f"{bag.path}: {about['rate_hz']} Hz: must be a whole number for WAV")
    samples = np.column_stack(list(channels.values()))
    samples /= about["full_scale_m_s2"]
    wavfile.write(folder / "vibration.wav", rate, samples)
    signals.write_json(folder / "signals.json", signals.descriptions(bag) | {"sound": about})


def write_audio(bag: Bag, folder: Path) -> None:
    """Write a bag with the topics ``/audio/tool`` and ``/audio/handle``, and ``signals.json``.

    Vibration of several axes is reduced to one with the same spectrum.

    Raises
    ------
    ParameterError
        Tool and handle have no common rate.
    """
    channels, about = _sound(bag)
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(FIELDS, RAW_AUDIO))
    kind, moment = store.types[RAW_AUDIO], store.types["builtin_interfaces/msg/Time"]
    with Writer(folder / "audio", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.set_custom_data("haptic_accel.sound", json.dumps(about))
        for part in ("tool", "handle"):
            topic = writer.add_connection(f"/audio/{part}", RAW_AUDIO, typestore=store)
            samples = _played(channels, about, part)
            for begin in range(0, len(samples), BLOCK):
                block = samples[begin : begin + BLOCK].view(np.uint8)
                stamp = about["start_ns"] + begin * NANOSECONDS // SOUND_RATE
                message = kind(moment(*divmod(stamp, NANOSECONDS)), block, PCM, SOUND_RATE, 1)
                writer.write(topic, stamp, store.serialize_cdr(message, RAW_AUDIO))
    signals.write_json(folder / "signals.json", signals.descriptions(bag) | {"sound": about})


def _sound(bag: Bag) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """Return tool and handle on one grid, m/s^2, by channel, and their description for JSON."""
    rate = recorded_rate(bag)
    stamps = [signals.signal_of(bag, each).stamps for each in (signals.TOOL, signals.HANDLE)]
    start = int(min(each[0] for each in stamps))
    length = round((int(max(each[-1] for each in stamps)) - start) * rate / NANOSECONDS) + 1
    if length > SPARSE * min(map(len, stamps)):
        raise ParameterError(f"{bag.path}: tool and handle have few of {length} samples: {CLOCKS}")
    channels, missing = {}, {}
    for part, exported in (("tool", signals.TOOL), ("handle", signals.HANDLE)):
        held, seen = signals.on_grid(bag, exported, start, rate, length)
        missing[part] = int((~seen).sum())
        for axis, component in zip(bag.axes.names, held.T, strict=True):
            channels[f"{part}.{axis}"] = component
    peak = max(float(np.abs(each).max()) for each in channels.values())
    return channels, {
        "start_ns": start,
        "rate_hz": rate,
        "full_scale_m_s2": 2.0 ** math.ceil(math.log2(peak)) if peak else 1.0,
        "channels": list(channels),
        "missing_samples_that_repeat_the_one_before": missing,
    }


def _played(channels: dict[str, FloatArray], about: dict[str, Any], part: str) -> Any:
    """Return the sound of tool or handle, 16 bits at `SOUND_RATE`."""
    own = [each for name, each in channels.items() if name.startswith(f"{part}.")]
    one = own[0] if len(own) == 1 else REDUCTIONS["dft321"](np.column_stack(own))
    scaled = one * (FULL / about["full_scale_m_s2"])
    return np.concatenate(list(_resampled_parts(scaled, about["rate_hz"])))


def _resampled_parts(signal: FloatArray, rate: float) -> Iterator[npt.NDArray[np.int16]]:
    """Yield 16-bit sound at `SOUND_RATE`, minute by minute: an hour at once would need 600 MB.

    Each minute is resampled with a second before and after it. A signal whose rate is not whole
    has no samples in common with its sound, and is resampled at once.
    """
    second = round(rate)
    length = MINUTE * second if rate == second else len(signal)
    for begin in range(0, len(signal), length):
        before = min(begin, second)
        played = resampled(signal[begin - before : begin + length + second], rate, SOUND_RATE)
        first = before * SOUND_RATE // second
        end = min(begin + length, len(signal)) - begin
        own = played[first : first + math.ceil(end * SOUND_RATE / rate)]
        yield np.clip(np.rint(own), -FULL, FULL).astype("<i2")
