# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded motion of an arm on a sampling grid, and a rig that replays it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from haptic_accel.core import sampling
from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig import Rig
from haptic_accel.core.tick.rigs import ReplayArm

SHORTEST = 0.2
"""Minimum duration of a track, s: four times the fade of a loop."""

FADE = 0.05
"""Duration of the return of the acceleration to rest after the end, s."""

QUIET = 0.3
"""Duration of the final rest, s: ten time constants of the paper's high-pass."""

AXES = 3


@dataclass(frozen=True)
class Track:
    """Samples of one arm and its accelerometer, one for each point of a sampling grid.

    Attributes
    ----------
    rate : float
        Samples per second.
    acceleration : ndarray, shape (n,)
        Acceleration along the actuator's axis, m/s^2.
    position, velocity : ndarray, shape (n, 3)
        Position, m, and velocity, m/s.
    lost : ndarray of bool, shape (n,)
        Mask of missing samples, which repeat the previous value.
    """

    rate: float
    acceleration: FloatArray
    position: FloatArray
    velocity: FloatArray
    lost: sampling.BoolArray

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.acceleration)

    def part(self, samples: slice) -> Track:
        """Return a part of the track."""
        a, p, v = self.acceleration[samples], self.position[samples], self.velocity[samples]
        return Track(self.rate, a, p, v, self.lost[samples])

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return len(self) / self.rate

    @property
    def rest(self) -> float:
        """Acceleration of the arm at rest, m/s^2: the median, mostly gravity and offset."""
        return float(np.median(self.acceleration))


def gridded(
    acceleration: sampling.Stamped,
    position: sampling.Stamped | None,
    velocity: sampling.Stamped | None,
    rate: float,
    start: int | None = None,
) -> Track:
    """Arrange an arm's samples on the grid of their stamps.

    Each step between stamps is rounded to whole periods separately. A system clock that is slewed
    during a recording thus costs no samples. Missing and non-finite samples repeat the previous
    value.

    Parameters
    ----------
    acceleration : Stamped
        Acceleration along the actuator's axis, m/s^2.
    position, velocity : Stamped, optional
        Position, m, and velocity, m/s; without them the arm is at rest at its origin.
    rate : float
        Sampling rate of the grid, Hz.
    start : int, optional
        Stamp, ns; earlier samples are omitted.

    Raises
    ------
    ParameterError
        No sample remains, or the stamps are too far apart.
    """
    period = sampling.NANOSECONDS / rate
    stamps = np.unique(_whole(acceleration)[0])
    if start is not None:
        stamps = stamps[stamps >= start - sampling.half_period(rate)]
    if not len(stamps):
        raise ParameterError("no acceleration is left")
    steps = np.rint(np.diff(stamps) / period)
    positions = np.concatenate([[0], np.cumsum(steps)]).astype(np.int64)
    length = int(positions[-1]) + 1
    if length > sampling.MOST_SAMPLES:
        most = f"must be at most {sampling.MOST_SAMPLES}"
        raise ParameterError(f"its stamps span {length} samples at {rate:g} Hz, {most}")

    def held(signal: sampling.Stamped | None) -> tuple[FloatArray, sampling.BoolArray]:
        """Return a signal's value at each grid point, and a mask of repeated values."""
        if signal is not None:
            times, values = _whole(signal)
            near = np.maximum(np.searchsorted(stamps, times, side="right") - 1, 0)
            steps = np.rint((times - stamps[near]) / period).astype(np.int64)
            where = positions[near] + steps
            if ((where >= 0) & (where < length)).any():
                found, seen = sampling.on_grid(where, values, length)
                return found, ~seen
        return np.zeros((length, AXES)), np.ones(length, dtype=np.bool_)

    values, lost = held(acceleration)
    along = np.ascontiguousarray(values[:, ACTUATOR_AXIS])
    return Track(rate, along, held(position)[0], held(velocity)[0], lost)


def at_rest(acceleration: FloatArray, rate: float) -> Track:
    """Return the track of an arm at rest with an acceleration in m/s^2."""
    still = np.zeros((len(acceleration), AXES))
    return Track(rate, acceleration, still, still, np.zeros(len(acceleration), dtype=np.bool_))


def cut(track: Track, start: float) -> Track:
    """Omit the first seconds of a track.

    Raises
    ------
    ParameterError
        Less than `SHORTEST` remains.
    """
    if track.seconds - start < SHORTEST:
        most = max(0.0, track.seconds - SHORTEST)
        raise ParameterError(
            f"start = {start:g}: must leave {SHORTEST:g} s of {track.seconds:.3g} s,"
            f" be at most {most:.3g} s"
        )
    return track.part(slice(round(start * track.rate), None))


def played_at(track: Track, rate: float, speed: float = 1.0) -> Track:
    """Return a track for playback at another sampling rate or speed.

    At another speed all signals are scaled in time with unchanged values, as by ``ros2 bag play
    --rate``. At twice the speed a tone of 100 Hz has 200 Hz.

    Parameters
    ----------
    track : Track
    rate : float
        Sampling rate of the result, Hz.
    speed : float
        Seconds of the track per second.

    Raises
    ------
    ParameterError
        A rate is out of range.
    """
    if rate == track.rate and speed == 1.0:
        return track
    source = track.rate * speed

    def changed(values: FloatArray) -> FloatArray:
        return sampling.resampled(values, source, rate)

    acceleration = changed(track.acceleration)
    nearest = np.rint(np.arange(len(acceleration)) * (source / rate)).astype(np.int64)
    position, velocity = (
        np.column_stack([changed(column) for column in vectors.T])
        for vectors in (track.position, track.velocity)
    )
    lost = track.lost[np.minimum(nearest, len(track) - 1)]
    return Track(rate, acceleration, position, velocity, lost)


def looped(track: Track) -> Track:
    """Return one period of a track that can be repeated.

    The acceleration's end is crossfaded into its start with constant power. The arm moves from its
    end to its start on a smooth path, with matching velocity.
    """
    acceleration = sampling.crossfaded(track.acceleration, track.rate, FADE)
    fade = len(track) - len(acceleration)
    phase = np.arange(1, fade + 1)[:, None] / fade * np.pi
    weight = (1 - np.cos(phase)) / 2
    weight_rate = np.sin(phase) / 2 * np.pi / fade * track.rate
    position, velocity = track.position[fade:].copy(), track.velocity[fade:].copy()
    first, last = slice(fade), slice(-fade, None)
    away = track.position[first] - track.position[last]
    position[last] += weight * away
    velocity[last] += weight * (track.velocity[first] - track.velocity[last]) + weight_rate * away
    return Track(track.rate, acceleration, position, velocity, track.lost[fade:])


def quieted(track: Track) -> Track:
    """Append an end in which the arm rests and the acceleration returns to rest.

    A controller's filters have then decayed before its input stops.
    """
    fade, quiet = round(FADE * track.rate), round(QUIET * track.rate)
    left = np.concatenate([(1 + np.cos(np.arange(1, fade + 1) / fade * np.pi)) / 2, [0.0] * quiet])
    rest = track.rest
    return replace(
        track,
        acceleration=np.append(track.acceleration, rest + left * (track.acceleration[-1] - rest)),
        position=np.concatenate([track.position, np.tile(track.position[-1], (len(left), 1))]),
        velocity=np.concatenate([track.velocity, left[:, None] * track.velocity[-1]]),
        lost=np.append(track.lost, np.zeros(len(left), dtype=np.bool_)),
    )


class ReplayRig(Rig):
    """Arm that replays recorded samples; see `ReplayArm`.

    Parameters
    ----------
    track : Track
        Track at the sampling rate of the rig.
    loop : bool
        True to restart at the end; otherwise the last sample repeats.
    """

    def __init__(self, track: Track, *, loop: bool = False) -> None:
        table = np.column_stack([track.position, track.velocity, track.acceleration, track.lost])
        self._arm = ReplayArm(table, track.rate, loop, track.rest)
        super().__init__(self._arm)

    @property
    def ended(self) -> bool:
        """True after the last sample."""
        arm = self._arm
        return not arm.loop and arm.position >= arm.count - 1

    def counters(self) -> dict[str, int]:
        """Return counts of lost or skipped samples, and of ignored forces."""
        arm = self._arm
        return {
            "samples_lost_in_recording": arm.lost,
            "samples_skipped": arm.skipped,
            "arm_forces_ignored": arm.arm_forces,
            "actuator_forces_ignored": arm.actuator_forces,
        }


def _whole(signal: sampling.Stamped) -> sampling.Stamped:
    """Return the finite vectors in order of their stamps."""
    stamps, values = signal
    finite = np.isfinite(values).all(axis=1)
    stamps, values = stamps[finite], values[finite]
    order = np.argsort(stamps, kind="stable")
    return stamps[order], values[order]
