# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenes moved by MuJoCo, which gives contacts and normal forces.

Forces of MuJoCo's soft contacts oscillate, so no acceleration is derived from them. This package
computes textures, taps and friction (limited by a geom's sliding coefficient).

An MJCF file can state arbitrary numbers of copies, sizes of meshes and tables, and included files.
In some cases MuJoCo's compiler does not return. So a file is first compiled in a separate process,
with limits of time and memory.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core.bounded_work import OutOfBoundsError, bounded, run_bounded
from haptic_accel.core.files import located, opened
from haptic_accel.core.model import ZERO, FloatArray, Vector, vector
from haptic_accel.core.parameters import ParameterError, one_line, shown, suggestion
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Box, Cylinder, Plane, Shape, Sphere
from haptic_accel.core.surfaces.tool import Contact

TIP_RADIUS = 1e-3
"""Radius of the tool's tip, m."""

_TOOL = "haptic_accel_tool"


def moving_scene(path: Path, materials: Mapping[str, Material], start: Vector, name: str) -> Scene:
    """Return the scene of an MJCF file, with the shapes in their initial state.

    Parameters
    ----------
    path : Path
    materials : mapping
        Material of a geom by name; other geoms have no texture or taps.
    start : tuple of float
        Position above which the tool starts, m.
    name : str
        Name of the scene.

    Raises
    ------
    ParameterError
        MuJoCo is not installed, or cannot read the file, or the file lacks a geom.
    """
    from scipy.spatial.transform import Rotation

    mujoco = _mujoco(path)
    check_mjcf(path)
    model = compiled(path, specification(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    names = [model.geom(index).name or f"geom {index}" for index in range(model.ngeom)]
    for geom in materials:
        if geom not in names:
            raise ParameterError(
                f"{path}: geom {shown(geom)}: must be one of {', '.join(names)}"
                f"{suggestion(geom, names)}"
            )
    objects = tuple(
        SceneObject(
            geom,
            _shape(model.geom(index)),
            materials.get(geom) or Material(geom),
            tuple(data.geom_xpos[index].tolist()),
            # Angles are about the fixed axes x, y, z.
            vector(Rotation.from_matrix(data.geom_xmat[index].reshape(3, 3)).as_euler("xyz")),
        )
        for index, geom in enumerate(names)
    )
    return Scene(objects, start, name, partial(MovingTool, path))


def _mujoco(path: Path) -> Any:
    try:
        import mujoco
    except ImportError:
        raise ParameterError(f"{path}: needs MuJoCo: pip install 'haptic_accel[mujoco]'") from None
    return mujoco


def _shape(geom: Any) -> Shape:
    """Return the drawn shape of a geom; its bounding sphere if the shape is not available."""
    from mujoco import mjtGeom

    kind, (x, y, z) = int(geom.type[0]), geom.size.tolist()
    if kind == mjtGeom.mjGEOM_PLANE:
        return Plane()
    if kind == mjtGeom.mjGEOM_BOX:
        return Box(2 * x, 2 * y, 2 * z)
    if kind == mjtGeom.mjGEOM_CYLINDER:
        return Cylinder(x, 2 * y)
    return Sphere(float(geom.rbound[0]))


class MovingTool:
    """Sphere on three sliding joints in a MuJoCo scene, under the motors' force.

    Parameters
    ----------
    path : Path
        MJCF file.
    parameters : ToolParameters
        Parameters of the tool, which starts at its `height` above the scene's start.
    scene : Scene
        Scene from the same file.
    rate : float
        Samples per second; MuJoCo takes as many steps per sample as its time step requires.

    Attributes
    ----------
    scene : Scene
    position : tuple of float
        Position, m.
    velocity : tuple of float
        Velocity, m/s.
    acceleration : tuple of float
        Mean acceleration in the last period, m/s^2.
    """

    def __init__(self, path: Path, parameters: ToolParameters, scene: Scene, rate: float) -> None:
        self._mujoco = _mujoco(path)
        self.scene = scene
        self._rate = rate
        self._model = _with_tool(path, scene.start, parameters)
        self._steps = max(1, math.ceil(1 / rate / self._model.opt.timestep - 1e-9))
        self._model.opt.timestep = 1 / rate / self._steps
        self._data = self._mujoco.MjData(self._model)
        self._inertia = parameters.mass / self._model.opt.timestep
        self._friction = self._model.geom_friction[:, 0].tolist()
        self._body, self._tip = self._model.body(_TOOL).id, self._model.geom(_TOOL).id
        first = self._model.body(_TOOL).dofadr[0]
        self._axes = slice(first, first + 3)
        self.return_to_start()

    def return_to_start(self) -> None:
        """Restart the scene."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._mujoco.mj_forward(self._model, self._data)
        self._touched: set[int] = set()
        self.acceleration: Vector = ZERO
        self._note()

    def advance(self, force: Vector) -> Contact | None:
        """Advance one sampling period under the motors' force in N; return the contact."""
        forces: dict[int, FloatArray] = {}
        contacts: dict[int, Contact] = {}
        approaching = np.array(self.velocity)
        for _ in range(self._steps):
            self._data.xfrc_applied[self._body, :3] += force
            self._mujoco.mj_step(self._model, self._data)
            self._data.xfrc_applied[:] = 0.0
            for index, pair in enumerate(self._data.contact.geom.tolist()):
                if self._tip in pair:
                    other = sum(pair) - self._tip
                    found = self._touch(self._data.contact[index], other, force, approaching)
                    contacts[other] = found
                    forces[other] = forces.get(other, 0.0) + np.array(found.force) / self._steps
        self._note()
        self.acceleration = vector((np.array(self.velocity) - approaching) * self._rate)
        new, self._touched = set(contacts) - self._touched, set(contacts)
        if not contacts:
            return None
        number = max(contacts, key=lambda each: (each in new, contacts[each].normal_force))
        return contacts[number]._replace(
            force=vector(sum(forces.values(), np.zeros(3))),
            normal_force=float(forces[number] @ contacts[number].normal),
            impact_speed=contacts[number].impact_speed if number in new else 0.0,
        )

    def _note(self) -> None:
        self.position: Vector = vector(self._data.xpos[self._body])
        self.velocity: Vector = vector(self._data.qvel[self._axes])

    def _touch(self, contact: Any, other: int, motors: Vector, approaching: FloatArray) -> Contact:
        """Return a contact of the last step; apply its friction in the next step."""
        normal = contact.frame[:3] * (1.0 if contact.geom[1] == self._tip else -1.0)
        ground = self._ground_velocity(other, contact.pos)
        relative = self._data.qvel[self._axes] - ground
        along = _along(relative, normal)
        # MuJoCo's contact has normal force only, as its friction makes the tool hop.
        pushing = (
            float(self._data.efc_force[contact.efc_address]) if contact.efc_address >= 0 else 0
        )
        bound = self._friction[other] * pushing
        stopping = self._inertia * along + _along(np.array(motors), normal)
        size = math.sqrt(stopping @ stopping)
        friction = -stopping * min(1.0, bound / size) if size else np.zeros(3)
        self._data.xfrc_applied[self._body, :3] += friction
        body = self._model.geom_bodyid[other]
        lever = contact.pos - self._data.xipos[body]
        self._data.xfrc_applied[body] -= np.concatenate([friction, self._cross(lever, friction)])
        return Contact(
            self.scene.objects[other],
            vector(normal),
            max(0.0, -float(contact.dist)),
            vector(pushing * normal + friction),
            pushing,
            vector(along),
            math.sqrt(along @ along),
            max(0.0, -float((approaching - ground) @ normal)),
            size > bound,
        )

    def _ground_velocity(self, geom: int, point: FloatArray) -> FloatArray:
        """Return the velocity of a geom at a position, m/s."""
        twist = np.zeros(6)
        kind = self._mujoco.mjtObj.mjOBJ_GEOM
        self._mujoco.mj_objectVelocity(self._model, self._data, kind, geom, twist, 0)
        lever = point - self._data.geom_xpos[geom]
        return np.asarray(twist[3:] + self._cross(twist[:3], lever))

    def _cross(self, first: FloatArray, second: FloatArray) -> FloatArray:
        result = np.empty(3)
        self._mujoco.mju_cross(result, first, second)  # ten times faster than numpy
        return result


def _along(vector: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the tangential component of a vector."""
    return np.asarray(vector - (vector @ normal) * normal)


def _with_tool(path: Path, start: Vector, parameters: ToolParameters) -> Any:
    """Return a file's model with an added tool, whose geom is the last."""
    from mujoco import mjtGeom, mjtJoint

    stated = specification(path)
    x, y, z = start
    point = [x, y, z + parameters.height + TIP_RADIUS]
    body = stated.worldbody.add_body(name=_TOOL, pos=point, gravcomp=1)
    for axis in np.eye(3):
        body.add_joint(
            type=mjtJoint.mjJNT_SLIDE,
            axis=axis,
            damping=parameters.viscous_friction,
            frictionloss=parameters.coulomb_friction,
        )
    size = [TIP_RADIUS, 0, 0]
    ball = body.add_geom(name=_TOOL, type=mjtGeom.mjGEOM_SPHERE, size=size, mass=parameters.mass)
    ball.contype = ball.conaffinity = 1  # independent of the file's defaults
    ball.condim = ball.priority = 1  # no friction with other geoms
    return compiled(path, stated)


SECONDS = 2.0
"""Maximum processor time for compiling a scene and two steps, s."""

MEGABYTES = 400
"""Maximum memory, MB."""

LARGEST_FILE = 1 << 24
"""Maximum size of a file, bytes."""

MOST_GEOMS = 1000
"""Maximum number of geoms in a scene."""

SHORTEST_STEP = 2e-5
"""Minimum time step, s: fifty in a sample at 1 kHz. MuJoCo's default is 2 ms."""

MOST_ITERATIONS = 1000
"""Maximum number of solver iterations: ten times MuJoCo's default."""


def check_mjcf(path: Path) -> None:
    """Reject an MJCF file that MuJoCo cannot compile and step within limits.

    Raises
    ------
    ParameterError
        The message is one line with the file and its error.
    """
    with located(path, unreadable="must be MJCF that MuJoCo reads: "), opened(path, LARGEST_FILE):
        pass  # do not wait for a pipe
    try:
        run_bounded(__name__, [str(path.absolute())], SECONDS)
    except OutOfBoundsError as error:
        raise ParameterError(
            f"{path}: {error}: must be compiled within {SECONDS:g} s and {MEGABYTES} MB"
        ) from None


def specification(path: Path) -> Any:
    """Return the specification in an MJCF file.

    Raises
    ------
    ParameterError
        MuJoCo cannot read the file.
    """
    import mujoco

    with _read_by_mujoco(path):
        return mujoco.MjSpec.from_file(str(path))


def compiled(path: Path, stated: Any) -> Any:
    """Return the model of an MJCF file's specification.

    Raises
    ------
    ParameterError
        MuJoCo cannot compile the file, or a value is not allowed here.
    """
    with _read_by_mujoco(path):
        model = stated.compile()
    if model.ngeom > MOST_GEOMS:
        raise ParameterError(f"{path}: {model.ngeom} geoms: must be at most {MOST_GEOMS}")
    step = model.opt.timestep
    if not SHORTEST_STEP <= step < 1.0:
        raise ParameterError(f"{path}: timestep = {step:g}: must be from {SHORTEST_STEP:g} to 1 s")
    for name in (each for each in dir(model.opt) if re.search("iterations|initpoints", each)):
        if (count := getattr(model.opt, name)) > MOST_ITERATIONS:
            raise ParameterError(f"{path}: {name} = {count}: must be at most {MOST_ITERATIONS}")
    return model


def compile_and_step(path: Path) -> None:
    """Compile a file and take two steps, without limits.

    Raises
    ------
    ParameterError
        See `specification` and `compiled` for the conditions.
    """
    import mujoco

    model = compiled(path, specification(path))
    with _read_by_mujoco(path):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 2)


@contextmanager
def _read_by_mujoco(path: Path) -> Iterator[None]:
    import mujoco

    try:
        yield
    except (ValueError, mujoco.FatalError) as error:
        reason = shown(one_line(error))
        raise ParameterError(f"{path}: must be MJCF that MuJoCo reads: {reason}") from None


def main() -> None:
    """Check the file in the arguments."""
    import mujoco  # noqa: F401 - what it takes is not the file's

    bounded(lambda: compile_and_step(Path(sys.argv[1])), SECONDS, MEGABYTES)


if __name__ == "__main__":
    main()
