# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Mechanics of a tool in a scene: point mass, motors, joints, contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError, check_positive_rate
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.proxy import SKIN, LocalPlane, Proxy
from haptic_accel.core.surfaces.scene import Scene, SceneObject
from haptic_accel.core.surfaces.shapes import UP

MARGIN = 0.1e-3
"""Distance within which objects are considered, m, in addition to the tool's motion in a sample
due to velocity and motors; margin for the effect of other contacts."""

STEP_ANGLE = 0.15
"""Maximum integration step in a contact, rad of its vibration: causes a frequency error of 0.2
%."""

FAR = 0.5
"""Search distance for another scene's surface, m: more than an arm's workspace."""

ENERGY_ERROR = 0.08e-3
"""Maximum energy error between contacts and motion that is not yet corrected, J. Between any two
moments contacts thus generate at most twice this: a fifth of the permitted 1 mJ over a closed
path."""

REPAID = 0.1
"""Maximum fraction of the kinetic energy that corrects the energy error in a sample: 5 % of the
speed. Impacts at 10 kN/m have errors below 1 %."""


class VirtualTool:
    """Point mass with motor forces, joint friction and contact with a scene.

    The geometry is computed once per sample, at the middle of the predicted motion. Planes replace
    the surfaces there. The motion is integrated by the implicit midpoint rule, which conserves the
    energy of a spring, with steps that depend on the stiffness. The energy that springs gain or
    lose from one plane to the next, and by steps across the surface, is taken from the motion or
    returned to it. Only damping, friction and slips dissipate energy: where the tool slips off an
    edge under load, the spring's energy stays with the object.

    Parameters
    ----------
    parameters : ToolParameters
        Parameters of the tool, which starts at its `height` above the scene's start.
    scene : Scene
    rate : float
        Samples per second.

    Attributes
    ----------
    scene : Scene
        Scene as specified; after `change_scene` its effective position may differ.
    position : tuple of float
        Position, m.
    velocity : tuple of float
        Velocity, m/s.
    slip_loss : float
        Elastic energy lost by slips off edges, J.

    Raises
    ------
    ParameterError
        The tool would start inside an object.

    Examples
    --------
    The energy of a tool that bounces without damping equals the motor's work.

    >>> from haptic_accel.core.surfaces.scene import Material
    >>> from haptic_accel.core.surfaces.shapes import Plane
    >>> hard = Material(stiffness=10e3, damping=0.0, static_friction=0.0, friction=0.0)
    >>> free = ToolParameters(viscous_friction=0.0, coulomb_friction=0.0, height=0.1)
    >>> tool = VirtualTool(free, Scene((SceneObject("floor", Plane(), hard),)), rate=1000.0)
    >>> for _ in range(5000):
    ...     contact = tool.advance((0.0, 0.0, -3.0))
    >>> abs(tool.energy() - 3.0 * (0.1 - tool.position[2])) < 1e-9
    True
    """

    def __init__(self, parameters: ToolParameters, scene: Scene, rate: float) -> None:
        check_positive_rate(rate)
        self.slip_loss = 0.0
        self._p = parameters
        self._period = 1 / rate
        self._near: list[Touch] = []
        self.scene = scene
        self._check_start(scene)
        self.return_to_start()

    def return_to_start(self) -> None:
        """Set the tool to rest at its initial position."""
        self.position: Vector = self._start(self.scene)
        self.velocity: Vector = ZERO
        self._came = self._left = ZERO  # velocities before and after the forces of a period
        self._meet(self.scene)

    def change_scene(self, scene: Scene) -> None:
        """Change the scene under the tool, without a jump of position or contact force.

        The scene is moved until its surface has the same force, or to just below a tool that would
        be inside. The shift lasts until the tool is reset.

        Raises
        ------
        ParameterError
            The tool would start inside an object.
        """
        self._check_start(scene)
        pressed = max((each for each in self._near if each.depth), key=Touch.force, default=None)
        inside = any(each.distance(*self.position) < 0 for each in scene.objects)
        self.scene = scene
        if pressed or inside:
            self._slip_under(pressed)
        else:
            self._meet(scene)

    def _slip_under(self, pressed: Touch | None) -> None:
        """Set the scene, moved to keep the previous contact force, or to just below the tool."""
        up = pressed.normal if pressed else UP
        above = added(self.position, up, FAR)
        number, way = self.scene.first_hit(above, added(ZERO, up, -1), 2 * FAR)
        if number < 0:
            self._meet(self.scene)
            return
        material = self.scene.objects[number].material
        depth = pressed.force() / material.stiffness if pressed else -SKIN
        self._meet(self.scene.moved(added(ZERO, up, way - FAR + depth)))
        self._proxy.position = added(self.position, up, depth + SKIN)
        if pressed:
            self._near = [self._touches[number]]
            self._near[0].take_over(pressed)

    def energy(self) -> float:
        """Return kinetic energy and the contacts' elastic energy, J."""
        v_x, v_y, v_z = self.velocity
        kinetic = self._p.mass * (v_x * v_x + v_y * v_y + v_z * v_z) / 2
        return kinetic + sum(touch.energy() for touch in self._near)

    @property
    def acceleration(self) -> Vector:
        """Mean acceleration in the last period, m/s^2, without the energy correction."""
        x, y, z = (
            (after - before) / self._period
            for before, after in zip(self._came, self._left, strict=True)
        )
        return x, y, z

    def advance(self, force: Vector) -> Contact | None:
        """Move one sampling period.

        Parameters
        ----------
        force : tuple of float
            Force of the motors, N.

        Returns
        -------
        Contact or None
            Contact; None if nothing was touched.
        """
        (x, y, z), (v_x, v_y, v_z) = self.position, self.velocity
        half = self._period / 2
        fastest = math.hypot(*self.velocity) + self._period * math.hypot(*force) / self._p.mass
        ahead = (x + half * v_x, y + half * v_y, z + half * v_z)
        self._lay(self._proxy.follow(ahead, MARGIN + self._period * fastest))
        self._came = self.velocity
        self._integrate(force)
        self._left = self.velocity
        if not self._near:
            return None
        for touch in self._near:
            self._owed += touch.settle(self.position)
        self._repay()
        return self._contact()

    def _start(self, scene: Scene) -> Vector:
        return added(scene.start, UP, self._p.height)

    def _check_start(self, scene: Scene) -> None:
        for each in scene.objects:
            if each.distance(*self._start(scene)) < 0:
                raise ParameterError(
                    f"scene {scene.name}: its start, {self._p.height:g} m up, is inside of"
                    f" {each.name!r}"
                )

    def _meet(self, scene: Scene) -> None:
        """Set a scene without contacts."""
        self._proxy = Proxy(scene, self.position)
        self._touches = [Touch(each, self._p.mass) for each in scene.objects]
        self._near = []
        self._owed = 0.0  # energy generated by contacts, not yet removed, J

    def _lay(self, planes: Sequence[LocalPlane]) -> None:
        """Replace the surfaces of nearby objects by planes; ignore all other objects."""
        near = [self._touches[plane.number] for plane in planes]
        for touch in self._near:
            if touch not in near:
                self._owed -= touch.energy()
                touch.end()
        for touch, plane in zip(near, planes, strict=True):
            self._owed += touch.lay(plane, self.position, ENERGY_ERROR - self._owed)
        slipped = -ENERGY_ERROR - self._owed
        if slipped > 0:
            self.slip_loss += slipped
            self._owed = -ENERGY_ERROR
        self._near = near

    def _repay(self) -> None:
        """Remove energy generated by contacts from the motion, or restore energy lost in them."""
        x, y, z = self.velocity
        kinetic = self._p.mass / 2 * (x * x + y * y + z * z)
        repaid = max(-REPAID * kinetic, min(REPAID * kinetic, self._owed))
        if repaid:
            kept = math.sqrt(1 - repaid / kinetic)
            self.velocity = kept * x, kept * y, kept * z
            self._owed -= repaid

    def _integrate(self, force: Vector) -> None:
        """Integrate the forces over one period."""
        tool, near = self._p, self._near
        mass, slow = tool.mass, tool.slip_velocity**2
        stiffness = sum(touch.object.material.stiffness for touch in near)
        steps = max(1, math.ceil(self._period * math.sqrt(stiffness / mass) / STEP_ANGLE))
        step = self._period / steps
        half, per_mass = step / 2, step / mass
        a_x, a_y, a_z = force[0] * per_mass, force[1] * per_mass, force[2] * per_mass
        (x, y, z), (v_x, v_y, v_z) = self.position, self.velocity
        for _ in range(steps):
            before = v_x, v_y, v_z
            x, y, z = x + half * v_x, y + half * v_y, z + half * v_z
            slipping = math.sqrt(v_x * v_x + v_y * v_y + v_z * v_z + slow)
            joints = tool.viscous_friction + tool.coulomb_friction / slipping
            # Half of the joints' damping before the other forces, and half after them, so that a
            # tool at rest on a surface presses with the full motor force.
            kept = math.exp(-joints * per_mass / 2)
            v_x, v_y, v_z = kept * v_x + a_x, kept * v_y + a_y, kept * v_z + a_z
            for touch in near:
                v_x, v_y, v_z = touch.push((x, y, z), before, (v_x, v_y, v_z), step)
            v_x, v_y, v_z = kept * v_x, kept * v_y, kept * v_z
            for touch in near:
                touch.note_work(before, (v_x, v_y, v_z))
            x, y, z = x + half * v_x, y + half * v_y, z + half * v_z
        self.position, self.velocity = (x, y, z), (v_x, v_y, v_z)

    def _contact(self) -> Contact | None:
        """Return the contact of the previous period."""
        touched = [touch for touch in self._near if touch.was_touched]
        if not touched:
            return None
        touch = max(
            touched, key=lambda each: (each.impact_speed, along(each.normal, each.impulse))
        )
        total_x, total_y, total_z = (
            sum(parts) / self._period
            for parts in zip(*(each.impulse for each in touched), strict=True)
        )
        (n_x, n_y, n_z), (v_x, v_y, v_z) = touch.normal, self.velocity
        away = along(touch.normal, self.velocity)
        velocity = (v_x - away * n_x, v_y - away * n_y, v_z - away * n_z)
        return Contact(
            touch.object,
            touch.normal,
            touch.depth,
            (total_x, total_y, total_z),
            along(touch.normal, touch.impulse) / self._period,
            velocity,
            math.hypot(*velocity),
            touch.impact_speed,
            touch.sliding,
        )


class Touch:
    """Spring and damper normal to an object's tangent plane, friction along it.

    Friction is the force of a bristle with the stiffness of the surface. The bristle sticks up to
    the static coefficient, then slides with the sliding coefficient until the tool stops.

    Parameters
    ----------
    touched : SceneObject
    mass : float
        Mass of the tool, kg.

    Attributes
    ----------
    object : SceneObject
    normal : tuple of float
    depth : float
        Compression of the spring, m.
    was_touched : bool
        True if the object was touched since the plane was set.
    impact_speed : float
        Impact speed of a first contact since then, m/s, or 0.
    impulse : tuple of float
        Impulse on the tool since then, N s.
    sliding : bool
    """

    def __init__(self, touched: SceneObject, mass: float) -> None:
        material = touched.material
        self.object = touched
        self._mass = mass
        self._stiffness, self._damping = material.stiffness, material.damping
        self._static, self._kinetic = material.static_friction, material.friction
        self._offset = 0.0
        self.normal = ZERO
        self.impulse = ZERO
        self.impact_speed = 0.0
        self.was_touched = False
        self._spring = 0.0  # impulse of the spring in the last step, N s
        self._rest = ZERO  # impulse of damper and bristle
        self._spring_work = self._rest_work = 0.0
        self.end()

    def end(self) -> None:
        """End the contact."""
        self.depth = 0.0
        self.bristle = ZERO
        self.sliding = False
        self._pressed = False

    def energy(self) -> float:
        """Return the elastic energy of spring and bristle, J."""
        x, y, z = self.bristle
        return self._stiffness / 2 * (self.depth**2 + x * x + y * y + z * z)

    def force(self) -> float:
        """Return the elastic force, N."""
        return self._stiffness * self.depth

    def take_over(self, other: Touch) -> None:
        """Copy the elastic forces of another contact."""
        softer = other._stiffness / self._stiffness
        x, y, z = other.bristle
        self.depth = softer * other.depth
        self.bristle = (softer * x, softer * y, softer * z)
        self.sliding, self._pressed = other.sliding, True

    def lay(self, plane: LocalPlane, point: Vector, spare: float) -> float:
        """Set the plane of the surface for the next period, with the tool at a position.

        Parameters
        ----------
        plane : LocalPlane
        point : tuple of float
            Position of the tool, m.
        spare : float
            Energy that the spring may gain from the new plane, J. If it would gain more, for
            example between a soft and a hard object, the surface is set below the plane.

        Returns
        -------
        float
            Energy gained by the spring; negative for a loss.
        """
        self.normal = n_x, n_y, n_z = plane.normal
        self.impulse, self.impact_speed, self.was_touched = ZERO, 0.0, self._pressed
        b_x, b_y, b_z = self.bristle
        outwards = along(self.normal, self.bristle)
        self.bristle = (b_x - outwards * n_x, b_y - outwards * n_y, b_z - outwards * n_z)
        self._offset = plane.offset
        depth, before = max(0.0, -plane.height(point)), self.depth
        won = self._stiffness / 2 * (depth * depth - before * before)
        if won > spare:
            permitted = math.sqrt(max(0.0, before * before + 2 * spare / self._stiffness))
            self._offset -= depth - permitted
            depth = permitted
            won = self._stiffness / 2 * (depth * depth - before * before)
        self.depth = depth
        self._spring_work = -self._spring_energy()
        self._rest_work = -self.energy() - self._spring_work
        return won

    def settle(self, point: Vector) -> float:
        """Return the energy in J generated since the plane was set, with the tool at a position.

        This is the error of the integration. Damper and friction count only if they generate
        energy.
        """
        n_x, n_y, n_z = self.normal
        self.depth = self._offset - n_x * point[0] - n_y * point[1] - n_z * point[2]
        if self.depth <= 0:
            self.end()
        spring = self._spring_energy()
        return self._spring_work + spring + max(0.0, self._rest_work + self.energy() - spring)

    def _spring_energy(self) -> float:
        return self._stiffness / 2 * self.depth**2

    def push(self, point: Vector, came: Vector, velocity: Vector, step: float) -> Vector:
        """Return the tool's velocity after a step, for a position at the step's middle.

        Parameters
        ----------
        point : tuple of float
            Position, m.
        came : tuple of float
            Velocity of the tool before the step, m/s.
        velocity : tuple of float
            Velocity including the effect of the motors, m/s.
        step : float
            Duration of the step, s.
        """
        (n_x, n_y, n_z), mass = self.normal, self._mass
        v_x, v_y, v_z = velocity
        depth = self._offset - n_x * point[0] - n_y * point[1] - n_z * point[2]
        if depth <= 0:
            if self._pressed:
                self.end()
            return velocity
        away = n_x * v_x + n_y * v_y + n_z * v_z
        if not self._pressed:
            self._pressed = self.was_touched = True
            self.impact_speed = max(self.impact_speed, -along(self.normal, came))
        per_mass = step / mass
        came_away = along(self.normal, came)
        # Implicit midpoint: stable for any damping, and exact for the energy of the spring.
        bend = self._stiffness * per_mass * step / 4
        drag = self._damping * per_mass
        pushed = away + self._stiffness * per_mass * depth + bend * came_away
        push = max(0.0, pushed / (1 + drag + bend) - away)  # a surface can only push
        mean = depth - step / 4 * (away + push - came_away)
        self._spring = max(0.0, self._stiffness * step * mean)
        u_x, u_y, u_z = self._rub(
            (v_x - away * n_x, v_y - away * n_y, v_z - away * n_z),
            (came[0] - came_away * n_x, came[1] - came_away * n_y, came[2] - came_away * n_z),
            push / (per_mass * self._stiffness),
            step,
        )
        away += push
        w_x, w_y, w_z = u_x + away * n_x, u_y + away * n_y, u_z + away * n_z
        g_x, g_y, g_z = mass * (w_x - v_x), mass * (w_y - v_y), mass * (w_z - v_z)
        i_x, i_y, i_z = self.impulse
        self.impulse = (i_x + g_x, i_y + g_y, i_z + g_z)
        spring = self._spring
        self._rest = (g_x - spring * n_x, g_y - spring * n_y, g_z - spring * n_z)
        return w_x, w_y, w_z

    def _rub(self, velocity: Vector, came: Vector, bound: float, step: float) -> Vector:
        """Stretch the bristle; return the tangential velocity after a step.

        Parameters
        ----------
        velocity, came : tuple of float
            Tangential parts of the velocities of `push`, m/s.
        bound : float
            Normal force over the stiffness, m.
        step : float
            Duration of the step, s.
        """
        (v_x, v_y, v_z), (c_x, c_y, c_z) = velocity, came
        per_mass, half = step / self._mass, step / 2
        b_x, b_y, b_z = self._within_cone(self.bristle, bound)
        pull = self._stiffness * per_mass
        if self._static and not self.sliding:
            bend = pull * step / 4
            held = 1 / (1 + self._damping * per_mass + bend)
            w_x = held * (v_x - pull * b_x - bend * c_x)
            w_y = held * (v_y - pull * b_y - bend * c_y)
            w_z = held * (v_z - pull * b_z - bend * c_z)
            held_bristle = (
                b_x + half * (c_x + w_x),
                b_y + half * (c_y + w_y),
                b_z + half * (c_z + w_z),
            )
            if self._within_cone(held_bristle, bound) is held_bristle:
                self.bristle = held_bristle
                return w_x, w_y, w_z
        v_x, v_y, v_z = v_x - pull * b_x, v_y - pull * b_y, v_z - pull * b_z
        stretched = b_x + half * (c_x + v_x), b_y + half * (c_y + v_y), b_z + half * (c_z + v_z)
        self.bristle = self._within_cone(stretched, bound)
        self.sliding = self.bristle is not stretched
        return v_x, v_y, v_z

    def _within_cone(self, bristle: Vector, bound: float) -> Vector:
        """Return the bristle, shortened if it exceeds a bound in m."""
        x, y, z = bristle
        length = math.sqrt(x * x + y * y + z * z)
        if length <= (self._kinetic if self.sliding else self._static) * bound:
            return bristle
        self.sliding = True
        shrunk = self._kinetic * bound / length
        return shrunk * x, shrunk * y, shrunk * z

    def note_work(self, before: Vector, after: Vector) -> None:
        """Add the work of the last step, from the tool's velocities before and after it."""
        if self._pressed:
            x, y, z = before[0] + after[0], before[1] + after[1], before[2] + after[2]
            n_x, n_y, n_z = self.normal
            self._spring_work += self._spring / 2 * (n_x * x + n_y * y + n_z * z)
            g_x, g_y, g_z = self._rest
            self._rest_work += (g_x * x + g_y * y + g_z * z) / 2


def along(direction: Vector, vector: Vector) -> float:
    """Return the component of a vector along a direction."""
    return direction[0] * vector[0] + direction[1] * vector[1] + direction[2] * vector[2]


def added(point: Vector, direction: Vector, way: float) -> Vector:
    """Return a vector plus a multiple of another, such as the position at a distance in m."""
    x, y, z = (at + way * part for at, part in zip(point, direction, strict=True))
    return x, y, z


class Contact(NamedTuple):
    """Contact of a tool with a scene during one sampling period.

    If the tool touches several objects, `force` is the sum. The other values belong to an object
    first touched in this sample, or else to that with the largest force.

    Attributes
    ----------
    object : SceneObject
    normal : tuple of float
        Outward direction of the object's surface.
    depth : float
        Penetration depth of the tool, m.
    force : tuple of float
        Mean force on the tool, N.
    normal_force : float
        Normal component of this object's force, N; never negative.
    velocity : tuple of float
        Tangential velocity of the tool, m/s.
    speed : float
        Tangential speed, m/s.
    impact_speed : float
        Impact speed, m/s; 0 except in the first sample of a contact.
    sliding : bool
        True if the tool slides, False if it sticks.
    """

    object: SceneObject
    normal: Vector
    depth: float
    force: Vector
    normal_force: float
    velocity: Vector
    speed: float
    impact_speed: float
    sliding: bool
