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

"""Datagram between the two hosts of a coupling, with one layout for both directions."""

from __future__ import annotations

import math
import struct
import zlib
from functools import cache
from typing import NamedTuple

from haptic_accel.core.axes import ACTUATOR_AXES, NAMES, Axes
from haptic_accel.core.model import Vector
from haptic_accel.core.topics import ARMS

VERSION = 3
"""Version of the layout; hosts with different versions reject each other's packets."""

MOST_SAMPLES = 16
"""Maximum number of acceleration samples in a packet. At 1 kHz, with a packet per sample, each
sample is sent sixteen times."""

LARGEST_SAMPLE = 1e6
"""Maximum magnitude of a sample, m/s^2: far above any accelerometer's range."""

_MAGIC = b"hapt"
_FLAGS, _COUNT = 6, 7  # indices of flags and number of samples; all versions share magic, version
_CHECK = struct.Struct("<I")  # CRC-32 of the preceding bytes
_READY, _ENGAGED, _STOPPED, _RESUMES = 1, 2, 4, 8
_STATES = _READY | _ENGAGED | _STOPPED | _RESUMES
_FIRST_AXIS = 16  # flag of the samples' x component; y and z follow


@cache
def _layout(count: int) -> struct.Struct:
    """Return the layout of a packet with a given number of values, without the checksum."""
    return struct.Struct(f"<4sB3BQ2qQ3q2Iq3d3d2dq{count}f")


@cache
def _axes_flags(names: tuple[str, ...]) -> int:
    """Return the flags of the components that a packet's samples have."""
    return sum(_FIRST_AXIS << NAMES.index(name) for name in names)


@cache
def _axes(flags: int) -> Axes | None:
    """Return the axes of a packet's samples by its flags."""
    names = tuple(name for index, name in enumerate(NAMES) if flags & _FIRST_AXIS << index)
    return Axes(names) if names else None


class Packet(NamedTuple):
    """State of a host and its arm's motion; from the slave's side also the tool's acceleration.

    Each packet carries the complete state, so that the loss of a packet does no harm.

    Attributes
    ----------
    side : str
        Sender, one of `ARMS`.
    session : int
        Random number of the sender's session, not 0.
    sequence : int
        Number of the packet within its session.
    sent : int
        System time of the sender, ns.
    echo_session, echo, echo_sent : int
        Session, sequence and `sent` of the newest packet that the sender received; session 0 if
        none. A packet is fresh for the host whose session `echo_session` is.
    echo_received : int
        System time of the sender when that packet was received, ns.
    ready, engaged, stopped : bool
        The sender is ready to engage; is engaged; is under an emergency stop.
    resumes : bool
        The sender keeps the reference position of its previous engagement: if engaged, it does; if
        free, it would at its next engagement.
    stops : int
        Number of emergency stops that began on the sender's side.
    engagement : int
        Number of engagements of the sender.
    stamp : int
        System time of the sender when the position was measured, ns.
    position, velocity : tuple of float
        Motion of the sender's arm: position relative to its reference position, m, and velocity,
        m/s.
    shipped : float
        Energy that the sender gave to the session named by `echo_session`, J.
    rate : float
        Sampling rate of the sender, Hz.
    first : int
        Number of the first sample: its stamp in s, multiplied by the rate and rounded.
    samples : tuple of float
        Acceleration of the tool, m/s^2: the components along `axes`, sample by sample; at most
        `MOST_SAMPLES` samples.
    axes : Axes
        Axes of the tool that the sender has.
    """

    side: str
    session: int
    sequence: int
    sent: int
    echo_session: int
    echo: int
    echo_sent: int
    echo_received: int
    ready: bool
    engaged: bool
    stopped: bool
    resumes: bool
    stops: int
    engagement: int
    stamp: int
    position: Vector
    velocity: Vector
    shipped: float
    rate: float
    first: int
    samples: tuple[float, ...] = ()
    axes: Axes = ACTUATOR_AXES

    def pack(self) -> bytes:
        """Return the datagram."""
        flags = (
            _READY * self.ready
            | _ENGAGED * self.engaged
            | _STOPPED * self.stopped
            | _RESUMES * self.resumes
            | _axes_flags(self.axes.names)
        )
        count = len(self.samples) // len(self.axes.names)
        data = _layout(len(self.samples)).pack(
            *(_MAGIC, VERSION, ARMS.index(self.side), flags, count),
            *self[1:8],
            *self[12:15],
            *self.position,
            *self.velocity,
            *self[17:20],
            *self.samples,
        )
        return data + _CHECK.pack(zlib.crc32(data))


def unpack(data: bytes) -> Packet:
    """Return the packet of a datagram.

    Raises
    ------
    ValueError
        The datagram is no packet, is damaged, or has another version.

    Examples
    --------
    >>> unpack(b"hello")
    Traceback (most recent call last):
    ...
    ValueError: not a packet of haptic_accel
    """
    if len(data) <= len(_MAGIC) or not data.startswith(_MAGIC):
        raise ValueError("not a packet of haptic_accel")
    version = data[len(_MAGIC)]
    if version != VERSION:
        raise ValueError(
            f"the peer's packets have version {version}: must be {VERSION}; install the same"
            " haptic_accel on both hosts"
        )
    if len(data) <= _COUNT or data[_COUNT] > MOST_SAMPLES:
        raise ValueError("damaged packet")
    count, axes = data[_COUNT], _axes(data[_FLAGS] & ~_STATES)
    if axes is None:
        raise ValueError("damaged packet")
    layout = _layout(count * len(axes.names))
    content, check = data[: layout.size], data[layout.size :]
    if check != _CHECK.pack(zlib.crc32(content)):
        raise ValueError("damaged packet")
    _, _, side, flags, _, *values = layout.unpack(content)
    session, real, samples = values[0], values[10:18], values[19:]
    # A non-finite value makes the sum non-finite.
    possible = math.isfinite(sum(real)) and sum(map(abs, samples)) <= len(samples) * LARGEST_SAMPLE
    if side >= len(ARMS) or not (possible and session and real[-1] > 0):
        raise ValueError("damaged packet")
    px, py, pz, vx, vy, vz, shipped, rate = real
    state = (bool(flags & flag) for flag in (_READY, _ENGAGED, _STOPPED, _RESUMES))
    motion = (px, py, pz), (vx, vy, vz)
    numbers = shipped, rate, values[18]
    return Packet._make(
        (ARMS[side], *values[:7], *state, *values[7:10], *motion, *numbers, tuple(samples), axes)
    )
