# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices that play a recording instead of an arm: a bag, or a CSV or WAV file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from haptic_accel.bags.folder import is_storage
from haptic_accel.core import track
from haptic_accel.core.files import located
from haptic_accel.core.parameters import Checked, ParameterError, like, parameter
from haptic_accel.core.sampling import NANOSECONDS, Stamped, sampling_rate
from haptic_accel.core.topics import MASTER, SLAVE, ArmTopics, Topic
from haptic_accel.devices.simulated import RecordingParameters, SimulatedDevice
from haptic_accel.materials.recordings import read_recording

if TYPE_CHECKING:
    from haptic_accel.bags.reading import Bag

# The bag reader takes a quarter of a second to import: only a replay imports it.


class NothingRecordedError(ParameterError):
    """Error: a bag has no message to be played."""


@dataclass(frozen=True)
class ReplayParameters(Checked):
    """Recording to play, and playback options."""

    file: str = parameter("", "folder or file of a bag, or CSV or WAV file of an acceleration")
    rate: float = like(RecordingParameters, "rate")
    column: str = like(RecordingParameters, "column")
    speed: float = parameter(
        1.0,
        "seconds of the recording per second, as `ros2 bag play --rate`: signals are stretched in"
        " time, their values stay",
        low=0.1,
        high=10.0,
    )
    loop: bool = parameter(False, "repeated playback, with a crossfade from the end to the start")
    start: float = parameter(
        0.0,
        "time to skip, from the coupling of the bag's arms or from the start of the file",
        unit="s",
        low=0.0,
        high=1e6,
    )


class ReplayDevice(SimulatedDevice):
    """Recorded samples of one arm at their original times, one per tick, ignoring forces.

    The arm waits at its first position until its first force. A missing sample repeats the
    previous sample, and is counted. A bag of another rate is resampled to the graph's rate. A
    recording that is not looped ends with a third of a second at rest, for the actuator to come to
    rest, after which the device has ended.
    """

    Parameters = ReplayParameters

    _arm: ArmTopics
    _rig: track.ReplayRig

    def __init__(self, parameters: ReplayParameters, rate: float, seed: int) -> None:
        found = read_track(parameters, self._arm, rate)
        played = track.played_at(found, rate, parameters.speed)
        if played.seconds < track.SHORTEST:
            raise ParameterError(
                f"{parameters.file}: lasts {played.seconds:.3g} s at speed = {parameters.speed:g},"
                f" must last {track.SHORTEST:g} s"
            )
        played = track.looped(played) if parameters.loop else track.quieted(played)
        self._play(track.ReplayRig(played, loop=parameters.loop))
        self._remark = _remark(parameters, found, rate)

    @property
    def remark(self) -> str:
        """Description of the recording."""
        return self._remark

    @property
    def ended(self) -> bool:
        """True once the recording and its rest are over."""
        return self._rig.ended


class ReplayMaster(ReplayDevice):
    """Recorded acceleration of the handle and motion of the master's arm."""

    _arm = MASTER


class ReplaySlave(ReplayDevice):
    """Recorded acceleration of the tool and motion of the slave's arm."""

    _arm = SLAVE


def read_track(parameters: ReplayParameters, arm: ArmTopics, rate: float) -> track.Track:
    """Read one arm's samples at the recording's rate.

    Parameters
    ----------
    parameters : ReplayParameters
        `speed` and `loop` are not used.
    arm : ArmTopics
    rate : float
        Samples per second, Hz, to which CSV and WAV files are resampled; a bag is not.

    Raises
    ------
    ParameterError
        There is no file, or the file cannot be used.
    """
    if not parameters.file:
        raise ParameterError("replay.file = '': must be a bag, or a CSV or WAV file")
    if is_bag(parameters.file):
        from haptic_accel.bags.reading import read_bag_with_warnings

        found = bag_track(read_bag_with_warnings(Path(parameters.file)), arm)
    else:
        if not os.path.exists(parameters.file):
            raise ParameterError(f"{parameters.file}: no such bag or file")
        samples = read_recording(parameters.file, parameters.rate, rate, parameters.column)
        found = track.at_rest(samples, rate)
    return track.cut(found, parameters.start)


def is_bag(file: str) -> bool:
    """Return True for a bag's path; False for a CSV or WAV file, or no file."""
    return os.path.isdir(file) or is_storage(Path(file))


def bag_track(bag: Bag, arm: ArmTopics) -> track.Track:
    """Return one arm's samples in a bag, from the first coupling of the arms, if any.

    Raises
    ------
    ParameterError
        The bag has no acceleration of the arm, or its rate cannot be determined.
    """
    rate = bag_rate(bag, arm)
    acceleration = _stamped(bag, arm.acceleration)
    assert acceleration
    motion = _stamped(bag, arm.position), _stamped(bag, arm.velocity)
    with located(bag.path):
        return track.gridded(acceleration, *motion, rate, _coupled(bag))


def bag_rate(bag: Bag, arm: ArmTopics = SLAVE) -> float:
    """Return the sampling rate of an arm in a bag, Hz: as stated, or from stamps.

    Raises
    ------
    ParameterError
        The bag has no acceleration of the arm, or its stamps do not advance.
    """
    acceleration = _stamped(bag, arm.acceleration)
    if acceleration is None:
        raise NothingRecordedError(f"{bag.path}: has no message of {arm.acceleration.name}")
    with located(bag.path):
        return sampling_rate(acceleration[0], bag.stated_rate)


def start_offset(bag: Bag, start: float) -> float:
    """Return the start of a bag's replay, s from its first message of the slave."""
    first = int(bag.signals[SLAVE.acceleration.name].received[0])
    return start + max(0, _coupled(bag) - first) / NANOSECONDS


def _coupled(bag: Bag) -> int:
    """Return the first stamp with samples of both arms and, if any, with coupled arms."""
    found = (_stamped(bag, arm.acceleration) for arm in (MASTER, SLAVE))
    firsts = [int(acceleration[0][0]) for acceleration in found if acceleration]
    for arm in (SLAVE, MASTER):
        if stretches := bag.coupled(arm):
            return max(stretches[0][0], *firsts)
    return max(firsts)


def _stamped(bag: Bag, topic: Topic) -> Stamped | None:
    signal = bag.signals.get(topic.name)
    return (signal.stamps, signal.values) if signal else None


def _remark(parameters: ReplayParameters, found: track.Track, rate: float) -> str:
    """Describe the recording and the changes made to it."""
    parts = [f"plays {found.seconds:.1f} s of {parameters.file}"]
    if found.rate != rate:
        parts.append(f"resampled from {found.rate:g} to {rate:g} Hz")
    if parameters.speed != 1.0:
        parts.append(f"at {parameters.speed:g} times the speed: frequencies change as much")
    if lost := int(found.lost.sum()):
        parts.append(f"{lost} missing samples repeat the previous one")
    if not found.position.any():
        parts.append("without motion, the arm stands still")
    return ", ".join(parts)
