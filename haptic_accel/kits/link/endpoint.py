# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Network endpoint of a coupling: outgoing packets, the peer's last state, the clocks' offset.

The endpoint has no clock: the caller passes the times. `now` is monotonic, in s; `system` is the
host's system time, in ns, which may differ from the peer's.

A packet is fresh if it echoes the local session, a random number that is new at every start. A
packet recorded in an earlier session is therefore never fresh. A packet without this echo only
announces a peer, whose session is echoed from then on.
"""

from __future__ import annotations

import math
import secrets
import struct
import zlib
from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
from functools import cache
from typing import NamedTuple

from haptic_accel import Axes, Vector
from haptic_accel.core import ACTUATOR_AXES, NAMES, ZERO
from haptic_accel.core.sampling import NANOSECONDS, same_rate
from haptic_accel.core.topics import ARMS
from haptic_accel.kits.link.playout import Playout

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
_STATES = 1, 2, 4, 8  # flags of ready, engaged, stopped and resumes, as in `Packet`
_FIRST_AXIS = 16  # flag of the samples' x component; y and z follow


@cache
def _layout(count: int) -> struct.Struct:
    """Return the layout of a packet with a specified number of values, without the checksum."""
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
        State of the sender: ready to engage, engaged, stopped by an emergency stop.
    resumes : bool
        True if the sender's present engagement (or its next one, if not engaged) keeps the
        reference position of the previous engagement.
    stops : int
        Number of emergency stops that were triggered on the sender's side.
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
        Axes of the sender's tool acceleration.
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
        states = zip(_STATES, (self.ready, self.engaged, self.stopped, self.resumes), strict=True)
        flags = _axes_flags(self.axes.names) + sum(flag for flag, on in states if on)
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
        The datagram is not a packet, is damaged, or has another version.

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
    count, axes = data[_COUNT], _axes(data[_FLAGS] & -_FIRST_AXIS)
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
    state = (bool(flags & flag) for flag in _STATES)
    motion = (px, py, pz), (vx, vy, vz)
    numbers = shipped, rate, values[18]
    return Packet._make(
        (ARMS[side], *values[:7], *state, *values[7:10], *motion, *numbers, tuple(samples), axes)
    )


UNHEARD = "the peer does not receive this host's packets"
"""Problem message: packets arrive, but none echoes the local session."""

REFUSED = "the peer's packets are refused"
"""Problem message: packets arrive, but none is accepted."""

LIFETIME = 0.5
"""Silence after which another peer is accepted, s. The arms uncouple earlier without packets, and
the restart of a process takes longer."""

PROBLEM_TIME = 2.0
"""Time for which the reason for a rejection is shown, s."""

DUPLICATE_WINDOW = 1024
"""Number of packets before the newest for which duplicates are distinguished from late packets. It
is 1 s at 1 kHz; older samples are of no use to the playout."""

FASTEST = 2000.0
"""Maximum packet rate of a peer, Hz: twice its sampling rate, as each change of its state also
sends a packet."""

LARGEST_JUMP = 3.0
"""Maximum jump of the sequence number, as a time since the last packet, s. No process or network
delays packets that long. A larger number would make all later packets appear old."""

RENEW_AFTER = 1.0
"""Time without an accepted packet, while packets arrive, after which a new session starts, s;
longer than `LIFETIME`."""


_NEVER = -math.inf, -math.inf


class Admission(Enum):
    """Permitted use of a packet."""

    NEWEST = auto()
    OVERTAKEN = auto()
    """Overtaken by a newer packet: the samples are used, the state is not."""
    HANDSHAKE = auto()
    """Not fresh: the packet's session is echoed, and its other contents are ignored."""
    REFUSED = auto()


def random_session() -> int:
    """Return a random number for a new session."""
    return secrets.randbits(64) or 1


class Session:
    """Accept each packet of one peer once, if it echoes the local session.

    A restarted peer has a new session, which is accepted after the former was silent for
    `LIFETIME`. A replaced session is never accepted again. If packets arrive but none is accepted
    for `RENEW_AFTER`, a new local session begins, as after a restart.

    Parameters
    ----------
    side : str
        Local side; the peer must be the other.
    own : int
        Number of the local session, not 0.

    Attributes
    ----------
    own : int
        Local session, which packets must echo.
    peer : int
        Session of the peer; 0 before the peer's first packet.
    last_reception, unanswered : float
        Time of the newest accepted packet, and of the last packet that was not fresh, s.
    received, lost, doubled, out_of_order, restarts, refused, renewals : int
        Numbers of packets: accepted, lost, duplicated or much too late, overtaken; of new sessions
        of the peer after the first; of foreign or malformed packets; of new local sessions.
    """

    def __init__(self, side: str, own: int) -> None:
        self._side = side
        self._problem, self._problem_time = "", -math.inf
        self.own = own
        self.last_reception = self.unanswered = -math.inf
        self.received = self.lost = self.doubled = self.out_of_order = 0
        self.restarts = self.refused = self.renewals = 0
        self._forget()

    @property
    def pair(self) -> tuple[int, int]:
        """Local session and the peer's."""
        return self.own, self.peer

    @property
    def loss(self) -> float:
        """Fraction of packets that were lost."""
        came = self.received + self.out_of_order
        return self.lost / (came + self.lost) if came else 0.0

    def admits(self, packet: Packet, now: float) -> Admission:
        """Count a packet; return its permitted use."""
        if reason := self._reason(packet, now):
            self.refuse(reason, now)
            if packet.session in self._former:
                self._came_in_vain(now)
            return Admission.REFUSED
        if packet.echo_session != self.own:
            self.unanswered = now
            return Admission.REFUSED if self._lives(now) else Admission.HANDSHAKE
        if packet.session != self.peer:
            self._begin(packet)
        elif not self._follows(packet.sequence, now):
            return self._late(packet.sequence, now)
        self.received += 1
        self.last_reception = now
        self._vain = _NEVER
        return Admission.NEWEST

    def renew(self) -> None:
        """Start a new local session; to the peer, this host appears restarted."""
        self.own = random_session()
        self.renewals += 1
        self._forget()

    def refuse(self, reason: str, now: float) -> None:
        """Count a foreign or malformed packet; the reason is fixed text."""
        self.refused += 1
        self._problem, self._problem_time = reason, now

    def problem(self, now: float) -> str:
        """Return a line on why packets are rejected at present, or an empty string."""
        return self._problem if now - self._problem_time < PROBLEM_TIME else ""

    def unusable(self, now: float, timeout: float) -> str:
        """Return the reason why the latest packets were refused, time in s; empty if none was."""
        if now - self.unanswered <= timeout:
            return UNHEARD
        return REFUSED if now - self._problem_time <= timeout else ""

    def _forget(self) -> None:
        """Reset the peer; packets sent to the former local session are no longer accepted."""
        # First and last unusable packets since the last accepted one.
        self.peer = 0
        self._former: set[int] = set()
        self._newest = self._seen = 0
        self._vain = _NEVER

    def _lives(self, now: float) -> bool:
        return bool(self.peer) and now - self.last_reception < LIFETIME

    def _reason(self, packet: Packet, now: float) -> str:
        """Return the reason why a packet is not from the peer; empty if it is."""
        if packet.side == self._side:
            return f"both hosts are side:={packet.side}: one must be the other"
        if packet.session in self._former:
            return "packet of a peer that was replaced by another"
        if packet.session != self.peer and self._lives(now):
            return f"second peer with side:={packet.side}: end one of the two"
        return ""

    def _begin(self, packet: Packet) -> None:
        if self.peer:
            self._former.add(self.peer)
            self.restarts += 1
        self.peer, self._newest, self._seen = packet.session, packet.sequence, 1

    def _follows(self, sequence: int, now: float) -> bool:
        """Count a packet with the highest number so far; return True if it is acceptable."""
        ahead = sequence - self._newest
        if not 0 < ahead <= FASTEST * (now - self.last_reception + LARGEST_JUMP):
            return False
        self.lost += ahead - 1
        # The lowest bit is the newest packet; a long silence clears all others.
        self._seen = (self._seen << min(ahead, DUPLICATE_WINDOW) | 1) % (1 << DUPLICATE_WINDOW)
        self._newest = sequence
        return True

    def _late(self, sequence: int, now: float) -> Admission:
        """Count a peer's packet that is not newer, or has too large a sequence number."""
        own, behind = self.own, self._newest - sequence
        self._came_in_vain(now)
        if self.own != own:
            return Admission.REFUSED
        bit = 1 << behind if 0 <= behind < DUPLICATE_WINDOW else 0
        if bit and not self._seen & bit:
            self._seen |= bit
            self.out_of_order += 1
            self.lost -= 1
            return Admission.OVERTAKEN
        if behind < 0:
            self.refuse("packet with a number far ahead of the last", now)
        else:
            self.doubled += 1
        return Admission.REFUSED

    def _came_in_vain(self, now: float) -> None:
        """Record a packet with an unusable state; start a new session if such packets persist."""
        if not now - self._vain[1] < LIFETIME:
            self._vain = now, now
        self._vain = self._vain[0], now
        if now - self._vain[0] > RENEW_AFTER:
            self.renew()


INTERVAL = NANOSECONDS
"""Length of an interval, ns. The exchange with the shortest round trip in each interval is
kept."""

FITTED_INTERVALS = 120
"""Number of intervals in the line fit."""

FEWEST = 10
"""Minimum number of intervals for a drift estimate. With fewer, the exchange with the shortest
round trip determines the offset."""

SLACK = 1e-3
"""Deviation from the line, beyond the uncertainty of both round trips, that indicates a clock
step, s."""


class Exchange(NamedTuple):
    """Exchange: local time at its middle, ns; measured offset and round trip, s."""

    time: int
    offset: float
    round_trip: float


class ClockOffset:
    """Peer's clock minus the local clock: a line through the best exchange of each second.

    The delays of the two directions may differ, so the offset is known to half a round trip.

    Attributes
    ----------
    bound : float
        Half of the shortest round trip plus the distance of the line from that exchange, s.
        Infinite before the first exchange.
    drift : float
        Change of the offset, s/s.

    Examples
    --------
    >>> clock = ClockOffset()
    >>> clock.add(sent=0, received=3_000_000, replied=4_000_000, arrived=2_000_000)
    >>> clock.offset(2_000_000), clock.bound
    (0.0025, 0.0005)
    """

    def __init__(self) -> None:
        self._exchanges: deque[Exchange] = deque(maxlen=FITTED_INTERVALS)
        self._interval: int | None = None
        self._restart()

    def add(self, sent: int, received: int, replied: int, arrived: int) -> None:
        """Add an exchange.

        Parameters
        ----------
        sent, arrived : int
            Local times of the packet's transmission and of the reply's arrival, ns.
        received, replied : int
            Peer's times of the packet's reception and of the reply's transmission, ns.
        """
        away, held = arrived - sent, replied - received
        if held < 0 or away <= held:  # a clock was set during the exchange
            return
        interval, round_trip = arrived // INTERVAL, (away - held) / NANOSECONDS
        new = interval != self._interval
        if not new and round_trip >= self._exchanges[-1].round_trip:
            return
        offset = ((received - sent) + (replied - arrived)) / 2 / NANOSECONDS
        found = Exchange((sent + arrived) // 2, offset, round_trip)
        if new:
            self._interval = interval
            self._close()
            self._exchanges.append(found)
        else:
            self._exchanges[-1] = found
        if len(self._exchanges) == 1:
            self._fit()

    def offset(self, now: int) -> float:
        """Return the offset at a local time in ns, s; 0 before the first exchange."""
        return self._offset + self.drift * (now - self._origin) / NANOSECONDS

    def _restart(self) -> None:
        self._exchanges.clear()
        self._origin, self._offset = 0, 0.0
        self.drift, self.bound = 0.0, math.inf

    def _close(self) -> None:
        """Fit the line to the completed intervals; restart the estimate after a clock step."""
        if self._exchanges and self._differs(last := self._exchanges[-1]):
            self._restart()
            self._exchanges.append(last)
        self._fit()

    def _differs(self, exchange: Exchange) -> bool:
        """Return True if only a clock step can explain an exchange."""
        difference = abs(exchange.offset - self.offset(exchange.time))
        return difference > exchange.round_trip / 2 + self.bound + SLACK

    def _fit(self) -> None:
        """Fit the line to the available exchanges."""
        if not self._exchanges:
            return
        best = min(self._exchanges, key=lambda each: each.round_trip)
        self.bound = best.round_trip / 2
        self._origin, self._offset, self.drift = best.time, best.offset, 0.0
        if len(self._exchanges) < FEWEST:
            return
        # A delay in one direction lengthens the round trip, and the exchange's error, by its
        # duration.
        weights = [each.round_trip**-2 for each in self._exchanges]
        times = [(each.time - best.time) / NANOSECONDS for each in self._exchanges]
        offsets = [each.offset for each in self._exchanges]
        middle, mean = _mean(times, weights), _mean(offsets, weights)
        spread = _mean([(time - middle) ** 2 for time in times], weights)
        pairs = zip(times, offsets, strict=True)
        products = [(time - middle) * (offset - mean) for time, offset in pairs]
        self.drift = _mean(products, weights) / spread
        self._offset = mean - self.drift * middle
        self.bound += abs(self._offset - best.offset)


def _mean(values: Sequence[float], weights: Sequence[float]) -> float:
    return sum(v * w for v, w in zip(values, weights, strict=True)) / sum(weights)


PACKET_PERIOD = 1e-3
"""Shortest interval between packets, s; below 1 kHz each sample has one packet. Jitter delays the
tool's acceleration only if it delays several successive packets. With 10 ms of jitter and 10 %
loss, a sample is played 3 ms after the network's mean delay. With a packet every 2 ms, it is
played 8 ms after the mean delay."""

EARLY = 0.25
"""Fraction of the interval by which a packet may be sent early, since the caller's ticks
jitter."""

REMEMBERED = 4096
"""Number of packets whose times are stored for their echoes: 4 s."""

CLOCKS_AGREE = 2e-3
"""Clock offset, in excess of its bound, that causes a warning, s."""


class State(NamedTuple):
    """State of a host; see `Packet` for the fields."""

    ready: bool = False
    engaged: bool = False
    stopped: bool = False
    resumes: bool = False
    stops: int = 0
    engagement: int = 0


class Motion(NamedTuple):
    """Motion of an arm in a packet: stamp, ns; position from its reference, m; velocity, m/s."""

    stamp: int = 0
    position: Vector = ZERO
    velocity: Vector = ZERO


class Endpoint:
    """Create the packets for the peer, and accept the peer's packets.

    Parameters
    ----------
    side : str
        Arm of this host: master or slave.
    rate : float
        Samples per second.
    session : int
        Random 64-bit number of this run, not 0, from `random_session`.
    axes : Axes
        Axes of the local tool, whose components are sent.

    Attributes
    ----------
    peer : Packet or None
        Newest packet of the peer: its state, motion and energy.
    session : Session
        Filter of received packets, with counts and the local session number.
    clock : ClockOffset
        Offset of the peer's clock from the local one.
    playout : Playout
        Playout of the peer's samples.
    delay : float
        Transit time of the newest packet, based on the estimated clock offset, s.

    Examples
    --------
    >>> master, slave = Endpoint("master", 1000.0, 1), Endpoint("slave", 1000.0, 2)
    >>> for now in (0.0, 0.1):
    ...     for sender, receiver in ((master, slave), (slave, master)):
    ...         sent = sender.outgoing(State(ready=True), Motion(), 0.0, now, system=5_000_000)
    ...         packet = receiver.incoming(sent, now, system=9_000_000)
    >>> slave.fresh(0.15, timeout=0.1), slave.peer.ready
    (True, True)
    """

    def __init__(self, side: str, rate: float, session: int, axes: Axes = ACTUATOR_AXES) -> None:
        self._side, self._rate, self._axes = side, rate, axes
        self._period = max(PACKET_PERIOD, 1.0 / rate)
        self._sequence = 0
        self._due = -math.inf
        self._said: State | None = None
        self._sent = [(-1, 0, 0.0)] * REMEMBERED  # sequence, system time, time of the motion
        self._samples: deque[float] = deque(maxlen=MOST_SAMPLES * len(axes.names))
        self._next_sample = 0
        self._answered = 0, 0, 0, 0  # session, sequence and time of sending; own time
        self._pair = 0, 0
        self.peer: Packet | None = None
        self.session = Session(side, session)
        self.clock = ClockOffset()
        self.playout = Playout(rate)
        self.delay = 0.0

    def sampled(self, stamp: int, acceleration: Vector) -> None:
        """Queue a sample of the tool's acceleration, m/s^2, for the next packets.

        A sample with a component that is not finite counts as missing.
        """
        components = self._axes.components(acceleration)
        if not all([abs(component) <= LARGEST_SAMPLE for component in components]):
            return
        number = round(stamp * self._rate / NANOSECONDS)
        if number != self._next_sample:
            self._samples.clear()  # a packet holds successive samples only
        self._samples.extend(components)
        self._next_sample = number + 1

    def outgoing(
        self, state: State, motion: Motion, shipped: float, now: float, system: int
    ) -> bytes | None:
        """Return the packet that is due now, or None; a change of state makes one due.

        Parameters
        ----------
        state : State
        motion : Motion
            Newest motion of the local arm.
        shipped : float
            Cumulative energy sent to the peer, J.
        now, system : float, int
        """
        if state == self._said and now < self._due - EARLY * self._period:
            return None
        self._due = max(self._due + self._period, now)
        self._said = state
        self._sequence += 1
        age = max(0.0, (system - motion.stamp) / NANOSECONDS) if motion.stamp else 0.0
        self._sent[self._sequence % REMEMBERED] = self._sequence, system, now - age
        own, peer = self.session.pair
        # Energy counts per pair of sessions, so none is sent before the peer is known.
        energy = shipped if self._answered[0] == peer else 0.0
        first = self._next_sample - len(self._samples) // len(self._axes.names)
        return Packet(
            *(self._side, own, self._sequence, system, *self._answered, *state, *motion),
            *(energy, self._rate, first, tuple(self._samples), self._axes),
        ).pack()

    def incoming(self, data: bytes, now: float, system: int) -> Packet | None:
        """Return the packet of a datagram if it is valid, fresh and newer than all before.

        Samples of an overtaken packet are still played, as no other packet may contain them. A
        packet that is not fresh only provides the session for the reply.
        """
        try:
            packet = unpack(data)
        except ValueError as error:
            self.session.refuse(str(error), now)
            return None
        if not same_rate(packet.rate, self._rate):
            self.session.refuse(
                f"the peer has rate:={packet.rate:g}: must be {self._rate:g} Hz as here", now
            )
            return None
        admission = self.session.admits(packet, now)
        if admission is Admission.REFUSED:
            return None
        if admission is Admission.HANDSHAKE:
            self._answered = packet.session, 0, 0, 0
            return None
        if self._pair != (pair := self.session.pair):
            self._pair, self.peer = pair, None
            self.clock = ClockOffset()
            self.playout.clear()
        if packet.samples:
            self.playout.put(packet.first, packet.samples, now, packet.axes)
        if admission is Admission.OVERTAKEN:
            return None
        if self.peer and packet.shipped < self.peer.shipped:
            # One of the two values is wrong. If the larger one is, later values might never reach
            # it.
            self.session.refuse("the peer's energy values are inconsistent", now)
            self.session.renew()
            return None
        self.peer = packet
        self._answered = packet.session, packet.sequence, packet.sent, system
        sequence, sent, _ = self._sent[packet.echo % REMEMBERED]
        if (sequence, sent) == (packet.echo, packet.echo_sent):
            self.clock.add(sent, packet.echo_received, packet.sent, system)
        self.delay = self._age_of(packet.sent, system)
        return packet

    @property
    def shipped(self) -> float:
        """Energy that the peer gave to this run, J, excluding earlier runs."""
        return self.peer.shipped if self.peer and self._is_echoed(self.peer) else 0.0

    def fresh(self, now: float, timeout: float) -> bool:
        """Return True if a packet of the peer was received within a time in s."""
        return now - self.session.last_reception <= timeout

    def round_trip_age(self, now: float) -> float:
        """Return the age of the newest local position that the peer acknowledged, s.

        The age is measured by the local clock and the echo in the peer's packet; infinite before
        the first echo.
        """
        if not (self.peer and self._is_echoed(self.peer)):
            return math.inf
        sequence, _, measured = self._sent[self.peer.echo % REMEMBERED]
        return now - measured if sequence == self.peer.echo else math.inf

    def age(self, system: int) -> float:
        """Return the age of the peer's position from the clock offset, s; 0 without an offset."""
        return self._age_of(self.peer.stamp, system) if self.peer and self.peer.stamp else 0.0

    def problems(self, system: int, now: float) -> dict[str, str]:
        """Return a message for each kind of problem between the hosts."""
        refused, offset = self.session.problem(now), self.clock.offset(system)
        bound = self.clock.bound
        found = {refused: refused} if refused else {}
        if math.isfinite(bound) and abs(offset) > CLOCKS_AGREE + bound:
            found["clock"] = (
                f"the peer's clock is {offset * 1e3:+.1f} ms (within {bound * 1e3:.1f} ms) from"
                " this host's: run chrony on both"
            )
        return found

    def diagnostics(self, system: int, now: float) -> dict[str, str]:
        """Return values for diagnostics."""
        session, known = self.session, math.isfinite(self.clock.bound)
        age = self.round_trip_age(now)
        return {
            "one-way delay (ms)": f"{self.delay * 1e3:.2f}" if known else "",
            "round-trip age (ms)": f"{age * 1e3:.2f}" if math.isfinite(age) else "",
            "clock offset (ms)": f"{self.clock.offset(system) * 1e3:.3f}" if known else "",
            "clock offset bound (ms)": f"{self.clock.bound * 1e3:.3f}" if known else "",
            "clock drift (ppm)": f"{self.clock.drift * 1e6:.1f}" if known else "",
            "packets received": str(session.received),
            "packets lost": str(session.lost),
            "packet loss (%)": f"{100 * session.loss:.2f}",
            "packets doubled": str(session.doubled),
            "packets out of order": str(session.out_of_order),
            "packets refused": str(session.refused),
            "peer restarts": str(session.restarts),
            "sessions restarted": str(session.renewals),
        }

    def _is_echoed(self, packet: Packet) -> bool:
        return packet.echo_session == self.session.own

    def _age_of(self, moment: int, system: int) -> float:
        """Return the age of a peer's time stamp, s."""
        return (system - moment) / NANOSECONDS + self.clock.offset(system)
