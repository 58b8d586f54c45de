"""The tool on virtual surfaces: its laws, its energy, and what it cannot pass."""

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.contact import Contact
from haptic_accel.core.surfaces.material import Material
from haptic_accel.core.surfaces.scene import Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Plane
from haptic_accel.core.surfaces.tool import VirtualTool

RATE = 1000.0

WOOD = Material("wood", stiffness=2000.0, damping=5.0, static_friction=0.4, friction=0.3)
TABLE = Scene((SceneObject("table", Plane(), WOOD),))


def pressed(tool: VirtualTool, force: Vector, seconds: float) -> list[Contact | None]:
    return [tool.advance(force) for _ in range(round(seconds * RATE))]


def test_a_tool_at_rest_presses_with_the_motors_force() -> None:
    contact = pressed(VirtualTool(ToolParameters(), TABLE, RATE), (0.0, 0.0, -1.0), 0.5)[-1]
    assert contact is not None
    assert contact.object.name == "table"
    assert contact.normal == (0.0, 0.0, 1.0)
    assert contact.normal_force == pytest.approx(1.0, rel=1e-3)
    assert contact.depth == pytest.approx(1.0 / 2000.0, rel=1e-3)
    assert contact.speed == pytest.approx(0.0, abs=1e-6)
    assert not contact.sliding


def test_the_impact_is_told_once_with_its_speed() -> None:
    free = ToolParameters(viscous_friction=0.0, coulomb_friction=0.0, height=0.01)
    contacts = pressed(VirtualTool(free, TABLE, RATE), (0.0, 0.0, -1.0), 0.06)
    impacts = [each.impact_speed for each in contacts if each and each.impact_speed]
    # v^2 = 2 F h / m; known to half a sample of the motors' acceleration, 8 mm/s.
    assert impacts == [pytest.approx(np.sqrt(2 * 1.0 * 0.01 / 0.060), rel=0.05)]


@pytest.mark.parametrize(("pull", "slides"), [(0.38, False), (0.45, True)])
def test_it_sticks_within_the_cone_and_slides_beyond(pull: float, slides: bool) -> None:
    tool = VirtualTool(ToolParameters(coulomb_friction=0.0), TABLE, RATE)
    pressed(tool, (0.0, 0.0, -1.0), 0.5)
    for share in np.linspace(0.0, 1.0, 500).tolist():
        tool.advance((pull * share, 0.0, -1.0))
    contact = pressed(tool, (pull, 0.0, -1.0), 0.5)[-1]
    assert contact is not None
    assert contact.sliding == slides
    # Friction holds the pull, or has its sliding value; the joints' damping takes the rest.
    assert contact.force[0] == pytest.approx(-0.3 if slides else -pull, rel=1e-3)
    assert contact.speed == pytest.approx((pull - 0.3) / 3.0 if slides else 0.0, abs=1e-3)


def test_a_start_inside_of_an_object_is_refused() -> None:
    inside = Scene(TABLE.objects, start=(0.0, 0.0, -0.05), name="cellar")
    with pytest.raises(ParameterError, match="scene cellar: .* inside of 'table'"):
        VirtualTool(ToolParameters(), inside, RATE)
