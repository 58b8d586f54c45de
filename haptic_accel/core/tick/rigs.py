# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated arms, sample by sample: handle in a hand, tip on a surface, instruments.

`core/rig` builds these objects from parameters, and changes them in operation.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from haptic_accel.core.tick.guard import TO_WHOLE
from haptic_accel.core.tick.kernels import add_scaled, product
from haptic_accel.core.tick.samples import ArmSample, TimedForce

if TYPE_CHECKING:
    from collections.abc import Callable

    from haptic_accel.core.model import AccelerometerParameters, FloatArray
    from haptic_accel.core.tick.kernels import FloatMatrix

NOISE_BLOCK: int = 4096
"""Number of samples of noise drawn together, as one call per sample would take longer."""

LONGEST_ADVANCE: float = 0.1
"""Maximum time simulated in one call, s; the rig is paused for the rest of a longer stall."""

RETURN_AFTER: float = 0.2
"""Time without force and without commands after which an arm returns to its start, s. It is longer
than the coupler needs to release both arms when one stops sending."""

RESOLUTION: float = 10e-6
"""Maximum step of a rig's clock, s."""

NEVER: float = -1.0
"""Value of `silence` for an arm without commands since its release."""


# Instruments


class Quantizer:
    """Converter with a symmetric range: rounding to steps, and saturation.

    Attributes
    ----------
    saturated : int
        Number of values beyond the range.
    """

    def __init__(self, full_scale: float, bits: int) -> None:
        self.full_scale: float = full_scale
        self.step: float = 2.0 * full_scale / 2.0**bits
        self.saturated = 0

    def convert(self, value: float) -> float:
        """Return the value after conversion."""
        if value > self.full_scale or value < -self.full_scale:
            self.saturated += 1
            return math.copysign(self.full_scale, value)
        return ((value / self.step + TO_WHOLE) - TO_WHOLE) * self.step if self.step else 0.0


class Accelerometer(Quantizer):
    """Accelerometer with noise, range and quantisation; its low-pass is part of the mechanics.

    Parameters
    ----------
    parameters : AccelerometerParameters
    seed : int
        Seed of the noise.
    stream : int
        Number of the random stream; accelerometers with equal seed and different streams have
        independent noise.
    """

    def __init__(self, parameters: AccelerometerParameters, seed: int, stream: int = 0) -> None:
        from numpy.random import default_rng

        super().__init__(parameters.range, parameters.bits)
        self.deviation: float = parameters.noise
        self.random: Any = default_rng((seed, stream))
        self.noise: list[float] = []

    def measure(self, low_passed: float, noisy: bool = True) -> float:
        """Return a sample for an acceleration after the sensor's low-pass, m/s^2."""
        if noisy:
            if not self.noise:
                self.noise = self.random.normal(0.0, self.deviation, NOISE_BLOCK).tolist()
            low_passed += float(self.noise.pop())
        return self.convert(low_passed)


def encoded(value: float, step: float) -> float:
    """Return a value rounded to the nearest multiple of a step, or unchanged for a step of 0."""
    return ((value / step + TO_WHOLE) - TO_WHOLE) * step if step else value


def limited(force: float, most: float) -> float:
    """Return a motor force along one axis, limited to a maximum, N; zero for NaN."""
    if math.fabs(force) <= most:
        return force
    return 0.0 if math.isnan(force) else math.copysign(most, force)


def scalars(array: Any) -> Any:
    """Return a view of an array whose items are plain floats, which are read faster."""
    return memoryview(array)


# Arms


class SimulatedArm:
    """One side of the virtual rig: its time, and forces that are not due yet.

    The arm is at rest until its first force: any force of its motors, even zero, or a non-zero
    force of the actuator. Until then all samples are equal, without noise. Later samples are thus
    independent of the waiting time. An arm whose motors receive a zero force and then no command
    for `RETURN_AFTER` returns to its start, so that all engagements begin there. A coupling with
    zero force repeats its commands, and thus prevents the return.

    Times are in s on the caller's clock, and begin with the first sample or force. Forces may be
    passed before the samples that precede them are taken.

    Attributes
    ----------
    reading : ArmSample
        Newest sample, in an object that the loop provides and reuses.
    contact_x, contact_y, contact_z : float
        Force of a surface on the tool, N, at the last `feel`.
    """

    def __init__(self) -> None:
        self.reading: ArmSample = ArmSample()
        self.contact_x = self.contact_y = self.contact_z = 0.0
        self.started = False
        self.free = True
        self.silence: float = NEVER
        self.origin = self.elapsed = self.last = 0.0
        self.placed = self.sampled = False
        self.waiting: list[TimedForce] = []

    # Interface of the loop

    def measure(self, time: float) -> None:
        """Advance to a time with the forces due before, and take the sample."""
        while self.waiting:
            due: TimedForce = self.waiting[0]
            if due.time >= time:
                break
            del self.waiting[0]
            self.reach(due.time)
            if due.on_arm:
                self.pull(due.x, due.y, due.z)
            else:
                self.push(due.x, due.y, due.z)
        self.sampled, self.last = True, time
        self.reach(time)
        self.observe()

    def drive_at(self, time: float, on_arm: bool, x: float, y: float, z: float) -> None:
        """Set the force of motors or coils from a time on, N; discard later forces set before."""
        # Most forces act at the time of the newest sample.
        if (self.waiting or time != self.last or not self.sampled) and self.waits(time):
            self.waiting.append(TimedForce(time, on_arm, x, y, z))
        elif on_arm:
            self.pull(x, y, z)
        else:
            self.push(x, y, z)

    def feel(self) -> bool:
        """Compute the force of a surface on the tool; return False if it is unknown."""
        return False

    def waits(self, time: float) -> bool:
        """Return True if a force waits for preceding samples; otherwise advance to its time."""
        if self.sampled:
            while self.waiting:
                newest: TimedForce = self.waiting[len(self.waiting) - 1]
                if newest.time <= time:
                    return True
                self.waiting.pop()
            if time >= self.last:
                return time > self.last
        self.reach(time)
        return False

    def restart(self) -> None:
        """Discard the waiting forces; the time continues with the next sample or force."""
        self.placed = self.sampled = False
        self.waiting.clear()

    def reach(self, time: float) -> None:
        """Advance to a time of the caller's clock."""
        if not self.placed:
            self.placed = True
            self.origin = time - self.elapsed
        self.elapsed = time - self.origin
        self.advance(self.elapsed)

    # Motion, by kind of arm

    def advance(self, time: float) -> None:
        """Integrate the physics up to a time since the start; past times are ignored."""

    def observe(self) -> None:
        """Take the readings of encoders and accelerometer."""

    def pull(self, x: float, y: float, z: float) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""

    def push(self, x: float, y: float, z: float) -> None:
        """Set the forces of the actuator's coils along x, y, z of the handle, N."""

    def release(self) -> None:
        """Set all forces to zero."""
        if self.started:
            self.pull(0.0, 0.0, 0.0)

    def let_go(self, seconds: float) -> bool:
        """Count elapsed time; return True, once, when the arm has been released."""
        if self.silence == NEVER:
            return False
        self.silence += seconds
        if self.free and self.silence > RETURN_AFTER:
            self.silence = NEVER
            return True
        return False


# Hand that guides the handle

HAND_REACH: tuple[tuple[float, float], tuple[float, float]] = ((-0.15, 0.15), (-0.02, 0.08))
"""Workspace of a guided hand along the surface (x) and its normal (z), m. At 13 mm below the
surface, the coupling's stiffness of 250 N/m causes the arms' maximum force."""

HAND_SPEED: float = 1.0
"""Maximum speed of a guided hand, m/s: ten strokes of 0.1 m per second."""

HAND_STEP: float = 1e-3
"""Step of a scripted hand's table, between whose entries the velocity is linear, and maximum step
within which a guided hand's acceleration is constant, s."""

HAND_LAG: float = 7e-3
"""Time constant of each of the four lags behind the points, s. The total is 28 ms. At 60 Hz, a
usual rate of points, the lags attenuate each new point's correction to 1/64."""

HAND_CORRECTION: float = 0.6
HAND_ACCELERATION: float = 0.3
"""Gains of a point's deviation from its expected position, for the corrections of position and,
divided by the time between points, of velocity (alpha-beta filter)."""

HAND_EXPECTED: float = 0.05
"""Time after a point for which the motion is extrapolated, s: three frames of a screen."""


LONG_AGO: float = -1e300
"""Time of the last point of a hand that was never guided, s."""


class Hand:
    """Desired position of the handle along the surface (x) and its normal (z).

    Attributes
    ----------
    x, z : float
        Position, m.
    v_x, v_z : float
        Velocity, m/s.
    """

    def __init__(self) -> None:
        self.x = self.z = self.v_x = self.v_z = 0.0

    def lead(self, time: float) -> None:
        """Move to the position at a time, s; at rest at 0."""


class ScriptedHand(Hand):
    """Hand that repeats a table of motion.

    Parameters
    ----------
    table : list of float
        x, z, v_x, v_z at multiples of `HAND_STEP`, one after the other; the last repeats the
        first.
    """

    def __init__(self, table: list[float]) -> None:
        super().__init__()
        self.table: list[float] = table
        self.last: int = len(table) // 4 - 1

    def lead(self, time: float) -> None:
        """Move to the position at a time, s; at rest before 0."""
        position = max(0.0, time / HAND_STEP) % self.last
        index: int = int(position)
        part, at = position - index, 4 * index
        table: list[float] = self.table
        x, z, v_x, v_z = table[at], table[at + 1], table[at + 2], table[at + 3]
        dv_x, dv_z = table[at + 6], table[at + 7]
        dv_x, dv_z = (dv_x - v_x) * part, (dv_z - v_z) * part
        # The position is the velocity's exact integral, as required by mechanics with piecewise
        # constant acceleration of the hand.
        passed = part * HAND_STEP
        self.x = x + (v_x + dv_x / 2.0) * passed
        self.z = z + (v_z + dv_z / 2.0) * passed
        self.v_x, self.v_z = v_x + dv_x, v_z + dv_z


class GuidedHand(Hand):
    """Hand that follows points smoothly.

    Between two points the motion is extrapolated with the last velocity, so that points at the
    rate of a screen cause no steps. Four lags keep the residual below the tactile band. The
    velocity is linear within a step, and the position is its exact integral.

    Parameters
    ----------
    height : float
        Height of the hand at rest, m.
    """

    def __init__(self, height: float) -> None:
        super().__init__()
        self.height, self.time, self.pointed = height, 0.0, LONG_AGO
        self.along: GuidedAxis = GuidedAxis(0.0, HAND_REACH[0][0], HAND_REACH[0][1])
        self.normal: GuidedAxis = GuidedAxis(height, HAND_REACH[1][0], HAND_REACH[1][1])
        self.note()

    def rest(self) -> None:
        """Return to the start."""
        self.time, self.pointed = 0.0, LONG_AGO
        self.along.put(0.0)
        self.normal.put(self.height)
        self.note()

    def point(self, x: float, z: float) -> None:
        """Guide the hand to a point, m, or to the nearest one within `HAND_REACH`.

        A point that is not finite is ignored.
        """
        if math.isfinite(x) and math.isfinite(z):
            passed = max(HAND_STEP, self.time - self.pointed)
            self.pointed = self.time
            self.along.expect(x, passed)
            self.normal.expect(z, passed)

    def lead(self, time: float) -> None:
        """Move to a time, s; it must not decrease, except to 0, where the hand is at rest."""
        if time < self.time:
            self.rest()
        left: int = -math.floor(1e-6 - (time - self.time) / HAND_STEP)
        while left > 0:
            step = (time - self.time) / left
            going_on: bool = self.time - self.pointed < HAND_EXPECTED
            self.along.advance(step, going_on)
            self.normal.advance(step, going_on)
            self.time += step
            left -= 1
        self.time = time
        self.note()

    def note(self) -> None:
        """Copy the motion of both axes."""
        self.x, self.z = self.along.position, self.normal.position
        self.v_x, self.v_z = self.along.velocity, self.normal.velocity


class GuidedAxis:
    """One axis of a guided hand."""

    def __init__(self, coordinate: float, low: float, high: float) -> None:
        self.low, self.high = low, high
        self.position = self.velocity = self.goal = self.pace = self.lag = self.second_lag = 0.0
        self.put(coordinate)

    def put(self, coordinate: float) -> None:
        """Set the axis to rest at a coordinate, m."""
        self.position = self.goal = self.lag = self.second_lag = coordinate
        self.velocity = self.pace = 0.0

    def expect(self, coordinate: float, passed: float) -> None:
        """Correct goal and velocity by a point that follows the previous one after a time, s."""
        if passed > HAND_EXPECTED:  # the point was released meanwhile
            passed, self.pace = HAND_EXPECTED, 0.0
        coordinate = min(self.high, max(self.low, coordinate))
        farthest = HAND_SPEED * passed
        deviation = min(farthest, max(-farthest, coordinate - self.goal))
        self.goal += HAND_CORRECTION * deviation
        pace = self.pace + HAND_ACCELERATION * deviation / passed
        self.pace = min(HAND_SPEED, max(-HAND_SPEED, pace))

    def advance(self, step: float, going_on: bool) -> None:
        """Move for a step in s."""
        if going_on:
            self.goal = min(self.high, max(self.low, self.goal + self.pace * step))
        self.lag += (self.goal - self.lag) * step / HAND_LAG
        self.second_lag += (self.lag - self.second_lag) * step / HAND_LAG
        # The last two lags as a second-order system, with constant acceleration over the step.
        bent = (self.second_lag - self.position) / HAND_LAG - 2.0 * self.velocity
        acceleration = bent / HAND_LAG
        self.position += (self.velocity + acceleration * step / 2.0) * step
        self.velocity += acceleration * step


# The handle

STOP_STEPS: int = 5
"""Steps between updates of a nearby travel stop's force (50 us)."""

FRICTION_SWEEPS: int = 3
"""Sweeps over the coils for their dry friction; each reduces the error to a tenth or less, as a
coil's friction moves another one through the handle by less than a tenth of its own."""


class HandleCoil:
    """Coil in the handle: its converter, the accelerometer along its axis, and travel stops.

    Parameters
    ----------
    limits : ActuatorParameters
        Peak force, and free travel either way.
    drive : DriveParameters
    step : float
        Step of the rig's clock, s.
    accelerometer : Accelerometer

    Attributes
    ----------
    offset : float
        Displacement between the stops before the last move, m.
    hits : int
        Number of contacts with the stops.
    """

    def __init__(self, limits: Any, drive: Any, step: float, accelerometer: Accelerometer) -> None:
        self.converter: Quantizer = Quantizer(limits.peak_force, drive.bits)
        self.accelerometer: Accelerometer = accelerometer
        self.travel: float = limits.travel
        self.stiffness: float = drive.stop_stiffness
        self.damping: float = drive.stop_damping
        self.step, self.offset, self.touching, self.hits = step, 0.0, False, 0

    def near(self, offset: float, slip: float, steps: int) -> bool:
        """Return True if the coil may touch the stop within a number of steps."""
        if self.touching:
            return True
        return math.fabs(offset) + 2.0 * math.fabs(slip) * steps * self.step > self.travel / 2.0

    def force(self, offset: float, slip: float) -> float:
        """Return the force of the stops on the coil, N, constant for `STOP_STEPS` steps."""
        overrun = math.fabs(offset) - self.travel
        before: bool = self.touching
        self.touching = overrun > 0.0
        if not self.touching:
            return 0.0
        if not before:
            self.hits += 1
        outward = math.copysign(1.0, offset) * slip
        # The force is constant for several steps. Its mid-time value returns no more energy than
        # was stored.
        held = STOP_STEPS * self.step
        push = self.stiffness * (overrun + outward * held / 2.0) + self.damping * outward
        return -math.copysign(max(0.0, push), offset)


class HeldArm(SimulatedArm):
    """Handle with linear mechanics in a hand that guides it.

    The system x' = A x + B u is linear between commands and advanced exactly, except for travel
    stops and dry friction. The force of a nearby stop is updated every 50 us. Friction is constant
    for at most one sample and follows the mean slip. Everything is at rest until the first force.
    The hand rests until the arm's first force (engagement), then starts to explore. A released arm
    returns to its start, and the hand starts again with the next force.

    Parameters
    ----------
    parameters : HeldRigParameters
    rate : float
        Sampling rate, Hz.
    hand : Hand
    accelerometers : list of Accelerometer
        Accelerometer along the axis of each coil.
    states, inputs : int
        Numbers of states, n, and inputs, m, of the mechanics.

    Attributes
    ----------
    joint : ndarray, shape (n + m,)
        States, then inputs.
    transitions : ndarray, shape (longest (n + m), n)
        Columns of the transitions over 1, 2, ... steps, one below the other.
    resting : ndarray, shape (n,)
        States at rest at the start.
    friction : float
        Dry friction of a coil's bearing, N.
    friction_steps : int
        Maximum number of steps with constant friction.
    rubbed : ndarray, shape (longest coils, n)
        States after 1, 2, ... steps of unit friction, one row for each coil.
    travels : list of float
        Travel of each coil for each of these rows, m.
    """

    def __init__(
        self,
        parameters: Any,
        rate: float,
        hand: Hand,
        accelerometers: list[Accelerometer],
        states: int,
        inputs: int,
    ) -> None:
        import numpy as np

        super().__init__()
        drive, arm = parameters.drive, parameters.arm
        step: float = clock_step(rate)
        self.coils: list[HandleCoil] = [
            HandleCoil(parameters.actuator, drive, step, each) for each in accelerometers
        ]
        longest: int = min(round(1.0 / rate / step), round(HAND_STEP / step))
        self.joint: Any = np.zeros(states + inputs)
        self.state: FloatArray = self.joint[:states]
        self.factors: FloatMatrix = self.joint[:, np.newaxis]
        self.products: FloatMatrix = np.empty((states + inputs, states))
        self.scaled: FloatArray = np.empty(states)
        self.transitions: FloatMatrix = self.products
        self.resting: FloatArray = self.scaled
        self.rubbed: FloatMatrix = self.products
        self.travels: list[float] = []
        self.friction = self.creep = self.force_scale = self.max_force = self.resolution = 0.0
        self.friction, self.creep = drive.coulomb_friction, drive.slip_velocity
        self.force_scale = drive.force_scale
        self.max_force, self.resolution = arm.max_force, arm.position_resolution
        self.gravity: float = parameters.grip.gravity
        self.step, self.longest = step, longest
        self.stall: int = round(LONGEST_ADVANCE / step)
        self.friction_steps: int = longest
        self.delay: int = round(drive.delay / step)
        self.delayed: list[TimedForce] = []
        self.now, self.exploring = 0, False
        self.since = 0  # step at which the hand began to explore
        self.hand_until = 0  # end of the hand's present acceleration
        self.hand_steps = 0  # steps since then up to which the hand has moved
        self.hand: Hand = hand
        self.hand_motion: FloatArray = self.scaled
        self.hand_acceleration: FloatArray = self.scaled
        hand.lead(0.0)

    def advance(self, time: float) -> None:
        """Integrate the physics up to a time since the start; past times are ignored."""
        step = self.step
        due: int = int((time / step + TO_WHOLE) - TO_WHOLE - self.now)
        longest: int = self.stall if self.started else 0
        if due > longest:
            self.now, self.since = self.now + due - longest, self.since + due - longest
            due = longest
        gone: bool = self.let_go(due * step if due > 0 else 0.0)
        while due > 0:
            now: int = self.now
            if self.delayed:
                self.act_delayed()
            if now >= self.hand_until:
                self.lead_hand()
            steps: int = min(due, self.hand_until - now, self.friction_steps)
            if self.delayed:
                until: int = int(self.delayed[0].time)
                steps = min(steps, max(1, until - now))
            steps = self.move(steps)
            self.now = now + steps
            due -= steps
        if self.delayed:
            self.act_delayed()
        if gone:
            self.return_to_start()

    def pull(self, x: float, y: float, z: float) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        if not self.exploring:
            self.started = self.exploring = True
            self.since = self.hand_until = self.now
        most = self.max_force
        if not (-most <= x <= most and -most <= y <= most and -most <= z <= most):
            x, y, z = limited(x, most), limited(y, most), limited(z, most)
        self.free = not self.load(x, y, z)
        self.silence = 0.0

    def release(self) -> None:
        """Set all forces to zero."""
        self.delayed.clear()
        self.act(0.0, 0.0, 0.0)
        self.load(0.0, 0.0, 0.0)
        self.free, self.silence = True, 0.0

    def drive(self, converter: Quantizer, force: float) -> float:
        """Return the force of a coil for a command, N, rounded and limited; 0 for NaN."""
        converted = converter.convert(0.0 if math.isnan(force) else force)
        self.started = self.started or converted != 0.0
        return self.force_scale * converted

    def command(self, x: float, y: float, z: float) -> None:
        """Apply the forces of the coils after their delay."""
        if self.delay:
            self.delayed.append(TimedForce(float(self.now + self.delay), False, x, y, z))
        else:
            self.act(x, y, z)

    def act_delayed(self) -> None:
        """Apply the commands whose delay has passed."""
        while self.delayed:
            first: TimedForce = self.delayed[0]
            if first.time > self.now:
                return
            del self.delayed[0]
            self.act(first.x, first.y, first.z)

    def return_to_start(self) -> None:
        """Set hand and handle to rest at their initial position."""
        self.exploring, self.hand_until = False, self.now
        self.place_hand(self.now)
        self.state[:] = self.resting

    def lead_hand(self) -> None:
        """Set the hand's motion for at most one step of its table."""
        hand: Hand = self.hand
        self.hand_until = self.now + self.longest
        self.place_hand(self.now)
        v_x, v_z = hand.v_x, hand.v_z
        motion: FloatArray = self.hand_motion
        motion[0], motion[1], motion[2], motion[3] = hand.x, hand.z, v_x, v_z
        self.place_hand(self.hand_until)
        duration = self.longest * self.step
        motion = self.hand_acceleration
        motion[0], motion[1] = (hand.v_x - v_x) / duration, (hand.v_z - v_z) / duration

    def place_hand(self, now: int) -> None:
        """Move the hand to its position at a step of the clock."""
        steps: int = now - self.since if self.exploring else 0
        if steps != self.hand_steps:
            self.hand_steps = steps
            self.hand.lead(steps * self.step)

    # Mechanics, by number of coils

    def move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""
        return steps

    def load(self, x: float, y: float, z: float) -> bool:
        """Set the inputs of the arm's force, N; return True if one is not zero."""
        return False

    def act(self, x: float, y: float, z: float) -> None:
        """Set the inputs of the coils' forces, N."""


class OneCoil(HeldArm):
    """Handle with one coil along z, whose mechanics are those of `handle.mechanics`."""

    def __init__(
        self, parameters: Any, rate: float, hand: Hand, accelerometers: list[Accelerometer]
    ) -> None:
        from haptic_accel.core.handle import mechanics as order

        states = order.STATES + 2 * bool(parameters.second.frequency)
        super().__init__(parameters, rate, hand, accelerometers, states, order.INPUTS)
        self.coil: HandleCoil = self.coils[0]
        inputs = self.joint[states:]
        self.hand_motion = scalars(self.joint[order.X_U : order.V_U + 1])
        self.hand_acceleration = scalars(inputs[order.AX_U : order.A_U + 1])
        self.ends: FloatArray = scalars(self.joint[order.ACTUATOR_AND_HANDLE])
        self.sensed: FloatArray = scalars(self.joint[order.MEASURED : order.VX_H + 1])
        self.coil_force: FloatArray = scalars(inputs[order.F_A : order.F_A + 1])
        self.arm_force: FloatArray = scalars(inputs[order.F_Z : order.F_X + 1])
        self.between: FloatArray = scalars(inputs[order.F_BETWEEN : order.F_BETWEEN + 1])

    def observe(self) -> None:
        """Take the readings of encoders and accelerometer."""
        reading: ArmSample = self.reading
        resolution = self.resolution
        reading.x = encoded(self.sensed[1], resolution)
        reading.z = encoded(self.ends[2], resolution)
        reading.v_x, reading.v_z = self.sensed[2], self.ends[3]
        # The sensor is held against gravity, which it measures as an upward acceleration.
        low_passed = self.sensed[0] + self.gravity
        reading.a_z = self.coil.accelerometer.measure(low_passed, self.started)

    def push(self, x: float, y: float, z: float) -> None:
        """Set the coil's force, N, rounded and limited by its converter; zero for NaN."""
        self.command(0.0, 0.0, self.drive(self.coil.converter, z))

    def load(self, x: float, y: float, z: float) -> bool:
        """Set the inputs of the arm's force, N; return True if one is not zero."""
        self.arm_force[0], self.arm_force[1] = z, x
        return x != 0.0 or z != 0.0

    def act(self, x: float, y: float, z: float) -> None:
        """Set the input of the coil's force, N."""
        self.coil_force[0] = z

    def move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""
        ends: FloatArray = self.ends
        offset, slip = ends[0] - ends[2], ends[1] - ends[3]
        coil: HandleCoil = self.coil
        if coil.near(offset, slip, steps):
            steps = min(steps, STOP_STEPS)
            self.between[0] = coil.force(offset, slip)
        first: int = (steps - 1) * len(self.factors)
        product(self.transitions, first, self.factors, self.products, self.state)
        if self.friction:
            # Friction follows the mean slip, including its own effect. It thus only dissipates
            # energy, and is second-order accurate in the holding time.
            travelled = ends[0] - ends[2] - offset
            whole = self.creep * steps * self.step + self.friction * float(self.travels[steps - 1])
            friction = self.friction * min(1.0, max(-1.0, travelled / whole))
            add_scaled(self.rubbed, steps - 1, -friction, self.state, 0, self.scaled)
        return steps


class ThreeCoils(HeldArm):
    """Handle with three coils, whose mechanics are those of `handle.three_axis`.

    The sensors' low-passed accelerations are rotated to the axes of the sensor by the nine
    elements of `sensor`, row by row.
    """

    def __init__(
        self, parameters: Any, rate: float, hand: Hand, accelerometers: list[Accelerometer]
    ) -> None:
        import numpy as np

        from haptic_accel.core.handle import three_axis as order

        super().__init__(parameters, rate, hand, accelerometers, order.STATES, order.INPUTS)
        body = parameters.body
        turn = order.rotation(body.sensor_axis, body.sensor_rotation)
        self.sensor: list[float] = turn.T.ravel().tolist()
        self.frictions: Any = np.zeros(3)
        self.rub_factors: FloatMatrix = self.frictions[:, np.newaxis]
        self.rub_products: FloatMatrix = np.empty((3, order.STATES))
        self.rub_row: FloatMatrix = np.empty((1, order.STATES))
        self.rub_sum: FloatArray = self.rub_row[0]
        self.friction_forces: FloatArray = scalars(self.frictions)
        inputs = self.joint[order.STATES :]
        self.hand_motion = scalars(self.joint[order.HAND_X : order.HAND_V_Z + 1])
        self.hand_acceleration = scalars(inputs[order.HAND_A_X : order.HAND_A_Z + 1])
        self.place: FloatArray = scalars(self.joint[order.PLACE])
        self.speed: FloatArray = scalars(self.joint[order.SPEED])
        self.offsets: FloatArray = scalars(self.joint[order.TRAVEL])
        self.slips: FloatArray = scalars(self.joint[order.SLIP])
        self.sensed: FloatArray = scalars(self.joint[order.LOW_PASSED])
        self.coil_force: FloatArray = scalars(inputs[order.COILS])
        self.between: FloatArray = scalars(inputs[order.BETWEEN])
        self.arm_force: FloatArray = scalars(inputs[order.ARM])

    def observe(self) -> None:
        """Take the readings of encoders and accelerometers."""
        reading: ArmSample = self.reading
        resolution = self.resolution
        place: FloatArray = self.place
        speed: FloatArray = self.speed
        reading.x, reading.y = encoded(place[0], resolution), encoded(place[1], resolution)
        reading.z = encoded(place[2], resolution)
        reading.v_x, reading.v_y, reading.v_z = speed[0], speed[1], speed[2]
        # A sensor that is held against gravity measures it as an upward acceleration.
        x, y, z = self.sensed[0], self.sensed[1], self.sensed[2] + self.gravity
        reading.a_x = self.axis(0, x, y, z)
        reading.a_y = self.axis(1, x, y, z)
        reading.a_z = self.axis(2, x, y, z)

    def axis(self, index: int, x: float, y: float, z: float) -> float:
        """Return the sample of one axis of the sensor for an acceleration of the handle, m/s^2."""
        coil: HandleCoil = self.coils[index]
        first: int = 3 * index
        turn: list[float] = self.sensor
        low_passed: float = turn[first] * x + turn[first + 1] * y + turn[first + 2] * z
        return coil.accelerometer.measure(low_passed, self.started)

    def push(self, x: float, y: float, z: float) -> None:
        """Set the coils' forces, N, each rounded and limited by its converter; zero for NaN."""
        x = self.drive(self.coils[0].converter, x)
        y = self.drive(self.coils[1].converter, y)
        self.command(x, y, self.drive(self.coils[2].converter, z))

    def load(self, x: float, y: float, z: float) -> bool:
        """Set the inputs of the arm's force, N; return True if one is not zero."""
        force: FloatArray = self.arm_force
        force[0], force[1], force[2] = x, y, z
        return x != 0.0 or y != 0.0 or z != 0.0

    def act(self, x: float, y: float, z: float) -> None:
        """Set the inputs of the coils' forces, N."""
        force: FloatArray = self.coil_force
        force[0], force[1], force[2] = x, y, z

    def move(self, steps: int) -> int:
        """Advance the mechanics by at most `steps`; return the number of steps advanced."""
        for index in range(3):
            coil: HandleCoil = self.coils[index]
            coil.offset = self.offsets[index]
            slip = self.slips[index]
            if coil.near(coil.offset, slip, steps):
                steps = min(steps, STOP_STEPS)
                self.between[index] = coil.force(coil.offset, slip)
        first: int = (steps - 1) * len(self.factors)
        product(self.transitions, first, self.factors, self.products, self.state)
        if self.friction:
            self.rub(steps)
        return steps

    def rub(self, steps: int) -> None:
        """Add the effect of constant dry friction in each coil during a number of steps.

        As with one coil, the friction follows the mean slip, including its own effect and, by
        projected Gauss-Seidel sweeps, that of the other coils' friction.
        """
        most = self.friction
        creep = self.creep * steps * self.step / most
        travels: list[float] = self.travels
        forces: FloatArray = self.friction_forces
        forces[0] = forces[1] = forces[2] = 0.0
        for _ in range(FRICTION_SWEEPS):
            for index in range(3):
                coil: HandleCoil = self.coils[index]
                moved = self.offsets[index] - coil.offset
                at: int = 9 * (steps - 1) + 3 * index
                left: float = moved - travels[at] * forces[0] - travels[at + 1] * forces[1]
                left -= travels[at + 2] * forces[2]
                own: float = travels[at + index]
                sticking = forces[index] + (left - creep * forces[index]) / (own + creep)
                forces[index] = min(most, max(-most, sticking))
        product(self.rubbed, 3 * (steps - 1), self.rub_factors, self.rub_products, self.rub_sum)
        add_scaled(self.rub_row, 0, -1.0, self.state, 0, self.scaled)


def clock_step(rate: float) -> float:
    """Return the step of a rig's clock, s; a sampling period is a whole number of steps.

    As the clock counts steps, all periods have the same length, whenever the rig started.

    Examples
    --------
    >>> clock_step(1000.0), clock_step(150e3)
    (1e-05, 6.666666666666667e-06)
    """
    period = 1.0 / rate
    return period / max(1, math.ceil(period / RESOLUTION))


# The tool


class Tip(SimulatedArm):
    """Point mass with friction, driven by the arm's motors, in contact with a textured surface.

    The surface can only push (Hertz contact with Hunt-Crossley damping). Harder pressing makes the
    contact stiffer and transmits more of the texture. The tip's height follows the profile at the
    speed of the stroke. The tip is at rest until the arm's first force, and returns to its start
    after a release.

    Parameters
    ----------
    parameters : SlaveRigParameters
    rate : float
        Sampling rate, Hz.
    longest_step : float
        Maximum integration step, s.
    sensors : list of Accelerometer or None
        Accelerometers along x, y and z.
    recording : list of float
        Accelerations to play, x, y, z of each sample one after the other; or empty.

    Attributes
    ----------
    texture : callable or None
        As for `SlaveRig.change_surface`.
    lift : float
        Height of the surface, m.
    heights, rises, across : list of float
        Periodic profile of the surface in a number of points that is a power of 2: heights, their
        increases to the next point, and the increases across the stroke; the latter empty for a
        tool that measures along z only.
    spacing : float
        Distance between points of the profile, m.
    """

    def __init__(
        self,
        parameters: Any,
        rate: float,
        longest_step: float,
        sensors: list[Accelerometer | None],
        recording: list[float],
    ) -> None:
        super().__init__()
        tool, arm = parameters.tool, parameters.arm
        self.mass = self.viscous = self.dry = self.slow = self.height = 0.0
        self.mass, self.viscous, self.dry = tool.mass, tool.viscous_friction, tool.coulomb_friction
        self.slow, self.height = tool.slip_velocity**2, tool.height
        self.max_force: float = arm.max_force
        self.resolution: float = arm.position_resolution
        self.corner: float = 2.0 * math.pi * parameters.accelerometer.bandwidth
        self.sensor_x: Accelerometer | None = sensors[0]
        self.sensor_y: Accelerometer | None = sensors[1]
        self.sensor_z: Accelerometer | None = sensors[2]
        self.sideways: bool = self.sensor_x is not None or self.sensor_y is not None
        self.recording: list[float] = recording
        self.rate, self.playing, self.played_since = rate, False, 0
        self.texture: Callable[[float, float], float] | None = None
        self.heights: list[float] = []
        self.rises: list[float] = []
        self.across: list[float] = []
        self.spacing, self.stiffness, self.damping, self.sliding = 1.0, 0.0, 0.0, 0.0
        self.longest_step, self.steps, self.now = longest_step, 0, 0  # in steps of the clock
        self.due = self.step = self.decay = self.first = self.final = 0.0
        self.clock_step: float = clock_step(rate)
        self.motor_x = self.motor_z = self.lift = self.x = self.z = self.v_x = self.v_z = 0.0
        self.low_x = self.low_y = self.low_z = 0.0
        self.return_to_start()

    def return_to_start(self) -> None:
        """Set the tip to rest at its initial position, above the surface."""
        self.z = self.height
        self.lift = self.x = self.v_x = self.v_z = self.low_x = self.low_y = self.low_z = 0.0

    def advance(self, time: float) -> None:
        """Integrate the physics up to a time since the start; past times are ignored."""
        passed: int = int((time / self.clock_step + TO_WHOLE) - TO_WHOLE - self.now)
        if passed <= 0:
            return
        self.now += passed
        if self.started:
            due = min(passed * self.clock_step, LONGEST_ADVANCE)
            self.move(due)
            if self.let_go(due):
                self.return_to_start()

    def pull(self, x: float, y: float, z: float) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        self.started = True
        self.motor_x, self.motor_z = limited(x, self.max_force), limited(z, self.max_force)
        self.free, self.silence = self.motor_x == 0.0 and self.motor_z == 0.0, 0.0

    def divide(self, due: float) -> None:
        """Divide a time in s into steps; compute the weights of the low-pass."""
        steps: int = max(1, -math.floor(1e-6 - due / self.longest_step))
        self.due, self.steps, self.step = due, steps, due / steps
        self.decay = math.exp(-self.corner * self.step)
        # Weights of a step's first and last acceleration in the low-pass, for linear acceleration.
        mean = (1.0 - self.decay) / (self.corner * self.step)
        self.first, self.final = mean - self.decay, 1.0 - mean

    def move(self, due: float) -> None:
        """Move the tip for a time in s.

        All data is in local variables, as simulations spend most of their time here.
        """
        if due != self.due:
            self.divide(due)
        steps: int = self.steps
        step, decay, first, final = self.step, self.decay, self.first, self.final
        heights: list[float] = self.heights
        rises: list[float] = self.rises
        across: list[float] = self.across
        sideways: bool = self.sideways
        mask: int = len(heights) - 1
        spacing, mass, slow = self.spacing, self.mass, self.slow
        stiffness, damping, sliding = self.stiffness, self.damping, self.sliding
        viscous, dry, motor_x, motor_z = self.viscous, self.dry, self.motor_x, self.motor_z
        x, z, v_x, v_z = self.x, self.z - self.lift, self.v_x, self.v_z
        low_x, low_y, low_z = self.low_x, self.low_y, self.low_z
        half = step / 2.0
        half_x = half_z = before_x = before_y = before_z = 0.0
        # The motors' force changes only at the start, and the low-pass must include this jump.
        for done in range(steps + 1):
            slipping = math.sqrt(v_x * v_x + v_z * v_z + slow)
            joints = viscous + dry / slipping
            force_x, force_z = motor_x - joints * v_x, motor_z - joints * v_z
            # The height is linear between points of the profile.
            position = x / spacing
            left: int = math.floor(position)
            index: int = left & mask
            rise, height = rises[index], heights[index]
            penetration = height + rise * (position - left) - z
            normal = 0.0
            if penetration > 0.0:
                slope = rise / spacing
                elastic = stiffness * penetration * math.sqrt(penetration)
                pushing = elastic * (1.0 + damping * (slope * v_x - v_z))
                if pushing > 0.0:
                    normal = pushing
                force_x -= sliding * normal * v_x / slipping + normal * slope
                force_z += normal
            a_x, a_z = force_x / mass, force_z / mass
            if sideways:
                slant = across[index]
                a_y = -normal * slant / spacing / mass
                if done:
                    low_x = decay * low_x + first * before_x + final * a_x
                    low_y = decay * low_y + first * before_y + final * a_y
                before_x, before_y = a_x, a_y
            # Velocity Verlet scheme, whose energy does not drift.
            if done:
                v_x, v_z = half_x + half * a_x, half_z + half * a_z
                low_z = decay * low_z + first * before_z + final * a_z
            if done < steps:
                half_x, half_z, before_z = v_x + half * a_x, v_z + half * a_z, a_z
                x += step * half_x
                z += step * half_z
                # Friction depends on velocity; a predicted velocity keeps the scheme second-order.
                v_x += step * a_x
                v_z += step * a_z
        self.x, self.z, self.v_x, self.v_z = x, z + self.lift, v_x, v_z
        self.low_x, self.low_y, self.low_z = low_x, low_y, low_z

    def depth(self) -> float:
        """Return the depth of the tip in the surface, m; negative above it."""
        position = self.x / self.spacing
        left: int = math.floor(position)
        index: int = left & (len(self.heights) - 1)
        return self.heights[index] + self.rises[index] * (position - left) - (self.z - self.lift)

    def feel(self) -> bool:
        """Compute the force of the surface on the tip."""
        self.contact_x = self.contact_z = 0.0
        penetration = self.depth()
        if penetration > 0.0:
            v_x, v_z = self.v_x, self.v_z
            left: int = math.floor(self.x / self.spacing)
            slope: float = self.rises[left & (len(self.rises) - 1)] / self.spacing
            elastic = self.stiffness * penetration * math.sqrt(penetration)
            normal = max(0.0, elastic * (1.0 + self.damping * (slope * v_x - v_z)))
            slipping = math.sqrt(v_x * v_x + v_z * v_z + self.slow)
            self.contact_x = -(self.sliding * normal * v_x / slipping + normal * slope)
            self.contact_z = normal
        return True

    def observe(self) -> None:
        """Take the readings of encoders and accelerometer."""
        reading: ArmSample = self.reading
        reading.x = encoded(self.x, self.resolution)
        reading.z = encoded(self.z, self.resolution)
        reading.v_x, reading.v_z = self.v_x, self.v_z
        if self.recording:
            if self.started:
                self.play()
            return
        x, z = self.low_x, self.low_z
        noisy: bool = self.started
        if noisy and self.texture is not None:
            self.feel()
            added: float = self.texture(math.fabs(self.v_x), self.contact_z)
            z += added
            # Direction of the sliding, from -1 to 1; near 0 at rest, like that of friction.
            speed = math.sqrt(self.v_x * self.v_x + self.v_z * self.v_z + self.slow)
            x -= self.sliding * added * (self.v_x / speed)
        if self.sensor_x is not None:
            reading.a_x = self.sensor_x.measure(x, noisy)
        if self.sensor_y is not None:
            reading.a_y = self.sensor_y.measure(self.low_y, noisy)
        if self.sensor_z is not None:
            reading.a_z = self.sensor_z.measure(z, noisy)

    def play(self) -> None:
        """Take the acceleration of the recording, which a sensor has already processed."""
        if not self.playing:
            # Start at a sample, as the force may change between samples.
            self.playing, self.played_since = True, self.now
        position = (self.now - self.played_since) * self.clock_step * self.rate
        first: int = 3 * int((position + TO_WHOLE) - TO_WHOLE) % len(self.recording)
        reading, played = self.reading, self.recording
        reading.a_x, reading.a_y, reading.a_z = played[first], played[first + 1], played[first + 2]


class ReplayArm(SimulatedArm):
    """Arm that replays recorded samples; forces on it are counted and have no effect.

    It rests at its first position until the first force of the arm's motors. The replay starts at
    the next sample and is independent of later forces.

    Parameters
    ----------
    table : ndarray, shape (n, 8)
        One row per sample: position, velocity, acceleration along z, and 1 for a lost sample.
    rate : float
        Samples per second.
    loop : bool
        True to restart at the end; otherwise the last sample repeats.
    rest : float
        Acceleration along z before the replay, m/s^2.
    """

    def __init__(self, table: FloatMatrix, rate: float, loop: bool, rest: float) -> None:
        super().__init__()
        self.table: FloatMatrix = scalars(table)
        self.count: int = len(table)
        self.rate, self.loop = rate, loop
        self.now = self.since = 0.0
        self.playing, self.position = False, -1
        self.lost = self.skipped = self.arm_forces = self.actuator_forces = 0
        self.rest: float = rest

    def advance(self, time: float) -> None:
        """Advance to a time, s, or go back to a late tick from the time of a force."""
        self.now = time

    def observe(self) -> None:
        """Take the recorded sample of the present time."""
        table: FloatMatrix = self.table
        at: ArmSample = self.reading
        if not self.started:
            at.x, at.y, at.z, at.a_z = table[0, 0], table[0, 1], table[0, 2], self.rest
            return
        if not self.playing:
            self.playing, self.since = True, self.now
        position: int = int(((self.now - self.since) * self.rate + TO_WHOLE) - TO_WHOLE)
        if not self.loop:
            position = min(position, self.count - 1)
        row: int = position % self.count
        if position != self.position:
            self.skipped += position - self.position - 1
            self.position = position
            if table[row, 7] != 0.0:
                self.lost += 1
        at.x, at.y, at.z = table[row, 0], table[row, 1], table[row, 2]
        at.v_x, at.v_y, at.v_z, at.a_z = table[row, 3], table[row, 4], table[row, 5], table[row, 6]

    def pull(self, x: float, y: float, z: float) -> None:
        """Count a force of the arm's motors; the first one starts the replay."""
        self.started = True
        self.arm_forces += 1

    def release(self) -> None:
        """Do nothing, as forces have no effect."""

    def push(self, x: float, y: float, z: float) -> None:
        """Count a force of the actuator."""
        self.actuator_forces += 1
