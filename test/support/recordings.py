# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded accelerations of the simulated tool, dragged over a surface."""

from __future__ import annotations

import struct
from functools import cache
from pathlib import Path
from typing import BinaryIO

import numpy as np
from scipy.io import wavfile

from haptic_accel.core.trial import run_trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup

RATE = 10_000
"""Sampling rate of the recordings, Hz."""

SECONDS = 1.9
SETTLED = 0.5
"""Time after which the tool drags over the surface, s."""


@cache
def dragged_over(surface: str) -> np.ndarray:
    """Return the acceleration of a tool on a surface, m/s^2."""
    rig = Setup.of(GraphArguments(surface=surface)).rig()
    trial = run_trial("none", rig, duration=SETTLED + SECONDS, rate=RATE)
    return trial.tool_acceleration[round(SETTLED * RATE) :]


def write_recording(path: Path, surface: str) -> Path:
    """Write a CSV file with several columns, as in laboratories; return its path."""
    acceleration = dragged_over(surface)
    columns = {
        "speed": np.full(len(acceleration), 192.6),
        "force": np.full(len(acceleration), 1.73),
        "accel": acceleration,
        "friction": np.full(len(acceleration), 0.32),
    }
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


def write_wav(path: Path | BinaryIO, rate: int, samples: np.ndarray, encoding: str) -> None:
    """Write samples relative to full scale as a WAV file, also with 24 bits."""
    if encoding.startswith("float"):
        wavfile.write(path, rate, samples.astype(encoding))
        return
    bits = int(encoding.lstrip("uint"))
    whole = np.clip(np.round(samples * 2.0 ** (bits - 1)), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    if bits != 24:
        wavfile.write(path, rate, (whole + (128 if bits == 8 else 0)).astype(encoding))
        return
    data = whole.astype("<i4").reshape(len(samples), -1)
    channels, frames = data.shape[1], data.astype("<i4").tobytes()
    content = b"".join(frames[at : at + 3] for at in range(0, len(frames), 4))
    form = struct.pack("<HHIIHH", 1, channels, rate, 3 * channels * rate, 3 * channels, 24)
    body = b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + struct.pack("<I", len(content))
    whole_file = b"RIFF" + struct.pack("<I", len(body) + len(content)) + body + content
    if isinstance(path, Path):
        path.write_bytes(whole_file)
    else:
        path.write(whole_file)
