# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The datagram that the two hosts of a coupling send each other: one layout, both ways."""

from __future__ import annotations

import math
import struct
import zlib
from functools import cache
from typing import NamedTuple

from haptic_accel.core.model import Vector
from haptic_accel.core.topics import ARMS

VERSION = 2
"""Version of the layout; hosts of different versions refuse each other."""

MOST_SAMPLES = 16
"""Most samples of the tool's acceleration in a packet: at 1 kHz, with a packet for each sample,
each is sent sixteen times."""

LARGEST_SAMPLE = 1e6
"""Largest magnitude of a sample that is sent, m/s^2: far above any accelerometer's range."""

_MAGIC = b"hapt"
_COUNT = 7  # place of the number of samples; magic and version are the same in every version
_CHECK = struct.Struct("<I")  # CRC-32 of everything before
_READY, _ENGAGED, _STOPPED = 1, 2, 4


@cache
def _layout(count: int) -> struct.Struct:
    """Return the layout of a packet with a number of samples, without the check."""
    return struct.Struct(f"<4sB3BQ2qQ3q2Iq3d3d2dq{count}f")


class Packet(NamedTuple):
    """State of one host, its arm's motion, and on the slave's side the tool's acceleration.

    Every packet carries the whole state, so that none of them has to arrive.

    Attributes
    ----------
    side : str
        Sender, one of `ARMS`.
    session : int
        Random number of the sender's session, not 0.
    sequence : int
        Number of the packet in its session.
    sent : int
        System time of the sender, ns.
    echo_session, echo, echo_sent : int
        Session, sequence and `sent` of the newest packet that the sender received; session 0 for
        none. A packet is fresh for whom it answers: whose session this is.
    echo_received : int
        System time of the sender at that packet's reception, ns.
    ready, engaged, stopped : bool
        The sender could engage; is engaged; follows an emergency stop.
    stops : int
        Number of emergency stops that began at the sender.
    engagement : int
        Number of times that the sender engaged.
    stamp : int
        System time of the sender at which the position was measured, ns.
    position, velocity : tuple of float
        Motion of the sender's arm: relative to where it engaged, m, and in m/s.
    shipped : float
        Energy that the sender gave to the session that it answers, J.
    rate : float
        Samples per second of the sender.
    first : int
        Number of the first sample: its stamp in s times the rate, rounded.
    samples : tuple of float
        Acceleration of the tool along the actuator's axis, m/s^2, at most `MOST_SAMPLES`.
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
    stops: int
    engagement: int
    stamp: int
    position: Vector
    velocity: Vector
    shipped: float
    rate: float
    first: int
    samples: tuple[float, ...] = ()

    def pack(self) -> bytes:
        """Return the datagram."""
        flags = _READY * self.ready | _ENGAGED * self.engaged | _STOPPED * self.stopped
        count = len(self.samples)
        data = _layout(count).pack(
            *(_MAGIC, VERSION, ARMS.index(self.side), flags, count),
            *self[1:8],
            *self[11:14],
            *self.position,
            *self.velocity,
            *self[16:19],
            *self.samples,
        )
        return data + _CHECK.pack(zlib.crc32(data))


def unpack(data: bytes) -> Packet:
    """Return the packet of a datagram.

    Raises
    ------
    ValueError
        It is none, damaged, or of another version.

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
    layout = _layout(data[_COUNT])
    content, check = data[: layout.size], data[layout.size :]
    if check != _CHECK.pack(zlib.crc32(content)):
        raise ValueError("damaged packet")
    _, _, side, flags, _, *values = layout.unpack(content)
    session, real, samples = values[0], values[10:18], values[19:]
    # A number that is not finite makes a sum that is not.
    possible = math.isfinite(sum(real)) and sum(map(abs, samples)) <= MOST_SAMPLES * LARGEST_SAMPLE
    if side >= len(ARMS) or not (possible and session and real[-1] > 0):
        raise ValueError("damaged packet")
    px, py, pz, vx, vy, vz, shipped, rate = real
    state = bool(flags & _READY), bool(flags & _ENGAGED), bool(flags & _STOPPED)
    motion = (px, py, pz), (vx, vy, vz)
    numbers = shipped, rate, values[18]
    return Packet._make(
        (ARMS[side], *values[:7], *state, *values[7:10], *motion, *numbers, tuple(samples))
    )
