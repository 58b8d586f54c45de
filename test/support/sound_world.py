# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""World behind a sound card without hardware: handle, coil, tool and sensors as a client of JACK.

The handle of a rig moves by the force on the card's first output; its acceleration is on the first
input, that of a tool with a known texture on the second. A signal SIGUSR1 taps both. What happens
is in `sound_world.c`; here are its numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
from scipy import signal

from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import handle_model
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup

RATE = 48_000
"""Samples per second of the card, Hz."""

FULL_SCALE, SCALE = 5.0, 100.0
"""Force of the coil, N, and acceleration of both sensors, m/s^2, at full scale."""

TAP, TAP_TIME = 40.0, 0.005
"""Acceleration of a tap, m/s^2, and its length, s."""

TEXTURE, TEXTURE_TIME = 2.0, 4.0
"""Acceleration of the tool, m/s^2, root mean square, and its period, s."""

CORNER, NOISE = 10.0, 0.05
"""Corner of the inputs' AC coupling, Hz, and their noise, m/s^2."""


def texture() -> np.ndarray:
    """Return a period of the tool's acceleration, m/s^2."""
    lines = np.fft.rfftfreq(round(TEXTURE_TIME * RATE), 1 / RATE)
    phases = np.random.default_rng(7).uniform(0, 2 * np.pi, len(lines))
    spectrum = np.where((lines > 25) & (lines < 350), np.exp(1j * phases), 0)
    found = np.fft.irfft(spectrum)
    return np.asarray(TEXTURE * found / found.std())


def numbers(polarity: float) -> str:
    """Return the input of the client.

    Parameters
    ----------
    polarity : float
        1, or -1 for a handle's sensor with swapped wires.
    """
    handle = Setup.of(GraphArguments(rig="ideal")).rig().master.handle
    model = handle_model(Plant(handle).handle)
    moved = signal.tf2sos(*signal.bilinear(model.numerator, model.denominator, RATE))
    coupled = signal.butter(1, CORNER, "high", fs=RATE, output="sos")
    noises = NOISE * np.random.default_rng(1).normal(size=(2, 10 * RATE))
    first = [FULL_SCALE, SCALE, polarity, TAP, round(TAP_TIME * RATE)]
    counted = (_counted(each) for each in (moved, coupled, coupled, texture(), *noises))
    return "\n".join(f"{value:.17g}" for value in chain(first, *counted))


def _counted(values: np.ndarray) -> Iterator[float]:
    """Yield the number of rows, and all values."""
    yield len(values)
    yield from values.ravel().tolist()
