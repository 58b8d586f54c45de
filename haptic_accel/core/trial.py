# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lockstep runs of the virtual rig: trials of the experiment, and identification."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from haptic_accel.core import model, topics
from haptic_accel.core.actuator import MasterSafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.control import filters
from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.control.controllers import granted_delay
from haptic_accel.core.control.error_bound import Bounds, bounds
from haptic_accel.core.evaluation import metrics
from haptic_accel.core.identification import sweep
from haptic_accel.core.model import FloatArray
from haptic_accel.core.network import ChannelParameters, Crossing, NetworkedLoops, provided
from haptic_accel.core.parameters import Checked, ParameterError, check_positive_rate, warn_once
from haptic_accel.core.rig import Rig, master_rig
from haptic_accel.core.rig.slave_rig import PHYSICS_STEP, SlaveRig, Vibrating
from haptic_accel.core.sampling import DEFAULT_RATE, LATENCY, NANOSECONDS, check_latency
from haptic_accel.core.simulated_rig import RigParameters, build_loop, build_parts, rig_side
from haptic_accel.core.surfaces.scene import Scene
from haptic_accel.core.surfaces.virtual_rig import VirtualRig
from haptic_accel.core.tick import ACTUATOR, CompensationPart, HostLoop
from haptic_accel.core.track import ReplayRig, Track

GripChange = tuple[float, model.HandleParameters | model.MountParameters]
"""Time of a change of the handle, s, and its new parameters with the grip, or the new mount."""


Warned = tuple[float, str]
"""Time of a warning, s, and its text."""

WARNING_CHECK_PERIOD = 0.05
"""Interval for checking the compensator's warnings, s."""


@dataclass(frozen=True)
class Trial:
    """Signals of one condition, with the same sampling times.

    The accelerations and the force have shape (n,) for a handle with one coil, and (n, 3) for one
    with three.

    Attributes
    ----------
    surface, controller : str
        Names of surface and controller.
    rate : float
        Samples per second.
    time : ndarray
        Sampling times, s.
    tool_acceleration : ndarray
        Acceleration measured by the slave's accelerometer, m/s^2.
    desired_acceleration : ndarray
        Acceleration of the slave after the compensator's high-pass, m/s^2.
    handle_acceleration : ndarray
        Acceleration measured by the master's accelerometer, m/s^2.
    actuator_force : ndarray
        Commanded force, N.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    latency : int
        Delay from sample to force, in samples.
    granted_delay : int
        Permitted delay of the handle in addition to the latency, in samples.
    warnings : tuple of (float, str)
        Warnings of the compensator with their times, s; an empty text marks their end.
    arms : dict of ndarray, shape (n, 3)
        Positions (m), velocities (m/s) and motor forces (N) of both arms, and the force of a scene
        on the tool, by topic name; empty if unknown.
    crossing : Crossing or None
        Counts and signals of a network between the arms. The tool's acceleration is then the
        slave's measurement at the played time. The desired acceleration is the result of a
        compensator without network.
    axes : Axes
        Axes of the accelerations and the force.
    failed : float or None
        Time at which `none` took over from a controller that had failed, s.
    """

    surface: str
    controller: str
    rate: float
    time: FloatArray
    tool_acceleration: FloatArray
    desired_acceleration: FloatArray
    handle_acceleration: FloatArray
    actuator_force: FloatArray
    high_pass_frequency: float = filters.HIGH_PASS_FREQUENCY
    latency: int = LATENCY
    granted_delay: int = 1
    warnings: tuple[Warned, ...] = ()
    arms: dict[str, FloatArray] = field(default_factory=dict)
    crossing: Crossing | None = None
    axes: Axes = ACTUATOR_AXES
    failed: float | None = None

    @property
    def actual_acceleration(self) -> FloatArray:
        """Handle's acceleration without gravity and the hand's own motion, m/s^2.

        Only these two are removed, as they must not count as error. A handle that moves exactly as
        desired has no error.
        """
        corner, rate = self.high_pass_frequency, self.rate
        return filters.without_hand_motion(self.handle_acceleration, corner, rate)

    @property
    def after(self) -> int:
        """Delay between a desired acceleration and the compared response, in samples.

        A force appears at the earliest one sample after it takes effect (the paper's tau_d).
        """
        return self.latency + self.granted_delay

    @property
    def seconds(self) -> float:
        """Duration of the trial, s."""
        return len(self.time) / self.rate

    def evaluate(self, first: int = 0, end: int | None = None) -> metrics.Evaluation:
        """Return the paper's metrics from a sample to an end, after latency and granted delay.

        Raises
        ------
        ValueError
            The desired acceleration is zero, or there are too few samples.
        """
        return metrics.evaluate(*self.compared(first, end), self.rate, delay=0.0)

    def indistinguishable(self, first: int = 0, end: int | None = None) -> float:
        """Return the share of indistinguishable cells from a sample to an end; NaN without any.

        Raises
        ------
        ValueError
            There are too few samples.
        """
        return metrics.indistinguishable(*self.compared(first, end), self.rate)

    def compared(self, first: int = 0, end: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Return desired and actual acceleration, aligned after latency and granted delay, m/s^2.

        Raises
        ------
        ValueError
            There are too few samples.
        """
        desired, actual = metrics.aligned(
            *(self.desired_acceleration, self.handle_acceleration),
            *(self.high_pass_frequency, self.rate, self.after / self.rate),
        )
        part = slice(first, None if end is None else end - self.after)
        return desired[part], actual[part]

    def bounds(self, rig: RigParameters, handle: model.HandleParameters, first: int = 0) -> Bounds:
        """Return the error bounds from a sample on, for a handle on a rig."""
        master = rig.master
        return bounds(
            rig.plant(handle),
            self.rate,
            self.tool_acceleration[first:],
            granted_delay=self.granted_delay,
            noise=master.accelerometer.noise,
            high_pass_frequency=self.high_pass_frequency,
            actuator=master.actuator,
        )


def run_trial(
    controller: str = "dynamic",
    rig: RigParameters | None = None,
    *,
    duration: float = 10.0,
    rate: float = DEFAULT_RATE,
    latency: int = LATENCY,
    seed: int = 0,
    recording: FloatArray | None = None,
    replayed: Track | None = None,
    scene: Scene | None = None,
    texture: Vibrating | None = None,
    compensation: CompensationParameters | None = None,
    controllers: Mapping[str, Checked] | None = None,
    grips: Sequence[GripChange] = (),
    physics_step: float = PHYSICS_STEP,
    channel: ChannelParameters | None = None,
    law: str = "passive",
    blackouts: Sequence[tuple[float, float]] = (),
    composed: bool = True,
) -> Trial:
    """Run one condition in lockstep, without clock or thread, with reproducible results.

    In each sample both rigs are read, coupling and compensation are computed, and the forces from
    `latency` samples before take effect. The response appears one sample later (the paper's
    tau_d). The compensation receives the handle's acceleration of the previous sample, as in the
    live graph without late forces. The rigs are at rest until their first force.

    Parameters
    ----------
    controller : str
        Name of a controller.
    rig : RigParameters, optional
        Parameters of the rig; default: Table I and a smooth surface.
    duration : float
        Duration of the trial, s.
    rate : float
        Samples per second.
    latency : int
        Delay from sample to force, in samples; 0 for none, as in the paper.
    seed : int
        Seed of texture and sensor noise.
    recording : ndarray, optional
        Tool acceleration at `rate`, m/s^2, which replaces the simulated one.
    replayed : Track, optional
        Tool acceleration and motion at `rate`, which replace the simulated slave. They are played
        from the sample after the first force; until then the slave rests at their start.
    scene : Scene, optional
        Scene for the virtual slave, which replaces the simulated slave's surface.
    texture : callable, optional
        Acceleration to add to that of the simulated surface, as for `SlaveRig`.
    compensation : CompensationParameters, optional
        Parameters of high-pass and sensor range; its controller is replaced by `controller`.
    controllers : mapping, optional
        Parameters of controllers, and of the actuator's limits, by name.
    grips : sequence of GripChange
        Changes of grip or mount in order of time; until the first, those of the rig.
    physics_step : float
        Maximum integration step of the contact, s.
    channel : ChannelParameters, optional
        Network between the arms, in both directions; default: both on one host.
    law : str
        Law of the passive coupling, as in `PassiveParameters`.
    blackouts : sequence of (float, float)
        Start and end of each blackout, s, in which the network loses all packets.
    composed : bool
        As for `build_loop`.

    Returns
    -------
    Trial

    Raises
    ------
    ParameterError
        The controller is unknown, or the rate, latency or duration is invalid.
    """
    if replayed is not None and replayed.rate != rate:
        raise ParameterError(f"rate = {rate:g}: must be {replayed.rate:g} Hz as replayed")
    check_positive_rate(rate)
    check_latency(latency)
    if not (np.isfinite(duration) and duration * rate >= 1):
        raise ParameterError(f"duration = {duration}: must hold at least one sample")
    rig = rig or RigParameters()
    axes = master_rig.axes_of(rig.master)
    settings = replace(compensation or CompensationParameters(), controller=controller)
    tool_axes = Axes.parsed((rig.virtual if scene else rig.slave).tool.axes)
    slave: Rig
    if replayed is not None:
        slave = ReplayRig(replayed)
    elif scene is not None:
        slave = VirtualRig(rig.virtual, scene, rate, seed)
    else:
        slave = SlaveRig(rig.slave, rate, seed, recording, physics_step, texture)
    time = np.arange(round(duration * rate)) / rate
    warnings: list[Warned] = []
    rigs = master_rig.simulated_master(rig.master, rate, seed), slave
    devices = dict(zip(topics.ARMS, rigs, strict=True))
    sides, part = build_parts(rig, devices, settings, controllers or {}, rate, latency)
    hosts: HostLoop | NetworkedLoops
    if channel is None:
        hosts = build_loop(rig, sides, part, composed=composed)
    else:
        coupling = rig.passive(law)
        hosts = provided("loops")(coupling, channel, sides, part, seed, blackouts, tool_axes)
    rows = np.zeros((len(time), _SIGNALS + isinstance(slave, VirtualRig), 3))
    _run(rigs, hosts, part, time.tolist(), deque(grips), warnings, rows)
    vectors = rows.swapaxes(0, 1)
    handle, tool, desired, force = (axes.signals(vectors[each]) for each in (0, 4, 8, 9))
    moved = [*vectors[1:4], *vectors[5:8], *vectors[_SIGNALS:]]
    by_topic = dict(zip(_MOVED, moved, strict=False))
    surface = scene.name if scene else rig.slave.surface.name
    corner = settings.high_pass_frequency
    crossing = None
    if not isinstance(hosts, HostLoop):
        crossing, tool = hosts.crossing(tool, axes)
        desired = filters.high_passed(tool, corner, rate)
    return Trial(
        *(surface, controller, rate, time, tool, desired, handle, force, corner, latency),
        granted_delay(controller, controllers or {}, rate),
        tuple(warnings),
        by_topic,
        crossing,
        axes,
        _failed(part.slow.failure, warnings, duration),
    )


def _failed(reason: str, warnings: Sequence[Warned], duration: float) -> float | None:
    """Log the reason why `none` took over; return the time, s, or None if it did not."""
    if not reason:
        return None
    warn_once(reason)
    return next((time for time, message in warnings if reason in message), duration)


_SIGNALS = 10
"""Number of vectors of `HostLoop.record`."""


_MOVED = [
    topic.name
    for arm in (topics.MASTER, topics.SLAVE)
    for topic in (arm.position, arm.velocity, arm.arm_force)
] + [topics.CONTACT_FORCE.name]


def _run(
    rigs: tuple[master_rig.MasterRig | master_rig.ThreeAxisRig, Rig],
    hosts: HostLoop | NetworkedLoops,
    part: CompensationPart,
    times: Sequence[float],
    grips: deque[GripChange],
    warnings: list[Warned],
    rows: FloatArray,
) -> None:
    """Write the signals of each sample in the order of `HostLoop.record`, then a contact's force.

    Appends to `warnings` when the compensator's warning changes.
    """
    master, slave = rigs
    loops = [hosts] if isinstance(hosts, HostLoop) else list(hosts.loops.values())
    touching = slave if isinstance(slave, VirtualRig) else None
    looked, words = 0.0, ""
    for loop in loops:
        loop.record(rows)
    for tick, time in enumerate(times):
        if grips and grips[0][0] <= time:
            master.advance(time)
            _, changed = grips.popleft()
            if isinstance(changed, model.MountParameters):
                master.change_mount(changed)
            else:
                master.change_grip(changed)
        hosts.step(tick)
        if touching:
            rows[tick, -1] = touching.contact_force or model.ZERO
        if time >= looked + WARNING_CHECK_PERIOD:
            looked, now = time, part.slow.warning
            if now != words:
                words = now
                warnings.append((time, words))


def run_identification(
    rig: master_rig.MasterRigParameters | None = None,
    parameters: sweep.SweepParameters | None = None,
    rate: float = DEFAULT_RATE,
    seed: int = 0,
    trials: int = 1,
    latency: int = LATENCY,
) -> list[sweep.IdentificationTrial]:
    """Excite the simulated handle in lockstep, without clock, with reproducible results.

    In each sample the rig is read, and the force from `latency` samples before is applied, limited
    by the device's safety layer. It acts until the next sample, so that the acceleration shows it
    at the earliest one sample later. Arm and hand do not move.

    Parameters
    ----------
    rig : MasterRigParameters, optional
        Parameters of the simulated master; default: Table I.
    parameters : SweepParameters, optional
        Parameters of the sweep; default: those of the paper.
    rate : float
        Samples per second.
    seed : int
        Seed of the noise; each trial derives its own.
    trials : int
        Number of trials, each from rest.
    latency : int
        Delay from sample to force, in samples.

    Returns
    -------
    list of IdentificationTrial

    Raises
    ------
    ParameterError
        The number of trials is below 1, the latency is invalid, or the end frequency is not below
        half the rate.
    """
    if trials < 1:
        raise ParameterError(f"trials = {trials}: must be at least 1")
    check_latency(latency)
    rig = rig or master_rig.MasterRigParameters()
    axes = master_rig.axes_of(rig)
    exciting = sweep.trial_forces(axes, parameters or sweep.SweepParameters(), rate)
    force = np.squeeze(np.concatenate([exciting, np.zeros((latency, len(axes.names)))]))
    # Trials of adjacent seeds have different noise.
    seeds = [np.random.SeedSequence((seed, index)).generate_state(1)[0] for index in range(trials)]
    return [_excite(rig, int(each), force, rate, latency) for each in seeds]


def master_response(
    rig: master_rig.MasterRigParameters,
    frequency: npt.ArrayLike,
    rate: float,
    delay: float | None = None,
) -> model.ComplexArray:
    """Return the true response of a simulated master with three coils, m/s^2 per N, (f, 3, 3).

    Parameters
    ----------
    rig : MasterRigParameters
    frequency : array_like, shape (f,)
        Hz.
    rate : float
        Samples per second.
    delay : float, optional
        Delay of the drive instead of the rig's own, s.
    """
    if delay is not None:
        rig = replace(rig, drive=replace(rig.drive, delay=delay))
    master = master_rig.simulated_master(rig, rate)
    assert isinstance(master, master_rig.ThreeAxisRig)
    return master.response(frequency, rate)


def _excite(
    rig: master_rig.MasterRigParameters, seed: int, force: FloatArray, rate: float, latency: int
) -> sweep.IdentificationTrial:
    master, axes = master_rig.simulated_master(rig, rate, seed), master_rig.axes_of(rig)
    limits = MasterSafetyParameters(hardware=rig.actuator)
    side = rig_side(master, limits, rate, latency, (ACTUATOR,), axes)
    acceleration = np.zeros((len(force), 3))
    for tick, exciting in enumerate(force.reshape(len(force), -1).tolist()):
        side.begin(tick)
        side.read()
        acceleration[tick] = side.samples[0].acceleration
        side.command(ACTUATOR, tick * NANOSECONDS / rate, *axes.vector(exciting))
        side.apply()
        side.watch()
    values: dict[str, str | int] = {**master.counters(), **side.safety.diagnostics()}
    counts = {key: int(values[key]) for key in (*master.counters(), *sweep.LIMITED)}
    return sweep.IdentificationTrial(rate, force, axes.signals(acceleration), counts, latency)
