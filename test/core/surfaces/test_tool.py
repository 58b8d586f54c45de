# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tool on virtual surfaces: its laws, its energy, and what it cannot pass."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from haptic_accel.core.model import Vector, vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Box, Cylinder, HeightField, Plane, Shape, Sphere
from haptic_accel.core.surfaces.tool import Contact, VirtualTool

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


@pytest.mark.parametrize("height", [0.0003, 0.001, 0.003, 0.01])
def test_the_impact_is_told_once_with_its_speed(height: float) -> None:
    free = ToolParameters(viscous_friction=0.0, coulomb_friction=0.0, height=height)
    contacts = pressed(VirtualTool(free, TABLE, RATE), (0.0, 0.0, -1.0), 0.045)
    impacts = [each.impact_speed for each in contacts if each and each.impact_speed]
    # v^2 = 2 F h / m; known to half a step of the motors' acceleration, 4 mm/s.
    assert impacts == [pytest.approx(np.sqrt(2 * 1.0 * height / 0.060), abs=5e-3)]


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


def lossless(stiffness: float) -> Material:
    return Material(stiffness=stiffness, damping=0.0, static_friction=0.0, friction=0.0)


FREE = ToolParameters(viscous_friction=0.0, coulomb_friction=0.0)


def balance(
    tool: VirtualTool, stations: list[Vector], speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lead a tool along stations by a spring with the force of an arm's motors.

    Returns
    -------
    tuple of ndarray
        For each sample, J: energy of tool and contacts beyond the motors' work; energy lost by
        slips.
    """
    worked = 0.0
    beyond, slips = [0.0], [0.0]
    for start, end in itertools.pairwise([tool.position, *stations]):
        for share in np.linspace(0, 1, max(100, round(math.dist(start, end) / speed * RATE))):
            target = np.array(start) + share * np.subtract(end, start)
            before = np.array(tool.position)
            force = (800 * (target - before) - 8 * np.array(tool.velocity)).clip(-3.3, 3.3)
            tool.advance(vector(force))
            worked += force @ (np.array(tool.position) - before)
            beyond.append(tool.energy() - worked)
            slips.append(tool.slip_loss)
    return np.array(beyond), np.array(slips)


def given_out(beyond: np.ndarray) -> float:
    """Return the most energy that came out between any two moments, J."""
    return float((beyond - np.minimum.accumulate(beyond)).max())


HILLS = HeightField(np.random.default_rng(1).normal(0.0, 2e-3, (10, 10)), 8e-3)
ROUND = [
    *((0.0, 0.0, -0.002), (0.03, 0.0, -0.002), (0.03, 0.01, 0.01), (-0.02, -0.01, 0.0)),
    *((0.0, 0.02, -0.015), (0.0, -0.03, -0.004), (0.0, 0.0, 0.01)),
]


LIMIT = 0.2e-3
"""Most energy that contacts may give out, J (docs/surfaces.md)."""


def assert_nothing_comes_out_and_only_slips_lose(beyond: np.ndarray, slips: np.ndarray) -> None:
    assert given_out(beyond) <= LIMIT
    assert np.abs(beyond + slips).max() <= LIMIT
    assert np.diff(slips).min() >= 0.0


@pytest.mark.parametrize("stiffness", [300.0, 3000.0, 10e3])
@pytest.mark.parametrize(
    "shape", [Plane(), Sphere(0.02), Box(0.03, 0.03, 0.001), Cylinder(0.015, 0.02), HILLS]
)
def test_no_contact_gives_out_energy(shape: Shape, stiffness: float) -> None:
    low = 0.02 if isinstance(shape, Sphere) else 0.01 if isinstance(shape, Cylinder) else 0.0
    scene = Scene((SceneObject("one", shape, lossless(stiffness), (0.0, 0.0, -low)),))
    tool = VirtualTool(FREE, scene, RATE)
    assert_nothing_comes_out_and_only_slips_lose(*balance(tool, 2 * ROUND, 0.2))


def groove(angle: float, material: Material) -> Scene:
    """Return two planes that meet at an angle in degrees, open towards z."""
    slope = math.radians(90.0 - angle / 2)
    left, right = (
        SceneObject(name, Plane(), material, (0.0, 0.0, 0.0), (0.0, turn, 0.0))
        for name, turn in (("left", slope), ("right", -slope))
    )
    return Scene((left, right), start=(0.0, 0.0, 0.03))


IN_A_GROOVE: list[Vector] = [(0.0, 0.0, -4e-3), (4e-3, 0.01, 0.0), (-4e-3, -0.01, 0.0)]
IN_A_GROOVE += [(0.0, 0.0, 0.01)]


@pytest.mark.parametrize("stiffness", [300.0, 10e3])
@pytest.mark.parametrize("angle", [5.0, 30.0, 90.0, 180.0])
def test_where_nothing_can_slip_a_path_without_friction_keeps_all_energy(
    angle: float, stiffness: float
) -> None:
    tool = VirtualTool(FREE, groove(angle, lossless(stiffness)), RATE)
    beyond, slips = balance(tool, 5 * IN_A_GROOVE, 0.1)
    assert np.abs(beyond).max() < 0.02e-3
    assert abs(beyond[-1]) < 1e-9
    assert slips[-1] == 0.0


@pytest.mark.parametrize("stiffness", [300.0, 10e3])
@pytest.mark.parametrize("shape", [Plane(), Sphere(0.5)])
def test_a_fast_tool_bounces_for_half_a_minute_and_keeps_its_energy(
    shape: Shape, stiffness: float
) -> None:
    # 330 mJ: 3.3 m/s, 3.3 mm a sample.
    thrown = ToolParameters(viscous_friction=0.0, coulomb_friction=0.0, height=0.1)
    low = shape.distance(0.0, 0.0, 0.0)
    scene = Scene((SceneObject("floor", shape, lossless(stiffness), (0.0, 0.0, low)),))
    tool = VirtualTool(thrown, scene, RATE)
    for _ in range(30_000):
        tool.advance((0.0, 0.0, -3.3))
        assert tool.energy() + 3.3 * (tool.position[2] - 0.1) == pytest.approx(0.0, abs=LIMIT)
    assert tool.slip_loss == 0.0


def test_a_tool_that_slips_off_an_edge_loses_the_energy_of_the_spring() -> None:
    step = SceneObject("step", Box(0.1, 0.1, 0.1), lossless(300.0), (-0.05, 0.0, -0.05))
    tool = VirtualTool(FREE, Scene((step,), start=(-0.02, 0.0, 0.0)), RATE)
    over: list[Vector] = [(-0.02, 0.0, -0.012), (0.02, 0.0, -0.012)]
    _, slips = balance(tool, over, 0.05)
    # The motors' spring of 800 N/m and the object's of 300 N/m share 12 mm.
    depth = 0.012 * 800.0 / (800.0 + 300.0)
    assert slips[-1] == pytest.approx(300.0 / 2 * depth**2, rel=0.02)
    assert np.count_nonzero(np.diff(slips)) <= 2


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_no_scene_gives_out_energy(seed: int, rough: bool) -> None:
    random = np.random.default_rng(seed)

    def place() -> Vector:
        return vector(random.uniform(-0.03, 0.03, 3))

    shapes = random.permutation(
        np.array([Sphere(0.03), Box(0.03, 0.01, 0.02), Cylinder(0.01, 0.04), HILLS, Plane()])
    )

    def material() -> Material:
        stiffness = 10 ** random.uniform(2, 4)
        if not rough:
            return lossless(stiffness)
        static = random.uniform(0.0, 2.0)
        return Material(
            stiffness=stiffness,
            damping=random.uniform(0.0, 10.0),
            static_friction=static,
            friction=static * random.uniform(0.0, 1.0),
        )

    def placed(number: int, shape: Shape) -> SceneObject:
        if shape in (HILLS, Plane()):
            return SceneObject(str(number), shape, material(), (0.0, 0.0, -0.02))
        return SceneObject(
            str(number), shape, material(), place(), vector(random.uniform(-3, 3, 3))
        )

    objects = tuple(placed(*each) for each in enumerate(shapes[:4]))
    tool = VirtualTool(FREE, Scene(objects, start=(0.0, 0.0, 0.1)), RATE)
    way = [place() for _ in range(6)]
    speed = random.uniform(0.05, 0.5)
    beyond, slips = balance(tool, [*way, (0.0, 0.0, 0.1)], speed)
    assert given_out(beyond) <= LIMIT
    if not rough:
        assert_nothing_comes_out_and_only_slips_lose(beyond, slips)


def test_a_way_from_a_soft_object_onto_a_hard_one_gives_out_no_energy() -> None:
    # Flush: 5 mm of depth hold 4 mJ in the soft one, and would hold 125 mJ in the hard one.
    half = Box(0.05, 0.1, 0.04)
    objects = (
        SceneObject("soft", half, lossless(300.0), (-0.025, 0.0, -0.02)),
        SceneObject("hard", half, lossless(10e3), (0.025, 0.0, -0.02)),
    )
    way: list[Vector] = [(-0.02, 0.0, -0.01), (0.02, 0.0, -0.01), (0.02, 0.0, 0.02)]
    tool = VirtualTool(FREE, Scene(objects), RATE)
    assert_nothing_comes_out_and_only_slips_lose(*balance(tool, way, 0.1))


@pytest.mark.parametrize("mass", [0.001, 0.06, 1.0])
@pytest.mark.parametrize("damping", [0.0, 100.0])
def test_the_stiffest_contact_comes_to_rest_or_bounces_no_higher(
    mass: float, damping: float
) -> None:
    hard = Material(stiffness=10e3, damping=damping)
    tool = VirtualTool(
        ToolParameters(mass=mass, viscous_friction=0.0, coulomb_friction=0.0, height=0.002),
        Scene((SceneObject("floor", Plane(), hard),)),
        RATE,
    )
    heights = []
    for _ in range(500):
        tool.advance((0.0, 0.0, -1.0))
        heights.append(tool.position[2])
    assert max(heights) < 0.00205
    assert min(heights) > -5e-3


@pytest.mark.parametrize("height", [-0.01, 0.0, 0.005])
@pytest.mark.parametrize("stiffness", [500.0, 2000.0, 9000.0])
def test_the_force_does_not_jump_as_the_scene_changes(height: float, stiffness: float) -> None:
    tool = VirtualTool(ToolParameters(), TABLE, RATE)
    before = pressed(tool, (0.1, 0.0, -1.0), 0.5)[-1]
    other = SceneObject("box", Box(), Material(stiffness=stiffness), (0.0, 0.0, height - 0.01))
    place = tool.position
    tool.change_scene(Scene((other,)))
    after = tool.advance((0.1, 0.0, -1.0))
    assert before is not None
    assert after is not None
    assert after.object.name == "box"
    assert after.impact_speed == 0.0
    assert after.force == pytest.approx(before.force, abs=0.02)
    assert tool.position == pytest.approx(place, abs=1e-5)
    tool.return_to_start()
    assert tool.advance((0.0, 0.0, 0.0)) is None


def test_a_tool_in_the_air_is_never_inside_of_the_next_scene() -> None:
    tool = VirtualTool(ToolParameters(height=0.01), TABLE, RATE)
    high = SceneObject("table", Plane(), WOOD, (0.0, 0.0, 0.05))
    tool.change_scene(Scene((high,), start=(0.0, 0.0, 0.05)))
    assert pressed(tool, (0.0, 0.0, 0.0), 0.1)[-1] is None
    assert tool.position == (0.0, 0.0, 0.01)
    assert pressed(tool, (0.0, 0.0, -1.0), 0.1)[-1] is not None


def test_a_start_inside_of_an_object_is_refused() -> None:
    inside = Scene(TABLE.objects, start=(0.0, 0.0, -0.05), name="cellar")
    with pytest.raises(ParameterError, match="scene cellar: .* inside of 'table'"):
        VirtualTool(ToolParameters(), inside, RATE)
    tool = VirtualTool(ToolParameters(), TABLE, RATE)
    with pytest.raises(ParameterError, match="scene cellar"):
        tool.change_scene(inside)
    assert tool.scene is TABLE


def test_pulled_slowly_by_a_spring_it_sticks_and_slips() -> None:
    rubber = Material(stiffness=2000.0, damping=5.0, static_friction=1.0, friction=0.6)
    scene = Scene((SceneObject("mat", Plane(), rubber),))
    tool = VirtualTool(ToolParameters(viscous_friction=0.5, coulomb_friction=0.0), scene, RATE)
    pressed(tool, (0.0, 0.0, -1.0), 0.5)
    pulls, slid = [], []
    for tick in range(3000):
        pull = 100.0 * (0.01 * tick / RATE - tool.position[0])
        contact = tool.advance((pull, 0.0, -1.0))
        assert contact is not None
        pulls.append(pull)
        slid.append(contact.sliding)
    slips = np.flatnonzero(np.diff(np.array(slid).astype(int)) == 1)
    # It slips at 1 N, and beyond the middle at 0.6 N about as far as it came before it, less what
    # the damping takes: some 0.4 to 0.8 N of the spring each time, at 1 N/s.
    assert 3 <= len(slips) <= 7
    assert [pulls[tick] for tick in slips] == pytest.approx([1.0] * len(slips), abs=0.05)
    assert min(pulls[slips[0] :]) < 0.5


def test_the_motion_is_the_same_at_any_rate() -> None:
    ends, impacts = [], []
    for rate in (1000.0, 4000.0, 40e3):
        tool = VirtualTool(ToolParameters(), TABLE, rate)
        contacts = [tool.advance((0.3, 0.0, -1.0)) for _ in range(round(0.3 * rate))]
        ends.append(tool.position)
        impacts.append(next(each.impact_speed for each in contacts if each))
    for end, impact in zip(ends, impacts, strict=True):
        assert end == pytest.approx(ends[-1], abs=5e-5)
        assert impact == pytest.approx(impacts[-1], rel=0.03)
