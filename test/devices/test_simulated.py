# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated devices behind the interface of all devices."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.model import FloatArray, GripParameters
from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.core.rig import ArmParameters
from haptic_accel.core.rig.master_rig import ExplorationParameters, MasterRigParameters
from haptic_accel.core.rig.slave_rig import SurfaceParameters, ToolParameters
from haptic_accel.core.surfaces.texture import TextureModel
from haptic_accel.devices import Device, Sample, simulated
from haptic_accel.materials.texture_files import write_texture

RATE = 1000.0
PERIOD = 1 / RATE

few = settings(deadline=None, max_examples=20)
BOTH = [simulated.SimulatedMaster, simulated.SimulatedSlave]
both = pytest.mark.parametrize("device_class", BOTH)


def opened(device_class: type[Device], seed: int = 0, **fields: Any) -> Device:
    parameters = dataclasses.replace(device_class.Parameters(), **fields)
    device = device_class(parameters, RATE, seed)
    device.open()
    return device


def read(device: Device, first: int, last: int, origin: float = 0.0) -> list[Sample]:
    return [device.read(origin + index * PERIOD) for index in range(first, last)]


def answers(device: Device, waiting: int, origin: float, rate: float) -> list[Sample]:
    """Return the samples after the first force, which comes at the tick after some waiting."""
    ticks = [origin + index / rate for index in range(waiting + 120)]
    for tick in ticks[: waiting + 1]:
        device.read(tick)
    samples = []
    for tick, after in pairwise(ticks[waiting:]):
        device.write(tick, arm_force=(0.3, 0.0, -1.0), actuator_force=along_actuator(0.4))
        samples.append(device.read(after))
    return samples


@both
@pytest.mark.parametrize("frame", [2, 4, 7])
def test_forces_written_ahead_act_when_they_are_due(
    device_class: type[Device], frame: int
) -> None:
    at_once, ahead = opened(device_class), opened(device_class)
    generator = np.random.default_rng(3)
    forces = generator.normal(0.0, 0.5, (120, 2)).tolist()
    expected = []
    for tick, (arm, actuator) in enumerate(forces):
        expected.append(at_once.read(tick * PERIOD))
        along = along_actuator(actuator)
        at_once.write(tick * PERIOD, arm_force=(arm, 0.0, -1.0), actuator_force=along)
    found = [ahead.read(0.0)]
    for tick, (arm, actuator) in enumerate(forces):
        due = tick * PERIOD
        ahead.write(due, arm_force=(arm, 0.0, -1.0))
        ahead.write(due, actuator_force=along_actuator(actuator))
        if tick >= frame:
            found.append(ahead.read((tick - frame + 1) * PERIOD))
    found += read(ahead, len(found), len(forces))
    assert found == expected


def test_an_overdue_force_discards_those_not_due_yet() -> None:
    device = opened(simulated.SimulatedMaster)
    device.read(0.0)
    device.write(0.005, actuator_force=along_actuator(1.0))
    device.write(0.002, actuator_force=along_actuator(0.0))
    moved = [device.read(index * PERIOD) for index in range(1, 20)]
    assert {sample.acceleration for sample in moved} == {moved[0].acceleration}


# Reading


@both
def test_before_its_first_force_every_sample_is_the_same(device_class: type[Device]) -> None:
    device, other = opened(device_class, seed=1), opened(device_class, seed=2)
    device.write(0.0, actuator_force=along_actuator(0.0))
    assert set(read(device, 0, 300)) == set(read(other, 0, 1))


@few
@given(
    st.sampled_from([simulated.SimulatedMaster, simulated.SimulatedSlave]),
    st.integers(0, 400),
    st.floats(0.0, 2e9),
    st.sampled_from([333.0, 1000.0, 3000.0, 4000.0]),
)
def test_how_long_it_stood_still_changes_no_bit(
    device_class: type[Device], waiting: int, origin: float, rate: float
) -> None:
    # Close to the surface, so that the tool is dragged over its texture.
    low = {"tool.height": 1e-4, "surface.roughness": 5e-6}
    known = schema(device_class.Parameters)
    values = {name: value for name, value in low.items() if name in known}
    parameters = from_flat(device_class.Parameters, values)
    one, other = (device_class(parameters, rate, 3) for _ in range(2))
    for device in (one, other):
        device.open()
    assert answers(one, waiting, origin, rate) == answers(other, 0, 0.0, rate)


@both
def test_the_seed_decides_about_the_noise(device_class: type[Device]) -> None:
    devices = [opened(device_class, seed) for seed in (3, 3, 4)]
    for device in devices:
        device.write(0.0, arm_force=(0.0, 0.0, 0.0))
    one, same, other = (read(device, 1, 20) for device in devices)
    assert one == same
    assert one != other


# Writing

offsets = st.lists(st.floats(0.0, 1.0), max_size=4).map(sorted)


@both
@few
@given(parts=offsets)
def test_writing_the_same_force_in_between_changes_no_motion(
    device_class: type[Device], parts: list[float]
) -> None:
    exact = ArmParameters(position_resolution=0.0)
    quiet, busy = (opened(device_class, arm=exact) for _ in range(2))
    forces = {"arm_force": (0.3, 0.0, -0.8), "actuator_force": along_actuator(0.4)}
    quiet.write(0.0, **forces)
    busy.write(0.0, **forces)
    lowest, is_master = 0.0, device_class is simulated.SimulatedMaster
    for index in range(100 if is_master else 300):
        for part in parts:
            busy.write((index + part) * PERIOD, **forces)
        one, other = quiet.read((index + 1) * PERIOD), busy.read((index + 1) * PERIOD)
        lowest = min(lowest, one.position[2])
        # The slave by no more than its integration errs.
        assert other.position == pytest.approx(one.position, abs=1e-12 if is_master else 2e-6)
        if is_master:
            assert other.velocity == pytest.approx(one.velocity, abs=1e-12)
            expected = pytest.approx(one.acceleration[ACTUATOR_AXIS], abs=2e-3)
            assert other.acceleration[ACTUATOR_AXIS] == expected
    assert is_master or lowest < 0, "it has touched the surface"


@pytest.mark.parametrize("part", [0.0, 0.2, 0.5, 0.9])
def test_a_force_acts_from_the_moment_it_is_written(part: float) -> None:
    still = ExplorationParameters(0.0, 0.6, 0.0, 0.0, stroke_length=0.001, strokes=1)
    device = opened(simulated.SimulatedMaster, exploration=still)
    read(device, 0, 10)
    device.write((9 + part) * PERIOD, arm_force=(1.0, 0.0, 0.0))
    # 0.146 kg; grip and damping have hardly begun to answer.
    velocity = device.read(10 * PERIOD).velocity[0]
    assert velocity == pytest.approx(1.0 / 0.146 * (1 - part) * PERIOD, rel=0.06)


def test_what_is_not_written_stays_as_it_is() -> None:
    alone, both_forces = opened(simulated.SimulatedMaster), opened(simulated.SimulatedMaster)
    alone.write(0.0, arm_force=(0.5, 0.0, 0.0), actuator_force=along_actuator(0.3))
    alone.write(0.0, arm_force=(0.1, 0.0, 0.0))
    alone.write(0.0, actuator_force=along_actuator(0.6))
    both_forces.write(0.0, arm_force=(0.1, 0.0, 0.0), actuator_force=along_actuator(0.6))
    assert read(alone, 0, 50) == read(both_forces, 0, 50)


@both
def test_a_command_that_is_no_number_gives_no_force(device_class: type[Device]) -> None:
    nan, zero = opened(device_class), opened(device_class)
    nan.write(0.0, arm_force=(math.nan,) * 3, actuator_force=along_actuator(math.nan))
    zero.write(0.0, arm_force=(0.0, 0.0, 0.0), actuator_force=along_actuator(0.0))
    assert read(nan, 0, 50) == read(zero, 0, 50)


def test_status_counts_what_was_cut() -> None:
    device = opened(simulated.SimulatedMaster)
    device.write(0.0, actuator_force=along_actuator(10.0))
    assert device.counters()["actuator_saturated"] == 1
    assert set(opened(simulated.SimulatedSlave).counters()) == {"accelerometer_saturated"}


# Changing


@pytest.mark.parametrize("device_class", [*BOTH, simulated.VirtualSlave])
def test_what_can_be_changed_is_among_the_parameters(device_class: type[Device]) -> None:
    assert device_class.description.changeable
    assert set(device_class.description.changeable) <= set(schema(device_class.Parameters))


def test_a_slave_goes_on_on_another_surface() -> None:
    soft = SurfaceParameters(stiffness=1e4)
    device, hard = opened(simulated.SimulatedSlave), opened(simulated.SimulatedSlave)
    device.change(simulated.SimulatedSlaveParameters(surface=soft))
    for one in (device, hard):
        one.write(0.0, arm_force=(0.0, 0.0, -1.0))
    # 1 N into 1e4 N/m^1.5: (1e-4)^(2/3) m, 2.2 mm below the hard one.
    depth = read(hard, 1, 600)[-1].position[2] - read(device, 1, 600)[-1].position[2]
    assert depth == pytest.approx(1e-4 ** (2 / 3), rel=0.05)


def test_a_texture_adds_to_a_surface_and_a_wrong_one_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    plane = {"speeds": np.array([0.0, 0.5, 0.0, 0.5]), "forces": np.array([0.0, 0.0, 5.0, 5.0])}
    lsf = np.tile(math.pi * np.array([1.0, 2.0]) / 3, (4, 1))  # those of white noise
    deviation = np.array([0.0, 0.0, 0.0, 20.0])
    write_texture(file, TextureModel("mine", RATE, lsf=lsf, deviation=deviation, **plane))

    def stroked(device: Device) -> FloatArray:
        device.open()
        device.write(0.0, arm_force=(1.0, 0.0, -1.0))
        samples = [device.read(index / 1000) for index in range(300)]
        return np.array([sample.acceleration[ACTUATOR_AXIS] for sample in samples])

    smooth = simulated.SimulatedSlaveParameters()
    textured = dataclasses.replace(smooth, surface=SurfaceParameters(texture=str(file)))
    plain, rough = (simulated.SimulatedSlave(each, 1000.0, 0) for each in (smooth, textured))
    assert stroked(rough)[150:].std() > 3 * stroked(plain)[150:].std()
    plain.change(textured)
    assert plain.read(0.3).acceleration[ACTUATOR_AXIS] != 0.0
    with pytest.raises(ParameterError, match="texture = 'slate': must be one of"):
        plain.change(dataclasses.replace(smooth, surface=SurfaceParameters(texture="slate")))


def test_a_master_is_held_otherwise() -> None:
    device = opened(simulated.SimulatedMaster)
    device.change(MasterRigParameters(grip=GripParameters(posture="pinch")))
    pinched = opened(simulated.SimulatedMaster, grip=GripParameters(posture="pinch"))
    for one in (device, pinched):
        one.write(0.0, arm_force=(0.0, 0.0, 1.0))
    assert read(device, 1, 100) == read(pinched, 1, 100)


def test_under_a_recording_the_surface_stays(recording: Path) -> None:
    played = simulated.RecordingParameters(str(recording), rate=500.0, column="z")
    playing = simulated.SimulatedSlaveParameters(recording=played)
    device = simulated.SimulatedSlave(playing, RATE, 0)
    with pytest.raises(ParameterError, match="surface: cannot be changed while a recording"):
        device.change(dataclasses.replace(playing, surface=SurfaceParameters(friction=1.0)))


# Closing


@both
def test_closing_leaves_no_force(device_class: type[Device]) -> None:
    closed, zero = opened(device_class), opened(device_class)
    closed.write(0.0, arm_force=(0.5, 0.0, 1.0), actuator_force=along_actuator(1.0))
    closed.close()
    zero.write(0.0, arm_force=(0.0, 0.0, 0.0), actuator_force=along_actuator(0.0))
    assert read(closed, 0, 50) == read(zero, 0, 50)


# Recordings


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Return a file with two seconds of a 20 Hz sine of 3 m/s^2 at 500 Hz."""
    path = tmp_path / "recording.csv"
    time = np.arange(1000) / 500.0
    rows = [f"{t:.4f},{3.0 * math.sin(2 * math.pi * 20.0 * t):.6f}" for t in time.tolist()]
    path.write_text("\n".join(["time,z", *rows]) + "\n", encoding="utf-8")
    return path


def test_a_slave_plays_a_recording_resampled(recording: Path) -> None:
    played = simulated.RecordingParameters(str(recording), rate=500.0, column="z")
    parameters = simulated.SimulatedSlaveParameters(recording=played)
    device = simulated.SimulatedSlave(parameters, RATE, 0)
    device.open()
    device.write(0.0, arm_force=(0.0, 0.0, 0.0))
    samples = read(device, 1, 8001)
    acceleration = np.array([sample.acceleration[ACTUATOR_AXIS] for sample in samples])
    # Two seconds over and over, still a sine of 20 Hz. Where end and beginning fade into each
    # other with equal power, two sines in phase are up to sqrt(2) times as high.
    assert np.percentile(np.abs(acceleration), 90) == pytest.approx(2.96, rel=0.03)
    assert np.abs(acceleration).max() < 3.0 * math.sqrt(2) * 1.01
    spectrum = np.abs(np.fft.rfft(acceleration))
    assert spectrum.argmax() == pytest.approx(20 * 8, abs=8)
    assert np.abs(np.diff(acceleration)).max() < 1.5 * 3.0 * 2 * math.pi * 20.0 * PERIOD


def test_a_slave_plays_a_recording_of_three_axes(tmp_path: Path) -> None:
    sines = np.sin(2 * np.pi * np.outer(np.arange(1000), (20.0, 30.0, 50.0)) / 500.0)
    path = tmp_path / "three.csv"
    np.savetxt(path, sines, delimiter=",", header="ay,ax,az", comments="")
    found = simulated.played(simulated.RecordingParameters(str(path), 500.0, "ax, ay,az"), 1000.0)
    assert found is not None
    assert found.shape == (1950, 3)
    expected = np.sin(2 * np.pi * np.outer(np.arange(2000), (30.0, 20.0, 50.0)) / 1000.0)
    # The begin is faded over the end, and the edges of the resampling ring.
    assert found[100:-150] == pytest.approx(expected[150:-150], abs=1e-2)
    recording = simulated.RecordingParameters(str(path), 1000.0, "ax,ay,az")
    tool = ToolParameters(axes="x, y, z")
    slave = opened(simulated.SimulatedSlave, recording=recording, tool=tool)
    slave.write(0.0, arm_force=(0.0, 0.0, 0.0))
    moved = [sample.acceleration for sample in read(slave, 1, 900)]
    assert np.array_equal(moved, simulated.played(recording, 1000.0)[:899])
    with pytest.raises(ParameterError, match=r"three\.csv: column = .*: must be one column, as"):
        opened(simulated.SimulatedSlave, recording=recording)


UNFIT = [("missing.csv", 500.0, "z"), ("recording.csv", 250.0, "z"), ("recording.csv", 500.0, "y")]


@pytest.mark.parametrize(("file", "rate", "column"), UNFIT)
def test_an_unusable_recording_is_refused_in_one_line(
    recording: Path, file: str, rate: float, column: str
) -> None:
    wrong = simulated.RecordingParameters(str(recording.with_name(file)), rate, column)
    with pytest.raises(ParameterError) as caught:
        simulated.SimulatedSlave(simulated.SimulatedSlaveParameters(recording=wrong), RATE, 0)
    assert len(str(caught.value).splitlines()) == 1


def test_a_device_opened_again_goes_on() -> None:
    device = simulated.SimulatedSlave(simulated.SimulatedSlaveParameters(), 1000.0, 0)
    device.open()
    device.write(5.0, arm_force=(0.0, 0.0, -1.0))
    before = device.read(5.02).position
    device.close()
    device.open()
    device.write(100.0, arm_force=(0.0, 0.0, -1.0))
    assert device.read(100.02).position[2] < before[2]


# Leading the hand


def test_a_pointer_leads_the_hand_of_the_simulated_master() -> None:
    device = opened(simulated.PointerMaster)
    device.write(0.0, arm_force=(0.0, 0.0, 0.0))
    resting = read(device, 1, 200)[-1].position
    assert resting == pytest.approx((0.0, 0.0, 0.01), abs=1e-4)
    for index in range(200, 800):
        device.read(index * PERIOD)
        device.point((0.03, 0.0, -0.005))
        device.write(index * PERIOD, arm_force=(0.0, 0.0, 0.0))
    assert device.read(800 * PERIOD).position == pytest.approx((0.03, 0.0, -0.005), abs=1e-4)


def test_a_hand_that_was_led_rests_where_it_began_once_let_go() -> None:
    device = opened(simulated.PointerMaster)
    device.write(0.0, arm_force=(0.0, 0.0, 0.0))
    device.point((0.05, 0.0, 0.0))
    assert read(device, 1, 150)[-1].position[0] > 0
    assert read(device, 150, 600)[-1].position == pytest.approx((0.0, 0.0, 0.01), abs=1e-4)
