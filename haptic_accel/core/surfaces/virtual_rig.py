# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual slave: a tool in contact with a scene, and the resulting vibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from haptic_accel.core.axes import ACTUATOR_AXES, Axes, along_actuator
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig import ArmParameters, Rig
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.scene import Material, Scene
from haptic_accel.core.surfaces.taps import Tap
from haptic_accel.core.surfaces.texture import Texture
from haptic_accel.core.surfaces.tool import Contact, VirtualTool, added, along
from haptic_accel.core.tick.rigs import LONGEST_ADVANCE, SimulatedArm, encoded, limited

RINGING = 0.25
"""Time for which a texture decays after the contact, s; its synthesis then stops."""

_WHOLE = 1e-3
"""Fraction of a period by which a sample may be early, due to the clock's resolution."""


@dataclass(frozen=True)
class VirtualRigParameters:
    """Tool and arm of the virtual slave."""

    tool: ToolParameters = field(default_factory=ToolParameters)
    arm: ArmParameters = field(default_factory=ArmParameters)


class Vibration:
    """Acceleration of a tool on one material: texture while sliding, taps at impacts.

    Parameters
    ----------
    material : Material
    rate : float
        Samples per second.
    seed : int
        Seed of the texture.
    """

    def __init__(self, material: Material, rate: float, seed: int) -> None:
        self._texture = Texture(material.texture, rate, seed) if material.texture else None
        self._tap = Tap(material.tap, rate) if material.tap else None
        self._ringing = math.ceil(RINGING * rate)
        self._left = 0  # samples until silent

    @property
    def saturated(self) -> int:
        """Number of samples at the texture's limit."""
        return self._texture.saturated if self._texture else 0

    @property
    def silent(self) -> bool:
        """True if the tool has left the material, and the vibration has decayed."""
        return not self._left

    def synthesize(self, contact: Contact | None) -> float:
        """Return the acceleration of one sample, m/s^2; without a contact it decays."""
        if contact:
            self._left = self._ringing
            if self._tap and contact.impact_speed:
                self._tap.strike(contact.impact_speed)
        elif self.silent:
            return 0.0
        else:
            self._left -= 1
        speed, force = (contact.speed, contact.normal_force) if contact else (0.0, 0.0)
        texture = self._texture.synthesize(speed, force) if self._texture else 0.0
        if not self._tap:
            return texture
        return self._tap.synthesize() + self._tap.texture_share * texture


class VirtualArm(SimulatedArm):
    """Tool in a scene, moved by the arm's motors.

    Textures and taps of the touched materials cause the acceleration. The vibration of one
    material decays while the next starts. The tool is at rest until the arm's first force, and
    returns to its start after a release.

    A single-axis accelerometer (z) measures this vibration for any direction of the normal. An
    accelerometer with more axes measures it along the normal. It also measures the resulting
    change of friction, against the motion, and the tool's acceleration along the surface, such as
    that of stick-slip. The tool does not rotate, so its frame is that of the arm.

    Parameters
    ----------
    parameters : VirtualRigParameters
    scene : Scene
    rate : float
        Sampling rate, Hz.

    Attributes
    ----------
    tool : VirtualTool
    vibrations : dict
        Vibration on each material.
    contact : Contact or None
        Contact at the last sample.
    """

    def __init__(self, parameters: VirtualRigParameters, scene: Scene, rate: float) -> None:
        super().__init__()
        self._arm = parameters.arm
        self._rate = rate
        self.tool: VirtualTool = (scene.mover or VirtualTool)(parameters.tool, scene, rate)
        self.vibrations: dict[Material, Vibration] = {}
        self._most = math.ceil(LONGEST_ADVANCE * rate)
        self._now = 0  # samples
        self._force = ZERO
        self._acceleration = ZERO
        self._axes = Axes.parsed(parameters.tool.axes)
        self._slow = parameters.tool.slip_velocity
        self._directions: dict[Material, Vector] = {}
        self.contact: Contact | None = None

    def feel(self) -> bool:
        """Compute the force of the scene on the tool, which is always known."""
        force = self.contact.force if self.contact else ZERO
        self.contact_x, self.contact_y, self.contact_z = force
        return True

    def advance(self, time: float) -> None:
        """Integrate all samples up to `time`, s. Times in the past are ignored."""
        passed = math.floor(time * self._rate + _WHOLE) - self._now
        if passed <= 0:
            return
        self._now += passed
        if self.started:
            for _ in range(min(passed, self._most)):
                self._sample()
            if self.let_go(passed / self._rate):
                self.tool.return_to_start()

    def observe(self) -> None:
        """Sample the encoders and the acceleration."""
        at, tool, resolution = self.reading, self.tool, self._arm.position_resolution
        at.x, at.y, at.z = (encoded(each, resolution) for each in tool.position)
        at.v_x, at.v_y, at.v_z = tool.velocity
        at.a_x, at.a_y, at.a_z = self._acceleration

    def pull(self, x: float, y: float, z: float) -> None:
        """Set the force of the arm's motors, N, each axis limited to their maximum."""
        self.started = True
        most = self._arm.max_force
        force = self._force = limited(x, most), limited(y, most), limited(z, most)
        self.free, self.silence = not any(force), 0.0

    def _sample(self) -> None:
        """Integrate one sampling period."""
        contact = self.contact = self.tool.advance(self._force)
        touched = contact.object.material if contact else None
        vibrations = {
            material: vibration.synthesize(contact if material is touched else None)
            for material, vibration in self.vibrations.items()
        }
        if self._axes == ACTUATOR_AXES:
            self._acceleration = along_actuator(sum(vibrations.values()))
        else:
            self._acceleration = self._directed(vibrations, contact)

    def _directed(self, vibrations: Mapping[Material, float], contact: Contact | None) -> Vector:
        """Return the acceleration in the tool frame for vibrations of materials, m/s^2."""
        total = ZERO
        if contact:
            material, acceleration = contact.object.material, self.tool.acceleration
            total = added(acceleration, contact.normal, -along(contact.normal, acceleration))
            slipping = -material.friction / math.hypot(contact.speed, self._slow)
            self._directions[material] = added(contact.normal, contact.velocity, slipping)
        for material, vibration in vibrations.items():
            if vibration:
                total = added(total, self._directions[material], vibration)
        return self._axes.vector(self._axes.components(total))


class VirtualRig(Rig):
    """Rig with a tool in a scene; parameters of `VirtualArm`, and the textures' seed."""

    def __init__(
        self, parameters: VirtualRigParameters, scene: Scene, rate: float, seed: int = 0
    ) -> None:
        self._arm, self._grain = VirtualArm(parameters, scene, rate), (rate, seed)
        super().__init__(self._arm)
        self.change_scene(scene)

    def change_scene(self, scene: Scene) -> None:
        """Change the scene under the tool, without a jump of force; vibrations continue.

        Raises
        ------
        ParameterError
            One of the two scenes moves.
        """
        arm = self._arm
        if scene is not arm.tool.scene:
            if scene.mover or arm.tool.scene.mover:
                raise ParameterError(f"scene {scene.name}: no change to or from moving scenes")
            arm.tool.change_scene(scene)
        vibrations = {m: v for m, v in arm.vibrations.items() if not v.silent}
        for each in scene.objects:
            if each.material not in vibrations:
                vibrations[each.material] = Vibration(each.material, *self._grain)
        arm.vibrations = vibrations

    def counters(self) -> dict[str, int]:
        """Return the count of samples at the limit of a texture."""
        return {"texture_saturated": sum(each.saturated for each in self._arm.vibrations.values())}
