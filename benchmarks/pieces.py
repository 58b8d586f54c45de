# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Costs of the pieces of a sample's way: ``pytest benchmarks/pieces.py``."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy

pytest.importorskip("pytest_benchmark")

from haptic_accel import Plant, Texture, TextureModel, Vector
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagWriter
from haptic_accel.controllers import CONTROLLERS
from haptic_accel.core import Compensation
from haptic_accel.core.axes import along_actuator
from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.handle.plant import MatrixPlant
from haptic_accel.core.rig.slave_rig import ToolParameters
from haptic_accel.core.surfaces.scene import Material, Scene, SceneObject
from haptic_accel.core.surfaces.shapes import Box, Cylinder, Plane, Shape, Sphere
from haptic_accel.core.surfaces.tool import VirtualTool
from haptic_accel.core.tick import PositionPositionCoupling
from haptic_accel.core.topics import TOOL_ACCELERATION
from haptic_accel.devices import MASTERS, SLAVES, Device
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.signals import Sender
from one_coil import OneCoil
from running import reserved_domain

pytestmark = pytest.mark.benchmark(max_time=0.1, min_rounds=5)

Benchmark = Any
"""pytest_benchmark.fixture.BenchmarkFixture, which may not be there."""

RATE = 1000.0

STAMP = 1_700_000_000_123_456_789
VECTOR = (0.1, -0.2, 0.3)

MESSAGES = 1000
"""Recorded in one round."""


def tone() -> Iterator[float]:
    """Yield an acceleration of 1 m/s^2 and 100 Hz, which is ten samples long, for ever."""
    return itertools.cycle([math.sin(2 * math.pi * index / 10) for index in range(10)])


def vectors() -> Iterator[Vector]:
    """Yield `tone` along the actuator's axis."""
    return map(along_actuator, tone())


def exploring(device_class: type[Device]) -> Callable[[], Any]:
    """Return what samples a device of which the arm presses and moves, tick by tick."""
    device = device_class(device_class.Parameters(), RATE, 0)
    device.open()
    device.write(0.0, arm_force=(0.5, 0.0, -1.0))
    device.read(0.1)  # until it moves; the first one prepares, which is no tick's cost
    ticks = itertools.count(round(0.1 * RATE) + 1)
    return lambda: device.read(next(ticks) / RATE)


@pytest.mark.parametrize("rate", [RATE, 4 * RATE])
@pytest.mark.parametrize("controller", list(CONTROLLERS))
def test_sample_of_the_compensation(benchmark: Benchmark, controller: str, rate: float) -> None:
    """Tool and handle move by `tone`."""
    compensation = OneCoil(CompensationParameters(controller=controller), rate)
    acceleration, handle = vectors(), vectors()
    compensation.process(next(acceleration), next(handle))
    _, force = benchmark(lambda: compensation.process(next(acceleration), next(handle)))
    assert all(map(math.isfinite, force))
    assert (compensation.guard.saturated, compensation.rejected) == (0, 0)


def coupled(rate: float) -> MatrixPlant:
    """Return three coils, each of which drives the axes of the others, at -20 dB for 30 ms."""
    pulse = np.exp(-np.arange(round(0.03 * rate)) / (0.01 * rate))
    coupling = 0.1 * pulse / pulse.sum() * np.ones((3, 3, 1))
    coupling[:, :, 0] += np.eye(3)
    return MatrixPlant((Plant(), Plant(), Plant()), coupling, rate)


@pytest.mark.parametrize("rate", [RATE, 4 * RATE])
@pytest.mark.parametrize("controller", list(CONTROLLERS))
def test_a_sample_of_three_coils_takes_at_most_six_samples_of_one(
    controller: str, rate: float
) -> None:
    """Three compensations with their decoupling, beside one of them; medians of both in turn."""
    around = CompensationParameters(controller)
    three = Compensation(around, rate, plant=coupled(rate))
    one = Compensation(around, rate)
    moments = np.random.default_rng(0).normal(size=(2000, 2, 3)).tolist()
    times = np.empty((len(moments), 2))
    for tool, handle in moments[:200]:
        three.process(tuple(tool), tuple(handle))
        one.process(tuple(tool), tuple(handle))
    for each, (tool, handle) in zip(times, moments, strict=True):
        tool, handle = tuple(tool), tuple(handle)
        begun = time.perf_counter()
        three.process(tool, handle)
        middle = time.perf_counter()
        one.process(tool, handle)
        each[:] = middle - begun, time.perf_counter() - middle
    together, alone = 1e6 * np.median(times, axis=0)
    print(f"{controller}: {together:.1f} us, {together / alone:.1f} times {alone:.1f} us")
    assert together < 6.0 * alone


@pytest.mark.parametrize("rate", [RATE, 4 * RATE])
def test_slow_work_of_the_adaptation(benchmark: Benchmark, rate: float) -> None:
    """Pieces done after a force was sent; most samples have none."""
    compensation = Compensation(CompensationParameters(controller="adaptive"), rate)
    acceleration, handle = vectors(), vectors()

    def taken() -> tuple[tuple[()], dict[str, Any]]:
        compensation.process(next(acceleration), next(handle))
        return (), {}

    benchmark.pedantic(compensation.adapt, setup=taken, rounds=4000)


@pytest.mark.parametrize(
    "device_class", [MASTERS["simulated"], SLAVES["simulated"]], ids=["master", "slave"]
)
def test_tick_of_a_simulated_device(benchmark: Benchmark, device_class: type[Device]) -> None:
    """The arm presses and moves it."""
    sample = benchmark(exploring(device_class))
    assert all(map(math.isfinite, (*sample.position, *sample.velocity, *sample.acceleration)))
    assert sample.position[0] != 0


@pytest.mark.parametrize("rate", [RATE, 4 * RATE, 10 * RATE])
def test_sample_of_a_texture(benchmark: Benchmark, rate: float) -> None:
    """As large as those of the Penn Haptic Texture Toolkit, at ever new speeds and forces."""
    random, nodes = np.random.default_rng(0), 57
    steps = np.cumsum(random.uniform(0.2, 1.0, (nodes, 21)), axis=1)
    model = TextureModel(
        "slate",
        rate,
        speeds=random.uniform(0.0, 0.3, nodes),
        forces=random.uniform(0.0, 4.0, nodes),
        lsf=steps[:, :-1] * np.pi / steps[:, -1:],
        deviation=random.uniform(0.1, 5.0, nodes),
    )
    texture = Texture(model, rate, seed=1)
    angles = (10 * tick / rate for tick in itertools.count())

    def slide() -> float:
        angle = next(angles)
        return texture.synthesize(0.15 * (1 + math.sin(angle)), 2 + 1.5 * math.cos(3 * angle))

    assert math.isfinite(benchmark(slide))


@pytest.mark.parametrize("stiffness", [2e3, 10e3])
def test_sample_of_a_tool_in_a_scene(benchmark: Benchmark, stiffness: float) -> None:
    """Ten objects; it slides over a plane, and past the others."""
    others: list[Shape] = [Sphere(), Box(), Cylinder()]
    shapes = [Plane(), *others * 3]
    material = Material(stiffness=stiffness)
    objects = (
        SceneObject(str(index), shape, material, (0.05 * index, 0.0, -0.01 if index else 0.0))
        for index, shape in enumerate(shapes)
    )
    tool = VirtualTool(ToolParameters(), Scene(tuple(objects)), RATE)
    ticks = itertools.count()
    for _ in range(200):  # until it has come down
        tool.advance((0.0, 0.0, -1.0))
    assert benchmark(lambda: tool.advance((math.cos(next(ticks) / 300), 0.2, -1.0)))
    if benchmark.stats:  # not with --benchmark-disable
        shares = (50.0, 99.0, 99.9)
        times = np.percentile(benchmark.stats.stats.data, shares) * 1e6
        print(*(f"p{share:g}: {each:.0f} us" for share, each in zip(shares, times, strict=True)))


def _quickest(scene: Scene) -> float:
    """Return the shortest time of a tool's sample, s, that moves to and fro on a scene."""
    tool = VirtualTool(ToolParameters(), scene, RATE)
    times = []
    for tick in range(4000):
        begun = time.perf_counter()
        tool.advance((0.3 * math.cos(tick / 100), 0.2 * math.sin(tick / 70), -1.0))
        times.append(time.perf_counter() - begun)
    return float(np.quantile(times[200:], 0.05))


@pytest.mark.parametrize("angle", [5.0, 15.0, 30.0, 60.0])
def test_sample_in_an_acute_groove_takes_at_most_four_samples_on_a_plane(angle: float) -> None:
    """20 us on a plane, and so at most 80 us in a groove: two planes, and a proxy between them."""
    steep = math.radians(90.0 - angle / 2)
    planes = [SceneObject("flat", Plane(), Material())]
    sides = [
        SceneObject(str(turn), Plane(), Material(), rotation=(0.0, turn, 0.0))
        for turn in (steep, -steep)
    ]
    ratio = _quickest(Scene(tuple(sides))) / _quickest(Scene(tuple(planes)))
    print(f"{angle:g} degrees: {ratio:.1f}")
    assert ratio < 4.0


def test_forces_of_the_coupling(benchmark: Benchmark) -> None:
    """One axis is displaced by 1 mm."""
    coupling = PositionPositionCoupling(CouplingParameters())
    origin: Vector = (0.0, 0.0, 0.0)
    coupling.engage(origin, origin)
    on_master, on_slave = benchmark(coupling.forces, (0.001, 0.0, 0.0), origin)
    # The paper's 0.25 N/mm each way.
    assert on_master[0] == pytest.approx(-0.25)
    assert on_slave[0] == pytest.approx(0.25)


def test_packing_of_a_message(benchmark: Benchmark) -> None:
    """An acceleration becomes bytes."""
    packed = benchmark(StampedVector(TOOL_ACCELERATION).pack, STAMP, VECTOR)
    assert unpack_stamped_vector(packed) == (STAMP, VECTOR)


def test_reading_of_a_message(benchmark: Benchmark) -> None:
    """Bytes become an acceleration."""
    packed = StampedVector(TOOL_ACCELERATION).pack(STAMP, VECTOR)
    assert benchmark(unpack_stamped_vector, packed) == (STAMP, VECTOR)


@pytest.fixture
def sender() -> Iterator[Sender]:
    """Sender of a node in a domain of its own."""
    with reserved_domain() as domain:
        rclpy.init(domain_id=domain)
        node = GraphNode("slave_device")
        yield Sender(node, TOOL_ACCELERATION)
        node.destroy_node()
        rclpy.shutdown()


def test_packing_and_publishing_of_a_message(benchmark: Benchmark, sender: Sender) -> None:
    """Nobody listens."""
    benchmark(sender.send, STAMP, VECTOR)
    assert sender.listeners == 0


def test_recording_of_a_thousand_messages(benchmark: Benchmark, tmp_path: Path) -> None:
    """From being put in to being in the file, which is finished."""
    message = StampedVector(TOOL_ACCELERATION).pack(STAMP, VECTOR)
    bags: list[BagWriter] = []

    def new_bag() -> tuple[tuple[BagWriter, Callable[[bytes], None]], dict[str, Any]]:
        bag = BagWriter(tmp_path / str(len(bags)), 2 * MESSAGES, RecordingOptions(), {})
        bags.append(bag)
        topic = TOOL_ACCELERATION
        return (bag, bag.connect(f"/{topic.name}", topic.type, [], sampled=True)), {}

    def record(bag: BagWriter, put: Callable[[bytes], None]) -> None:
        for _ in range(MESSAGES):
            put(message)
        bag.close()

    benchmark.extra_info["messages"] = MESSAGES
    benchmark.pedantic(record, setup=new_bag, rounds=5)
    assert {(bag.files.written, bag.dropped) for bag in bags} == {(MESSAGES, 0)}
