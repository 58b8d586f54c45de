# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of both arms of a host: spring, engagement and the encoders' rounding."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from haptic_accel.core.model import ZERO
from haptic_accel.core.tick.samples import BEFORE_ALL, ArmSample, Pairing

if TYPE_CHECKING:
    from collections.abc import Iterator

    from haptic_accel.core.model import Vector

STEP_PERIOD: float = 0.02
"""Interval of decisions about the engagement, s."""

CORRECTION_TIME: float = 0.02
"""Time constant with which the observer returns to the measured position, s: several counts of 55
um at 10 mm/s, as in the vibration of a texture."""

STEP_MEMORY: float = 1.0
"""Time constant with which the largest step is forgotten, s: several reversals of a stroke."""

COARSEST: float = 1e-3
"""Step above which a position has jumped, m; the resolution of the simulated encoders is at most
this."""

FINEST: float = 1e-6
"""Step below which a position counts as smooth, m: 0.3 mN through the paper's spring."""

FASTEST: float = 10.0
"""Speed that no arm reaches, m/s; a hand that guides a handle moves at 1 to 2 m/s."""

HELD: float = 5e-3
"""Time for which a device may repeat a position, s: an arm with 200 positions a second."""

REFUSED = "{}: position {:.4g}, {:.4g}, {:.4g} m: refused, as it is {:.3g} m from the one before"
"""Reason to reject a position that is not finite, or that an arm cannot have reached."""


class CountObserver:
    """Estimate an arm's position between the counts of its encoders, from its velocity.

    The estimate moves with the velocity and returns to the measured position in `CORRECTION_TIME`.
    It differs from that position by at most the largest recent step between two samples that the
    velocity does not explain: a count for rounded positions, and nothing for smooth ones.
    Therefore neither resolution nor geometry of the encoders must be known. After a jump the
    estimate restarts. If the velocity is delayed, the estimate has a smaller delay; without
    velocity it is the measured position.

    Parameters
    ----------
    rate : float
        Samples per second.

    Attributes
    ----------
    x, y, z : float
        Measured minus estimated position of the newest sample, m.

    Examples
    --------
    >>> observer = CountObserver(1000.0)
    >>> observer.observe(ArmSample(0, (0.0, 0.0, 1e-3), (0.0, 0.0, 0.01)))
    >>> observer.x, observer.y, observer.z
    (0.0, 0.0, 0.0)
    """

    def __init__(self, rate: float) -> None:
        self._half_period: float = 0.5 / rate
        self._left: float = 1.0 - 1.0 / (1.0 + CORRECTION_TIME * rate)
        self._kept: float = 1.0 - 1.0 / (1.0 + STEP_MEMORY * rate)
        self._p_x = self._p_y = self._p_z = 0.0
        self._v_x = self._v_y = self._v_z = 0.0
        self.restart()

    def restart(self) -> None:
        """Discard the motion and the steps."""
        self._is_known = False
        self._s_x = self._s_y = self._s_z = 0.0
        self.x = self.y = self.z = 0.0

    def observe(self, sample: ArmSample) -> None:
        """Update the estimate with the next sample."""
        half_period, kept = self._half_period, self._kept
        x, y, z = sample.x, sample.y, sample.z
        v_x, v_y, v_z = sample.v_x, sample.v_y, sample.v_z
        step_x = x - self._p_x - (v_x + self._v_x) * half_period
        step_y = y - self._p_y - (v_y + self._v_y) * half_period
        step_z = z - self._p_z - (v_z + self._v_z) * half_period
        self._p_x, self._p_y, self._p_z = x, y, z
        self._v_x, self._v_y, self._v_z = v_x, v_y, v_z
        if not self._is_known:
            self._is_known = True
            return
        if not (
            -COARSEST < step_x < COARSEST
            and -COARSEST < step_y < COARSEST
            and -COARSEST < step_z < COARSEST
        ):  # or NaN
            self.restart()
            return
        largest, size = kept * self._s_x, math.fabs(step_x)
        self._s_x = largest = size if size > largest else largest
        left = (self.x + step_x) * self._left if v_x and largest > FINEST else 0.0
        self.x = left if -largest <= left <= largest else math.copysign(largest, left)
        largest, size = kept * self._s_y, math.fabs(step_y)
        self._s_y = largest = size if size > largest else largest
        left = (self.y + step_y) * self._left if v_y and largest > FINEST else 0.0
        self.y = left if -largest <= left <= largest else math.copysign(largest, left)
        largest, size = kept * self._s_z, math.fabs(step_z)
        self._s_z = largest = size if size > largest else largest
        left = (self.z + step_z) * self._left if v_z and largest > FINEST else 0.0
        self.z = left if -largest <= left <= largest else math.copysign(largest, left)


class PairCoupling:
    """Interface of a coupling of two arms on one host.

    Attributes
    ----------
    engaged : bool
        True while the arms are coupled.
    stiffness, scale : float
        Effective stiffness at the master, N/m, and slave motion per master motion.
    m_x, m_y, m_z, s_x, s_y, s_z : float
        Newest forces on master and slave, N.
    """

    def __init__(self) -> None:
        self.engaged = False
        self.stiffness, self.scale = 0.0, 1.0
        self.m_x = self.m_y = self.m_z = self.s_x = self.s_y = self.s_z = 0.0

    def engage(self, master: Vector, slave: Vector) -> None:
        """Couple the arms at their positions, m."""
        self.engaged = True

    def disengage(self) -> None:
        """Uncouple the arms: forces are zero until the next `engage`."""
        self.engaged = False

    def couple(self, master: ArmSample, slave: ArmSample) -> None:
        """Compute the forces for samples of both arms; they are zero while uncoupled."""

    def forces(
        self,
        master: Vector,
        slave: Vector,
        master_velocity: Vector = ZERO,
        slave_velocity: Vector = ZERO,
    ) -> tuple[Vector, Vector]:
        """Return the forces on master and slave, N, for positions, m, and velocities, m/s."""
        self.couple(ArmSample(0, master, master_velocity), ArmSample(0, slave, slave_velocity))
        return (self.m_x, self.m_y, self.m_z), (self.s_x, self.s_y, self.s_z)


class PositionPositionCoupling(PairCoupling):
    """A spring, and optionally a damper, between the motions of master and slave.

    The positions at engagement are the reference positions of both arms. Engagement therefore
    causes no force at any position. Every force is zero until `engage` is called.

    Parameters
    ----------
    parameters : CouplingParameters

    Attributes
    ----------
    k_sl, damping, max_force : float
        Present gains, as in `CouplingParameters`; `stiffness` is its `k_m`. The forces are limited
        in magnitude.
    """

    def __init__(self, parameters: Any) -> None:
        PairCoupling.__init__(self)
        self._fade = [_gains(parameters)]
        self.k_sl = self.damping = self.max_force = 0.0
        self._take_gains()
        self._m_x = self._m_y = self._m_z = self._s_x = self._s_y = self._s_z = 0.0

    def engage(self, master: Vector, slave: Vector) -> None:
        """Couple the arms at their positions, m."""
        self.engaged = True
        self._m_x, self._m_y, self._m_z = master
        self._s_x, self._s_y, self._s_z = slave

    def change(self, parameters: Any, samples: int) -> None:
        """Change the gains within a number of samples, without a jump of force.

        The lag of the slave, in the master's scale, does not change. A new scale applies to later
        motion only; without spring force no arm moves.

        This is not passive. A stiffness that rises by K while the spring is stretched by d adds
        the energy K d^2 / 2. This energy is at most F^2 / 2k for the force limit F and the old
        stiffness k. With the defaults this is 22 mJ; over `FADE_TIME` this is much less power than
        a hand exchanges.
        """
        start = self.stiffness, self.k_sl, self.damping, self.max_force, self.scale
        end = _gains(parameters)
        self._fade = [end]
        if not self.engaged:
            self._take_gains()
            return
        for step in range(samples - 1, 0, -1):  # the next gains are last
            share = step / samples
            between = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
            # Interpolate geometrically, as both the scale and its inverse are factors.
            self._fade.append((*between[:4], start[4] * (end[4] / start[4]) ** share))

    def _take_gains(self) -> None:
        gains = self._fade.pop()
        self.stiffness, self.k_sl, self.damping, self.max_force, self.scale = gains

    def couple(self, master: ArmSample, slave: ArmSample) -> None:
        """Compute the forces for samples of both arms; they are zero while uncoupled."""
        if not self.engaged:
            self.m_x = self.m_y = self.m_z = self.s_x = self.s_y = self.s_z = 0.0
            return
        k_m, k_sl, damping, scale = self.stiffness, self.k_sl, self.damping, self.scale
        limit = self.max_force
        # Lag of the slave behind the master, in the master's scale.
        d_x = (master.x - self._m_x) - (slave.x - self._s_x) / scale
        d_y = (master.y - self._m_y) - (slave.y - self._s_y) / scale
        d_z = (master.z - self._m_z) - (slave.z - self._s_z) / scale
        v_x = master.v_x - slave.v_x / scale
        v_y = master.v_y - slave.v_y / scale
        v_z = master.v_z - slave.v_z / scale
        x = -k_m * d_x - damping * v_x
        y = -k_m * d_y - damping * v_y
        z = -k_m * d_z - damping * v_z
        magnitude = math.sqrt(x * x + y * y + z * z)
        if not magnitude <= limit:
            if not math.isfinite(magnitude):
                x, y, z, magnitude = 0.0, 0.0, 0.0, 1.0
            ratio = limit / magnitude
            x, y, z = x * ratio, y * ratio, z * ratio
        self.m_x, self.m_y, self.m_z = x, y, z
        x = scale * (k_sl * d_x + damping * v_x)
        y = scale * (k_sl * d_y + damping * v_y)
        z = scale * (k_sl * d_z + damping * v_z)
        magnitude = math.sqrt(x * x + y * y + z * z)
        if not magnitude <= limit:
            if not math.isfinite(magnitude):
                x, y, z, magnitude = 0.0, 0.0, 0.0, 1.0
            ratio = limit / magnitude
            x, y, z = x * ratio, y * ratio, z * ratio
        self.s_x, self.s_y, self.s_z = x, y, z
        if self._fade and math.isfinite(d_x + d_y + d_z):
            self._m_x, self._m_y, self._m_z = master.x - d_x, master.y - d_y, master.z - d_z
            self._s_x, self._s_y, self._s_z = slave.x, slave.y, slave.z
            self._take_gains()


def _gains(p: Any) -> tuple[float, ...]:
    """Return the values of `CouplingParameters` that change together."""
    return p.k_m, p.k_sl, p.damping, p.max_force, p.scale


class ArmWatch:
    """Monitor of an arm's positions: their plausibility, and interruptions.

    Parameters
    ----------
    arm : str
    timeout : float
        Maximum time between two positions, s, that does not end the engagement.

    Attributes
    ----------
    received : float
        Time of the newest usable position, s.
    interrupted : str
        Interruption or jump that ends the engagement; empty if there is none.
    refusal : str
        Reason why the newest position is rejected; empty if it is accepted.
    refused : int
        Number of positions that are not finite, or farther than an arm can have moved.
    """

    def __init__(self, arm: str, timeout: float) -> None:
        self.arm: str = arm
        self.timeout: float = timeout
        self.received: float = BEFORE_ALL
        self.interrupted = self.refusal = ""
        self.refused = self._stamp = 0
        self._is_known = False
        self._x = self._y = self._z = 0.0

    def take(self, now: float, sample: ArmSample) -> bool:
        """Record an arm's position at a time in s; return True if it is usable.

        An interruption before it ends the engagement: after a process was stopped, it receives the
        next positions before it checks for missing ones. A position farther away than an arm can
        move ends the engagement, too; the following positions are compared with it. A position
        that is not finite counts as missing.
        """
        x, y, z = sample.x, sample.y, sample.z
        span = (sample.stamp - self._stamp) * 1e-9
        span = span if span > HELD else HELD
        d_x, d_y, d_z = x - self._x, y - self._y, z - self._z
        if not self._is_known:
            span, d_x, d_y, d_z = HELD, x - x, y - y, z - z  # zero, or NaN
        way = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
        if not way <= FASTEST * span:  # or not finite
            reason = REFUSED.format(self.arm, x, y, z, way)
            self.refusal = f": {reason}"
            self.refused += 1
            if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
                return False
            self.interrupted = reason
        else:
            silence = now - self.received
            if silence > self.timeout:
                self.interrupted = f"no position of {self.arm} for {silence:.3g} s"
            self.received, self.refusal = now, ""
        self._is_known, self._stamp = True, sample.stamp
        self._x, self._y, self._z = x, y, z
        return way <= FASTEST * span


class CoupledForces:
    """Forces on the arms caused by their samples of a tick.

    Attributes
    ----------
    m_stamp, m_x, m_y, m_z : int, float
        Stamp of the slave's sample, ns, and the force on the master that it causes, N.
    s_stamp, s_x, s_y, s_z : int, float
        The same for the slave, and the master's sample that causes its force.
    on_master, on_slave : bool
        True if there is a force on the arm.
    """

    def __init__(self) -> None:
        self.m_stamp = self.s_stamp = 0
        self.m_x = self.m_y = self.m_z = self.s_x = self.s_y = self.s_z = 0.0
        self.on_master = self.on_slave = True

    @property
    def each(self) -> Iterator[tuple[int, int, Vector]]:
        """Indices of the arms in `ARMS`, stamps, ns, and forces, N."""
        if self.on_master:
            yield 0, self.m_stamp, (self.m_x, self.m_y, self.m_z)
        if self.on_slave:
            yield 1, self.s_stamp, (self.s_x, self.s_y, self.s_z)


class ArmCoupling:
    """Interface of the coupling of one host's arms, as `HostLoop` calls it.

    Attributes
    ----------
    engagement : Engagement
        Engagement of this host's arms.
    count_x, count_y, count_z : float
        Part of the newest force on the master that is caused by the encoders' rounding, N.
    passes_tools : bool
        True if the compensation receives the samples of this host's tool at once.
    forces : list of CoupledForces
        Forces that were computed since the list was cleared, when their objects are reused; the
        loop has passed on the first `passed` to the devices.
    """

    def __init__(self, engagement: Any) -> None:
        self.engagement: Any = engagement
        self.count_x = self.count_y = self.count_z = 0.0
        self.passes_tools = True
        self.forces: list[CoupledForces] = []
        self.passed = 0

    def begin(self, now: float, stamp: int) -> ArmSample | None:
        """Begin a tick at a time, s, and stamp, ns; return the tool sample to reproduce."""
        return None

    def put(self, sample: ArmSample, now: float) -> None:
        """Add a sample of an arm at a time in s."""

    def put_tool(self, sample: ArmSample) -> None:
        """Add a sample of this host's tool."""

    def is_due(self, now: float) -> bool:
        """Return True if the next `poll` is due."""
        return bool(self.engagement.due(now))

    def poll(self, now: float, listeners: int) -> Any:
        """Engage or release the arms if due; see `Engagement.missing` for the arguments."""
        raise NotImplementedError

    def couple(self) -> None:
        """Compute the forces caused by the samples, and add them to `forces`."""


class CouplingPart(ArmCoupling):
    """Engage both arms, and compute the forces of each tick from the samples of both.

    Parameters
    ----------
    coupling : PairCoupling
    engagement : Engagement
        Engagement of both arms.
    rate : float
        Samples per second of both arms.
    longest : int
        Maximum number of waiting samples of an arm.
    counted : bool
        True if the compensation in this process uses the force due to rounding, which is otherwise
        zero.

    Attributes
    ----------
    pairing : Pairing
        Samples of both arms that wait for each other.
    """

    def __init__(
        self,
        coupling: PairCoupling,
        engagement: Any,
        rate: float,
        longest: int = 1,
        *,
        counted: bool = True,
    ) -> None:
        ArmCoupling.__init__(self, engagement)
        self._coupling: PairCoupling = coupling
        self._counted: bool = counted
        self.pairing: Pairing = Pairing(rate, longest)
        self._on_master: CountObserver = CountObserver(rate)
        self._on_slave: CountObserver = CountObserver(rate)
        watches = [engagement.watches[arm] for arm in engagement.arms]
        self._master_watch: ArmWatch = watches[0]
        self._slave_watch: ArmWatch = watches[1]
        self._made: list[CoupledForces] = []
        self._engaging = False
        self._due: float = BEFORE_ALL

    @property
    def engaged(self) -> bool:
        """True while the arms are coupled."""
        return self._coupling.engaged

    def put(self, sample: ArmSample, now: float) -> None:
        """Add a sample of the arm that it specifies, at a time in s."""
        (self._slave_watch if sample.arm else self._master_watch).take(now, sample)
        self.pairing.put(sample)

    def is_due(self, now: float) -> bool:
        """Return True if the next `poll` is due."""
        master, slave = self._master_watch, self._slave_watch
        return now >= self._due or bool(master.interrupted or slave.interrupted)

    def poll(self, now: float, listeners: int) -> Any:
        """Couple the arms at their next samples, or uncouple them, if this is due.

        See `Engagement.missing` for the arguments.
        """
        decision = self.engagement.decide(now, listeners)
        self._due = now + STEP_PERIOD
        if decision.release:
            self._engaging = False
            self._coupling.disengage()
            self.count_x = self.count_y = self.count_z = 0.0
        if decision.engage:
            self._engaging = True
        return decision

    def couple(self) -> None:
        """Compute the forces of each tick with samples of both arms, while engaged."""
        pairing, coupling = self.pairing, self._coupling
        while pairing.advance():
            master: ArmSample = pairing.master
            slave: ArmSample = pairing.slave
            if self._engaging:
                self._engaging = False
                coupling.engage(master.position, slave.position)
                self._on_master.restart()
                self._on_slave.restart()
            if not coupling.engaged:
                continue
            if self._master_watch.interrupted or self._slave_watch.interrupted:
                continue
            coupling.couple(master, slave)
            if len(self.forces) == len(self._made):
                self._made.append(CoupledForces())
            forces: CoupledForces = self._made[len(self.forces)]
            self.forces.append(forces)
            forces.m_x, forces.m_y, forces.m_z = coupling.m_x, coupling.m_y, coupling.m_z
            forces.s_x, forces.s_y, forces.s_z = coupling.s_x, coupling.s_y, coupling.s_z
            # The sample of one arm causes the force on the other.
            forces.m_stamp, forces.s_stamp = slave.stamp, master.stamp
            if self._counted:
                on_master, on_slave = self._on_master, self._on_slave
                on_master.observe(master)
                on_slave.observe(slave)
                stiffness, scale = coupling.stiffness, coupling.scale
                self.count_x = stiffness * (on_slave.x / scale - on_master.x)
                self.count_y = stiffness * (on_slave.y / scale - on_master.y)
                self.count_z = stiffness * (on_slave.z / scale - on_master.z)
