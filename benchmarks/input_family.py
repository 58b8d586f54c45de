# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Families of tool accelerations that span the recordings of tools on surfaces.

A member is a spectrum in an envelope: each of `SPECTRA` occurs with each of `ENVELOPES`. The
ranges are from published recordings and from machines:

- textures have their power between 20 and 400 Hz, with peaks that depend on speed (Romano and
  Kuchenbecker, IEEE Trans. Haptics 5(2), 2012; Culbertson, Lopez Delgado and Kuchenbecker, Haptics
  Symposium 2014: autoregressive models of the orders 12 to 20 for 100 materials);
- rotating tools have lines at 20 to 200 Hz (1,200 to 12,000 revolutions per minute) and their
  harmonics (ISO 28927);
- taps ring at 60 to 450 Hz for 3 to 20 ms (Okamura, Cutkosky and Dennerlein, IEEE/ASME Trans.
  Mechatronics 6(3), 2001); isolated ones have crest factors of 16;
- strokes of the hand last 0.3 to 1.2 s, and pressing four times as hard with twice the speed
  changes the level by about 20 dB.

A second family, `hard`, has what controllers find hard (ranges assumed): a sine, as of a shaker,
and a beam between two near lines; recordings that are cut from a longer one; a tool that is turned
in gravity; hard tools that hit hard surfaces with up to the 60 m/s^2 of common accelerometers; a
logger that is knocked or moved by hand; and a tool that lands again and again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from scipy import signal

from haptic_accel import FloatArray

MEMBERS = 200
"""Number of members."""

RMS = 0.3, 6.0
"""Range of the root mean square of a member, m/s^2; log-uniform."""

HARD_RMS = 0.3, 4.0
"""Range of the root mean square of hard members, without steps, slams and motion of the hand,
m/s^2; log-uniform."""

STEP = 0.5, 10.0
"""Range of steps, m/s^2, up to gravity; log-uniform."""

SLAM = 15.0, 60.0
"""Range of the peaks of slams, m/s^2; log-uniform."""

KNOCK = 3.0, 20.0
"""Range of the peaks of knocks by hand, m/s^2; log-uniform."""

MOVED = 0.5, 8.0
"""Range of the amplitude of a tool that is moved by hand, m/s^2; log-uniform."""

VECTOR_RMS = {"loud": (4.0, 12.0), "weak": (0.1, 0.5), "slow": (0.5, 6.0), "tapped": (1.0, 6.0)}
"""Ranges of the root mean square of vectors by kind, m/s^2; log-uniform."""

CREST = 16.0
"""Maximum ratio of peak to root mean square."""

HIGHEST = 0.45
"""Maximum frequency of a member, as a fraction of the rate."""

FADING_IN = 0.2
"""Time of fading in at the start, s."""

SWAYING = 0.3, 0.7, 1.6, 2.7
"""Frequencies of the hand's slow motion, Hz."""

Random: TypeAlias = np.random.Generator


class Member(NamedTuple):
    """Member of the family.

    Attributes
    ----------
    name : str
        Spectrum, envelope, number and root mean square.
    acceleration : ndarray, shape (n,)
        Tool acceleration, m/s^2; shape (n, 3) of `vector`.
    reported : bool
        True for the half on which controllers are only measured; the other half serves to
        develop them.
    """

    name: str
    acceleration: FloatArray
    reported: bool


def member(number: int, seconds: float, rate: float, seed: int = 0) -> Member:
    """Return one member of the family.

    Parameters
    ----------
    number : int
        From 0 to `MEMBERS` - 1. Consecutive members have different spectra.
    seconds, rate : float
        Duration, s, and samples per second.
    seed : int
        Seed of the ranges and of the noise.

    Examples
    --------
    >>> found = member(3, 4.0, 1000.0)
    >>> found.name, found.reported
    ('lines, taps, 3: 2.5 m/s^2', True)
    """
    random = np.random.default_rng((seed, number))
    spectra, envelopes = list(SPECTRA), list(ENVELOPES)
    spectrum = spectra[number % len(spectra)]
    envelope = envelopes[number // len(spectra) % len(envelopes)]
    time = np.arange(round(seconds * rate)) / rate
    found = SPECTRA[spectrum](random, time, rate)
    found = ENVELOPES[envelope](random, time, found / np.std(found))
    rms = log_uniform(random, *RMS)
    found *= np.minimum(time / FADING_IN, 1.0)
    found *= rms / np.sqrt(np.mean(found**2))
    found = np.clip(found, -CREST * rms, CREST * rms)
    return Member(f"{spectrum}, {envelope}, {number}: {rms:.2g} m/s^2", found, bool(number % 2))


def hard(kind: str, number: int, seconds: float, rate: float, seed: int = 0) -> Member:
    """Return a hard tool acceleration; parameters as for `member`.

    Parameters
    ----------
    kind : str
        One of `HARD`.
    number : int
        Number of the member of this kind.
    """
    random = np.random.default_rng((seed, number, list(HARD).index(kind)))
    time = np.arange(round(seconds * rate)) / rate
    spectra = list(SPECTRA.values())
    found = spectra[int(random.integers(len(spectra)))](random, time, rate)
    rms = log_uniform(random, *HARD_RMS)
    found = HARD[kind](random, time, found * (rms / np.std(found)))
    return Member(f"{kind}, {number}: {rms:.2g} m/s^2", found, bool(number % 2))


def vector(number: int, seconds: float, rate: float, seed: int = 0) -> Member:
    """Return an acceleration with three components, shape (n, 3); parameters as for `member`.

    Each of `VECTOR_RMS` in turn: noise, slow noise from 5 Hz on, or taps.
    """
    random = np.random.default_rng((seed, number, len(VECTOR_RMS)))
    kind = list(VECTOR_RMS)[number % len(VECTOR_RMS)]
    time = np.arange(round(seconds * rate)) / rate
    low, high = ((5.0, 20.0), (12.0, 60.0)) if kind == "slow" else ((10.0, 100.0), (60.0, 400.0))
    begins = 0.2 + np.cumsum(random.uniform(0.3, 0.7, math.ceil(seconds / 0.3)))
    found = np.zeros((len(time), 3))
    for column in found.T:
        first, last = random.uniform(low, high)
        column += band_noise(random, len(time), first, last, rate)
        column *= (0.01 if kind == "tapped" else 1.0) / np.std(column)
        for begin in begins if kind == "tapped" else ():
            tap = random.uniform((60.0, 0.3, 3e-3), (300.0, 1.0, 20e-3)).tolist()
            column += ringing(time, begin, *tap)
        column *= random.uniform(0.3, 1.0) / np.std(column)
    found = found @ (np.eye(3) + random.uniform(-0.5, 0.5, (3, 3)))
    found *= np.minimum(time / FADING_IN, 1.0)[:, np.newaxis]
    rms = log_uniform(random, *VECTOR_RMS[kind])
    found *= rms / np.sqrt(np.mean(np.sum(found**2, axis=1)))
    return Member(f"{kind}, {number}: {rms:.2g} m/s^2", found, True)


def log_uniform(random: Random, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of two bounds."""
    return math.exp(random.uniform(math.log(low), math.log(high)))


def band_noise(random: Random, samples: int, low: float, high: float, rate: float) -> FloatArray:
    """Return white noise through a band-pass of order 2, shape (samples,).

    The band, Hz, is moved below `HIGHEST` of the rate where it would end above.
    """
    highest = HIGHEST * rate
    edges = [min(low, 0.8 * highest), min(high, highest)]
    band = signal.butter(2, edges, "band", fs=rate, output="sos")
    return np.asarray(signal.sosfilt(band, random.standard_normal(samples)))


def ringing(
    time: FloatArray, begin: float, frequency: float, amplitude: float, decay: float
) -> FloatArray:
    """Return an oscillation, Hz, that begins at a time and decays with a time constant, s."""
    since = np.maximum(time - begin, 0.0)
    return np.asarray(amplitude * np.sin(2 * np.pi * frequency * since) * np.exp(-since / decay))


def _band(random: Random, time: FloatArray, rate: float) -> FloatArray:
    """Return noise in a band."""
    low = log_uniform(random, 5.0, 60.0)
    return band_noise(
        random, len(time), low, max(2.0 * low, log_uniform(random, 60.0, 480.0)), rate
    )


def _low(random: Random, time: FloatArray, rate: float) -> FloatArray:
    """Return noise whose power falls from a corner at 8 to 40 Hz: a scratch of a rough surface."""
    corner = log_uniform(random, 8.0, 40.0)
    low_pass = signal.butter(1, min(corner * 1.5, 0.4 * rate), fs=rate, output="sos")
    return np.asarray(
        signal.sosfilt(low_pass, band_noise(random, len(time), corner / 2, 480.0, rate))
    )


def _autoregressive(random: Random, time: FloatArray, rate: float) -> FloatArray:
    """Return noise through two to five resonances, as of a texture's autoregressive model."""
    found = np.zeros(len(time))
    for _ in range(int(random.integers(2, 6))):
        peak = log_uniform(random, 20.0, 400.0)
        width = log_uniform(random, 0.1, 0.8)
        edges = peak * (1.0 - width / 2), peak * (1.0 + width / 2)
        part = band_noise(random, len(time), *edges, rate)
        found += part / np.std(part) * log_uniform(random, 0.2, 1.0)
    return found


def _lines(random: Random, time: FloatArray, rate: float) -> FloatArray:
    """Return a line with harmonics whose frequency wanders by a percent, in noise."""
    frequency = log_uniform(random, 20.0, 200.0)
    wander = np.cumsum(random.standard_normal(len(time))) * math.sqrt(1.0 / rate)
    phase = 2 * np.pi * np.cumsum(frequency * (1.0 + 0.01 * np.tanh(wander))) / rate
    found = random.uniform(0.05, 0.5) * band_noise(random, len(time), 20.0, 400.0, rate)
    found /= max(1e-9, float(np.std(found))) / 0.2
    for harmonic in range(1, int(min(6.0, min(450.0, HIGHEST * rate) / frequency)) + 1):
        found += np.sin(harmonic * phase + random.uniform(0.0, 6.28)) / harmonic ** random.uniform(
            0.5, 2.0
        )
    return found


def _chatter(random: Random, time: FloatArray, rate: float) -> FloatArray:
    """Return bursts of a line at 40 to 300 Hz, as of stick and slip, in noise."""
    frequency = min(log_uniform(random, 40.0, 300.0), HIGHEST * rate)
    beat = band_noise(random, len(time), 0.5, 4.0, rate)
    bursts = np.maximum(beat / np.std(beat), 0.0)
    line = (
        np.sign(np.sin(2 * np.pi * frequency * time))
        * np.abs(np.sin(2 * np.pi * frequency * time)) ** 0.5
    )
    ground = band_noise(random, len(time), 20.0, 400.0, rate)
    return np.asarray(bursts * line + 0.2 * ground / np.std(ground))


def _steady(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return the same signal."""
    return found


def _strokes(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return strokes to and fro, with pauses between some of them."""
    level, begin = np.zeros(len(time)), 0.0
    while begin < time[-1]:
        length = random.uniform(0.3, 1.2)
        inside = (time >= begin) & (time < begin + length)
        level[inside] = np.sin(np.pi * (time[inside] - begin) / length) ** 0.5
        begin += length + random.choice([0.02, 0.3])
    return found * level


def _steps(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal whose level changes by 20 dB within 20 ms every half to one and a half s."""
    level, loud, begin = np.ones(len(time)), True, 0.0
    while begin < time[-1]:
        level[time >= begin] = 1.0 if loud else 0.1
        loud, begin = not loud, begin + random.uniform(0.5, 1.5)
    width = max(1, int(0.02 / (time[1] - time[0])))
    return found * np.convolve(level, np.ones(width) / width, mode="same")


def _taps(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal with taps up to 16 times as large."""
    found = 0.3 * found
    begin = 0.3
    while begin < time[-1]:
        frequency = min(log_uniform(random, 60.0, 450.0), HIGHEST / (time[1] - time[0]))
        amplitude, decay = random.uniform(2.0, CREST), random.uniform(3e-3, 20e-3)
        found = found + ringing(time, begin, frequency, amplitude, decay)
        begin += random.uniform(0.3, 0.9)
    return found


def _drift(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal on the slow motion of the hand, below 3 Hz."""
    phases = random.uniform(0.0, 6.28, 4)
    slow = sum(np.sin(2 * np.pi * f * time + p) for f, p in zip(SWAYING, phases, strict=True))
    return np.asarray(found + random.uniform(0.3, 1.0) * slow)


SPECTRA: dict[str, Callable[[Random, FloatArray, float], FloatArray]] = {
    "band": _band,
    "low": _low,
    "autoregressive": _autoregressive,
    "lines": _lines,
    "chatter": _chatter,
}
"""Functions from time, s, and rate, Hz, to a stationary signal, by name."""

ENVELOPES: dict[str, Callable[[Random, FloatArray, FloatArray], FloatArray]] = {
    "taps": _taps,
    "steady": _steady,
    "strokes": _strokes,
    "steps": _steps,
    "drift": _drift,
}
"""Functions from time, s, and a signal of unit level to one with an envelope, by name."""


def _cut(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal that begins within its vibration, at its largest deviation of 0.2 s."""
    begin = int(np.argmax(np.abs(found[: int(0.2 / (time[1] - time[0]))])))
    return np.roll(found, -begin)


def _begun_by_step(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal whose first sample differs from the mean of the others."""
    found = found + _signed_step(random)
    found[0] = 0.0
    return found


def _turned(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal with steps that take 1 to 50 ms, every half to two seconds."""
    begin, fading_in = random.uniform(0.1, 1.0), np.minimum(time / FADING_IN, 1.0)
    found = fading_in * found
    while begin < time[-1]:
        rise = log_uniform(random, 1e-3, 50e-3)
        found = found + _signed_step(random) * np.clip((time - begin) / rise, 0.0, 1.0)
        begin += random.uniform(0.5, 2.0)
    return found


def _slams(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal with hits: half a sine of 2 to 15 ms, and what rings after it."""
    found = np.minimum(time / FADING_IN, 1.0) * found
    begin = random.uniform(0.1, 1.0)
    while begin < time[-1]:
        peak, width = _sign(random) * log_uniform(random, *SLAM), log_uniform(random, 2e-3, 15e-3)
        phase = np.clip((time - begin) / width, 0.0, 1.0)
        ring = ringing(
            *(time, begin + width, log_uniform(random, 40.0, 400.0)),
            *(-0.5 * peak, log_uniform(random, 3e-3, 30e-3)),
        )
        found = found + peak * np.sin(np.pi * phase) + ring
        begin += random.uniform(0.3, 1.5)
    return np.clip(found, -SLAM[1], SLAM[1])


def _sine(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a sine of the same level, as of a shaker."""
    phase = 2 * np.pi * log_uniform(random, 25.0, 320.0) * time
    level = math.sqrt(2.0) * np.std(found)
    return np.asarray(np.minimum(time / FADING_IN, 1.0) * level * np.sin(phase))


def _beam(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return noise of the same level in a band of 4 to 40 % of its middle, as of a beam."""
    middle, width = log_uniform(random, 30.0, 300.0), log_uniform(random, 0.04, 0.4)
    edges = middle * (1.0 - width / 2), middle * (1.0 + width / 2)
    line = band_noise(random, len(time), *edges, 1.0 / float(time[1]))
    return np.minimum(time / FADING_IN, 1.0) * line * (np.std(found) / np.std(line))


def _knocked(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a weak signal of a logger that is knocked by hand, and swings at 4 to 20 Hz."""
    found, begin = 0.2 * np.minimum(time / FADING_IN, 1.0) * found, random.uniform(0.1, 1.0)
    while begin < time[-1]:
        peak, swing = _sign(random) * log_uniform(random, *KNOCK), log_uniform(random, 4.0, 20.0)
        found = found + ringing(time, begin, swing, peak, log_uniform(random, 0.02, 0.2))
        begin += random.uniform(0.5, 2.0)
    return found


def _moved(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a weak signal of a tool that a hand moves to and fro at 1 to 4 Hz."""
    beat = 2 * np.pi * random.uniform(1.0, 4.0) * time + np.sin(2 * np.pi * 0.3 * time)
    slow = log_uniform(random, *MOVED) * np.sin(beat)
    return np.minimum(time / FADING_IN, 1.0) * (0.2 * found + slow)


def _landing(random: Random, time: FloatArray, found: FloatArray) -> FloatArray:
    """Return a signal with pauses of 0.2 to 1 s, each ended by a tap of up to 16 times it."""
    begin, level, rms = random.uniform(0.1, 1.0), np.zeros(len(time)), float(np.std(found))
    taps = np.zeros(len(time))
    while begin < time[-1]:
        length = random.uniform(0.4, 1.5)
        level[(time >= begin) & (time < begin + length)] = 1.0
        tap = log_uniform(random, 60.0, 300.0), rms * random.uniform(2.0, CREST)
        taps += ringing(time, begin, *tap, random.uniform(3e-3, 20e-3))
        begin += length + random.uniform(0.2, 1.0)
    return found * level + taps


def _signed_step(random: Random) -> float:
    return _sign(random) * log_uniform(random, *STEP)


def _sign(random: Random) -> float:
    return float(random.choice([-1.0, 1.0]))


HARD: dict[str, Callable[[Random, FloatArray, FloatArray], FloatArray]] = {
    "sine": _sine,
    "beam": _beam,
    "cut": _cut,
    "begun by a step": _begun_by_step,
    "turned": _turned,
    "slams": _slams,
    "knocks": _knocked,
    "moved by hand": _moved,
    "landings": _landing,
}
"""Functions from time, s, and a stationary signal, m/s^2, to a hard one, by name."""
