# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""High-pass, controller and limits as one: limits hold, no bad sample stays, no change is felt."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from band_noise import band_noise
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import signal

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control import channel as module
from haptic_accel.core.control.channel import FADING, LISTENING, RAMP, build_controller
from haptic_accel.core.control.compensation import LARGEST_ACCELERATION, CompensationParameters
from haptic_accel.core.control.controllers import CONTROLLERS, Controller, Loop
from haptic_accel.core.control.controllers.fixed import ConstantParameters
from haptic_accel.core.control.filters import check_corner, high_pass, inverse_of
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import GRAVITY, ApproximateModel, FloatArray, HandleParameters
from haptic_accel.core.parameters import Checked, ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.devices.simulated import SimulatedMaster
from one_coil import OneCoil

# Compiled objects cannot be copied.
pytestmark = pytest.mark.plain

RATE = 1000.0
NAMES = tuple(CONTROLLERS)
PAIRS = list(zip(NAMES, NAMES[1:] + NAMES[:1], strict=True))
"""Each controller once as the one that leaves, and once as the one that comes."""

COIL = ActuatorParameters()
UNLIMITED = ActuatorParameters(travel=0.1, continuous_force=100.0)
"""Limits of travel and heat for tests that are not about them."""

STIFF = Plant(handle=HandleParameters(k_s=1e4, b_s=20.0))
"""An actuator that no force moves far."""

untimed = settings(deadline=None)
controllers = st.sampled_from(NAMES)
signals = arrays.arrays(np.float64, st.integers(1, 200), elements=st.floats(-20.0, 20.0))
# Infinity, NaN and the largest numbers as often as ordinary ones, and steps of a hundred g.
numbers = st.one_of(
    st.floats(-50.0, 50.0),
    st.floats(),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 0.0]),
    st.sampled_from([100 * GRAVITY, -100 * GRAVITY, LARGEST_ACCELERATION, 5 * GRAVITY]),
)
peaks = st.one_of(st.just(0.0), st.floats(1e-3, 10.0))


@lru_cache
def built(controller: str, rate: float, soon: bool) -> OneCoil:
    """Build a compensation with all controllers, once: a design takes its time."""
    with pytest.MonkeyPatch.context() as patch:
        if soon:
            patch.setattr(module, "LISTENING", 6 / rate)
        return OneCoil(CompensationParameters(controller), rate, prepared=NAMES)


def compensation(controller: str, rate: float = RATE, *, soon: bool = False) -> OneCoil:
    """Return one that no other test has, where asked for one whose controllers listen briefly."""
    return woken(copy.deepcopy(built(controller, rate, soon)))


def woken(stream: OneCoil) -> OneCoil:
    """Return a compensation that was at rest at zero, after the least motion of the handle."""
    stream.sample(0.0, 0.0)
    stream.sample(0.0, 5e-324)
    return stream


@lru_cache
def designed(name: str) -> Controller:
    return build_controller(name, Loop(RATE))


def unlimited(controller: str, **limits: float) -> OneCoil:
    actuator = replace(UNLIMITED, **limits)
    around = CompensationParameters(controller)
    return woken(OneCoil(around, RATE, {"actuator": actuator, "plant": STIFF}))


def answers(
    of: OneCoil, tool_acceleration: Iterable[float], handle: float | None = None
) -> FloatArray:
    """Return desired accelerations and forces."""
    return np.array([of.sample(float(value), handle) for value in tool_acceleration])


def forces(of: OneCoil, tool_acceleration: list[float]) -> list[float]:
    return [of.sample(value, 0.0)[1] for value in tool_acceleration]


def texture(seconds: float) -> FloatArray:
    """Return noise from 60 to 200 Hz, 1.5 m/s^2 RMS, under gravity."""
    return GRAVITY + band_noise(60.0, 200.0, seconds, 1.5)


# Ordinary samples


@pytest.mark.parametrize("controller", ["none", "constant", "dynamic"])
@pytest.mark.parametrize(("rate", "corner"), [(1000.0, 15.0), (4000.0, 15.0), (1000.0, 100.0)])
@untimed
@given(values=signals)
def test_samples_give_what_the_whole_signal_gives(
    controller: str, rate: float, corner: float, values: FloatArray
) -> None:
    desired = signal.sosfilt(high_pass(corner, rate), values)
    force = {
        "none": np.zeros_like(values),
        "constant": 0.128 * desired,
        "dynamic": signal.sosfilt(inverse_of(ApproximateModel(), rate), desired),
    }[controller]
    around = CompensationParameters(controller, high_pass_frequency=corner)
    stream = woken(OneCoil(around, rate, {"actuator": UNLIMITED}))
    output = answers(stream, values, 0.0)
    assert output[:, 0] == pytest.approx(desired, abs=1e-9)
    assert output[:, 1] == pytest.approx(
        np.clip(force, -COIL.peak_force, COIL.peak_force), abs=1e-9
    )
    assert stream.rejected == 0


def test_parameters_reach_the_controller_they_are_for() -> None:
    heavy: dict[str, Checked] = {"constant": ConstantParameters(1.0)}
    for controller, gain in (("constant", 1.0), ("none", 0.0)):
        stream = woken(OneCoil(CompensationParameters(controller), RATE, heavy))
        desired, force = stream.sample(1.0, 0.0)
        assert force == gain * desired


def test_reset_forgets_the_past() -> None:
    used, fresh = compensation("dynamic"), compensation("dynamic")
    forces(used, [1.0, -2.0, 3.0])
    used.reset()
    woken(used)
    assert forces(used, [1.0, 2.0, 3.0]) == forces(fresh, [1.0, 2.0, 3.0])


# At rest


@pytest.mark.parametrize("controller", NAMES)
@settings(deadline=None, max_examples=5)
@given(
    waiting=st.integers(0, 1500),
    tool=st.sampled_from([0.0, GRAVITY, -3.0]),
    handle=st.sampled_from([0.0, 6.9]),
    missing=st.floats(0.0, 0.9),
)
def test_how_long_it_waited_at_rest_changes_no_bit(
    controller: str, waiting: int, tool: float, handle: float, missing: float
) -> None:
    random = np.random.default_rng(waiting)
    waited, started = (copy.deepcopy(built(controller, RATE, soon=False)) for _ in range(2))
    for stream, samples in ((waited, waiting), (started, 0)):
        assert stream.sample(tool, handle) == (0.0, 0.0)
        for _ in range(samples):
            absent = random.random() < missing
            assert stream.sample(tool, None if absent else handle) == (0.0, 0.0)
            stream.adapt()
    moving = (texture(1.0) - GRAVITY + tool).tolist()
    for index, value in enumerate(moving):
        felt = None if index % 50 == 7 else handle + 0.8 * moving[index - 1]
        assert waited.sample(value, felt) == started.sample(value, felt)
        waited.adapt()
        started.adapt()
    assert waited.diagnostics() == started.diagnostics()


@pytest.mark.parametrize("controller", NAMES)
def test_gravity_is_no_blow_to_who_wakes(controller: str) -> None:
    stream = copy.deepcopy(built(controller, RATE, soon=False))
    noise = np.random.default_rng(0).normal(0.0, 1e-6, (2, 2000)).tolist()
    for tool, handle in zip(*noise, strict=True):
        assert abs(stream.sample(GRAVITY + tool, 6.9 + handle)[1]) < 1e-3


def test_who_is_selected_before_anything_moves_is_there_from_the_beginning() -> None:
    stream, begun = (copy.deepcopy(built(name, RATE, soon=False)) for name in ("none", "constant"))
    stream.sample(0.0, 0.0)
    stream.select("constant")
    values = texture(0.1).tolist()
    assert forces(stream, values) == forces(begun, [0.0, *values])[1:]


# The actuator's limits


def test_a_force_beyond_the_peak_is_cut_and_counted() -> None:
    stream = unlimited("constant")
    # 6.6 N / 0.128 kg = 51.6 m/s^2, of which the first sample passes 88 %.
    found = []
    for tool in (50.0, 100.0, -100.0):
        found.append((stream.sample(tool, 0.0)[1], stream.guard.saturated))
        stream.reset()
        woken(stream)
    assert found[0][0] < COIL.peak_force
    assert found == [(found[0][0], 0), (6.6, 1), (-6.6, 2)]


@untimed
@given(arrays.arrays(np.float64, 50, elements=st.floats(-500.0, 500.0)), peaks)
@example(np.array([-368.0] * 36 + [158.0] + [-368.0] * 13), 6.0)
def test_exactly_the_forces_beyond_the_peak_are_cut(values: FloatArray, peak: float) -> None:
    # A spring that 100 N move by a tenth of the free travel, so that travel limits neither.
    limited, free = (unlimited("dynamic", peak_force=most, k_s=1e4) for most in (peak, 100.0))
    cut = 0
    for force, wanted in zip(
        forces(limited, values.tolist()), forces(free, values.tolist()), strict=True
    ):
        assert abs(force) <= peak
        assert force == pytest.approx(min(peak, max(-peak, wanted)))
        cut += abs(wanted) > peak
    assert limited.guard.saturated == cut


# Samples that are none


@pytest.mark.parametrize("controller", NAMES)
@untimed
@given(data=st.data())
def test_whatever_comes_in_the_force_is_finite_and_limited(
    controller: str, data: st.DataObject
) -> None:
    stream = compensation(controller, soon=True)
    moment = st.tuples(
        numbers, st.one_of(st.none(), numbers), st.one_of(st.none(), st.none(), controllers)
    )
    for tool, handle, selected in data.draw(st.lists(moment, max_size=60)):
        if selected:
            stream.select(selected)
        desired, force = stream.sample(tool, handle)
        stream.adapt()
        assert math.isfinite(desired)
        assert abs(force) <= COIL.peak_force
    warning, values = stream.diagnostics()
    assert isinstance(warning, str)
    assert all(isinstance(value, str) for value in values.values())


@pytest.mark.parametrize("controller", NAMES)
def test_nor_does_any_long_stream_that_changes_controllers_all_the_time(controller: str) -> None:
    random = np.random.default_rng(7)
    stream = compensation(controller)
    tools = random.standard_cauchy(20_000) * 10.0
    tools[random.random(20_000) < 0.01] = math.nan
    # A second of steps of a hundred g, a second of silence.
    tools[5000:6000] = 100 * GRAVITY * np.sign(np.sin(np.arange(1000) / 20))
    tools[7000:8000] = 0.0
    handles = random.standard_cauchy(20_000) * 5.0
    heat, weight = 0.0, 1e-4
    for index, (tool, handle) in enumerate(zip(tools.tolist(), handles.tolist(), strict=True)):
        if random.random() < 1 / 300:
            stream.select(NAMES[random.integers(len(NAMES))])
        desired, force = stream.sample(tool, None if index % 1000 < 50 else handle)
        stream.adapt()
        assert math.isfinite(desired)
        assert abs(force) <= COIL.peak_force
        heat += weight * (force**2 - heat)
    assert heat < 2.2**2 * 1.001
    _, values = stream.diagnostics()
    assert not any("nan" in value or "inf" in value for value in values.values())


@pytest.mark.parametrize("controller", NAMES)
def test_silence_stays_silent_with_or_without_a_handle(controller: str) -> None:
    for handle in (None, 0.0):
        stream = compensation(controller)
        assert {stream.sample(0.0, handle) for _ in range(500)} == {(0.0, 0.0)}


@pytest.mark.parametrize("controller", NAMES)
def test_a_handle_that_is_missing_or_at_its_sensors_range_is_not_believed(controller: str) -> None:
    streams = [compensation(controller) for _ in range(3)]
    absent = (None, 5 * GRAVITY, -6 * GRAVITY)
    values = texture(0.3).tolist()
    outputs = [
        [stream.sample(value, handle) for value in values]
        for stream, handle in zip(streams, absent, strict=True)
    ]
    assert outputs[0] == outputs[1] == outputs[2]
    assert [stream.untrusted for stream in streams] == [300] * 3
    assert [stream.rejected for stream in streams] == [0] * 3


@untimed
@given(controllers, st.lists(numbers))
def test_a_sample_that_is_not_finite_or_absurd_counts_as_zero(
    controller: str, values: list[float]
) -> None:
    stream, clean = compensation(controller), compensation(controller)
    replaced = [value if abs(value) <= LARGEST_ACCELERATION else 0.0 for value in values]
    assert [stream.sample(v, 0.0) for v in values] == [clean.sample(v, 0.0) for v in replaced]
    absurd = [value for value in values if not abs(value) <= LARGEST_ACCELERATION]
    assert stream.rejected == len(absurd)


def test_a_handle_acceleration_that_is_not_finite_is_counted_too() -> None:
    stream = compensation("dynamic")
    stream.sample(1.0, math.nan)
    stream.sample(math.inf, -math.inf)
    assert (stream.rejected, stream.untrusted) == (1, 2)


# What is refused


@pytest.mark.parametrize("rate", [0.0, -1000.0, 29.0, 30.0, math.nan])
def test_a_rate_too_low_for_the_high_pass_is_refused(rate: float) -> None:
    with pytest.raises(
        ParameterError, match=r"^rate = \S+: must be above twice high_pass_frequency = 15 Hz$"
    ):
        compensation("dynamic", rate)
    with pytest.raises(ParameterError, match="high_pass_frequency = 15 Hz$"):
        check_corner(rate, CompensationParameters().high_pass_frequency)


def test_a_rate_just_above_is_not() -> None:
    check_corner(31.0, CompensationParameters().high_pass_frequency)
    assert compensation("dynamic", 31.0).sample(0.0, 0.0) == (0.0, 0.0)


# Another controller takes over

LISTENED, FADED = round(LISTENING * RATE), round(FADING * RATE)
BEFORE = 400
"""Samples before another controller is selected."""


class Recorded(Controller):
    """A controller whose own forces are kept."""

    def __init__(self, inner: Controller, loop: Loop) -> None:
        self.inner = inner
        self.forces: list[float] = []

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        self.forces.append(self.inner.force(desired_acceleration, measured_acceleration))
        return self.forces[-1]

    def applied(self, actuator_force: float) -> None:
        self.inner.applied(actuator_force)

    def reset(self) -> None:
        self.inner.reset()


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_the_force_does_not_jump_when_another_takes_over(
    one: str, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    own: dict[str, Recorded] = {}

    def recorded(name: str, loop: Loop, parameters: Checked | None = None) -> Controller:
        own[name] = Recorded(copy.deepcopy(designed(name)), loop)
        return own[name]

    monkeypatch.setattr(module, "build_controller", recorded)
    stream = OneCoil(CompensationParameters(one), RATE, {"actuator": UNLIMITED}, (other,))
    woken(stream)
    own[one].forces.clear()
    values = texture(1.2).tolist()
    found = forces(stream, values[:BEFORE])
    stream.select(other)
    assert stream.controller == other
    found += forces(stream, values[BEFORE:])
    assert stream.guard.saturated == 0
    at = BEFORE + LISTENED
    assert found[:at] == own[one].forces[:at]
    end = at + FADED
    assert len(own[one].forces) == end
    assert found[end - 1 :] == own[other].forces[end - 1 - BEFORE :]
    leaving, coming = np.array(own[one].forces[at - 1 :]), np.array(own[other].forces)
    coming = coming[LISTENED - 1 : LISTENED + FADED]
    steps = np.maximum(np.abs(np.diff(leaving)), np.abs(np.diff(coming)))
    apart = np.abs(coming - leaving)
    allowed = steps + np.maximum(apart[1:], apart[:-1]) / FADED
    assert (np.abs(np.diff(found[at - 1 : end])) <= allowed + 1e-12).all()
    assert np.diff(found[at - 1 : end]).any() or one == other


BEGUN = 3000
"""Samples until the step of gravity at the very beginning is over, which none share."""


@lru_cache
def alone(controller: str) -> FloatArray:
    """Return what a controller that was always there gives."""
    return answers(compensation(controller), texture(5.0), 0.0)


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_afterwards_it_is_as_if_the_other_had_always_been_there(one: str, other: str) -> None:
    stream = compensation(one)
    values = texture(5.0).tolist()
    forces(stream, values[:BEGUN])
    stream.select(other)
    found = answers(stream, values[BEGUN:], 0.0)
    expected = alone(other)[BEGUN:]
    difference = np.abs(found - expected)[LISTENED + FADED :]
    assert difference[:, 0].max() < 1e-3
    # A filter that goes down to 1 Hz still knows a little of when it began to listen.
    size = np.std(expected[:, 1])
    assert difference[:, 1].max() <= 0.2 * size
    assert difference[-200:, 1].max() <= 0.01 * size


@pytest.mark.parametrize(("one", "other"), [*PAIRS, ("dynamic", "dynamic")])
@pytest.mark.parametrize("heard", [0, 1, 300, LISTENED])
def test_who_is_selected_back_while_the_other_listens_never_left(
    one: str, other: str, heard: int
) -> None:
    stream, always = compensation(one), compensation(one)
    values = texture(1.0).tolist()
    stream.select(other)
    found = forces(stream, values[:heard])
    stream.select(one)
    assert stream.controller == one
    found += forces(stream, values[heard:])
    assert found == forces(always, values)


SIMPLE = ("none", "constant", "dynamic")
moments = st.one_of(st.integers(0, 600), st.integers(LISTENED - 1, LISTENED + FADED))


@settings(deadline=None, max_examples=20)
@given(st.lists(st.tuples(st.sampled_from(SIMPLE), moments), min_size=1, max_size=4))
@example([("constant", LISTENED + 2), ("dynamic", 0)])
@example([("constant", LISTENED + 2), ("none", 0), ("constant", 0)])
@example([("constant", 100), ("dynamic", 0)])
def test_whoever_is_selected_and_whenever_there_is_no_jump_on_the_way_to_the_last(
    changes: list[tuple[str, int]],
) -> None:
    stream, tool = compensation("none"), (texture(4.0) - GRAVITY).tolist()
    found: list[float] = []
    for name, samples in [*changes, (changes[-1][0], 1500)]:
        stream.select(name)
        assert stream.controller == name
        found += forces(stream, tool[len(found) : len(found) + samples])
    each = np.array([forces(compensation(name), tool[: len(found)]) for name in SIMPLE])
    low, high = each.min(axis=0) - 1e-3, each.max(axis=0) + 1e-3
    assert ((low <= found) & (found <= high)).all()
    apart = (high - low) / FADED
    steps = np.abs(np.diff(each)).max(axis=0) + np.maximum(apart[1:], apart[:-1])
    assert (np.abs(np.diff(found)) <= steps).all()
    assert found[-900:] == pytest.approx(each[SIMPLE.index(name)][-900:], abs=1e-3)


def test_a_name_that_is_none_cannot_be_selected_and_changes_nothing() -> None:
    stream = compensation("constant")
    message = f"^controller = 'magic': must be one of {', '.join(NAMES)}$"
    with pytest.raises(ParameterError, match=message):
        stream.select("magic")
    with pytest.raises(ParameterError, match=message):
        build_controller("magic", Loop(RATE))
    assert stream.controller == "constant"
    assert stream.sample(1.0, 0.0)[1] > 0.0


def test_gravity_is_no_blow_to_who_begins_to_listen() -> None:
    for name in NAMES:
        stream = compensation("none")
        forces(stream, [GRAVITY] * 1000)
        stream.select(name)
        assert np.abs(forces(stream, [GRAVITY] * 2000)).max() < 1e-3


# What diagnostics show


def test_the_status_says_who_is_in_use_and_what_was_limited() -> None:
    stream = compensation("constant")
    warning, values = stream.diagnostics()
    assert warning == ""
    assert values["controller"] == "constant"
    assert set(values) >= {"limited by heat", "limited by travel", "withheld"}
    stream.sample(100.0, None)
    stream.sample(math.nan, 0.0)
    values = stream.diagnostics()[1]
    assert [values[name] for name in ("saturated", "rejected", "handle not trusted")] == ["1"] * 3
    assert float(values["travel (mm)"]) < 0.0
    assert values["heat (%)"] == "0.1"
    stream.select("dynamic")
    assert stream.diagnostics()[1]["controller"] == "dynamic"


def test_a_reset_does_not_cool_the_coil() -> None:
    stream = unlimited("constant")
    forces(stream, [100.0, -100.0] * 100)
    warm = stream.guard.heat
    stream.reset()
    assert stream.guard.heat == warm > 0.0


def on_handle(
    stream: OneCoil, tool: FloatArray, changes: dict[int, tuple[Callable[..., None], float]]
) -> FloatArray:
    """Return desired accelerations and forces on a simulated handle, with changes by tick."""
    handle = SimulatedMaster(MasterRigParameters(), RATE, 0)
    given = np.zeros((len(tool), 2))
    for tick, acceleration in enumerate(tool):
        if tick in changes:
            change, value = changes[tick]
            change(value)
        felt = handle.read(tick / RATE).acceleration[ACTUATOR_AXIS]
        given[tick] = stream.sample(acceleration, felt)
        stream.adapt()
        handle.write((tick + 1) / RATE, actuator_force=along_actuator(given[tick, 1]))
    return given


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_who_was_muted_comes_back_no_louder_than_who_was_not(controller: str) -> None:
    tool = texture(3.0)
    heard = on_handle(compensation(controller), tool, {})[:, 1]
    stream = compensation(controller)
    changes = {1000: (stream.mute, True), 2000: (stream.mute, False)}
    muted = on_handle(stream, tool, changes)[:, 1]
    assert not muted[1000:2000].any()
    np.testing.assert_array_equal(muted[:1000], heard[:1000])
    # A controller that took its forces for acting would push three times as much.
    assert np.abs(muted[2000:]).max() <= 1.3 * np.abs(heard[500:]).max()


def test_samples_whose_force_was_withheld_are_counted() -> None:
    stream = compensation("constant")
    stream.mute(True)
    answers(stream, texture(0.1))
    while_muted = int(stream.diagnostics()[1]["withheld"])
    assert while_muted == len(texture(0.1))
    stream.mute(False)
    answers(stream, texture(1.0))
    faded_in = int(stream.diagnostics()[1]["withheld"]) - while_muted
    assert 0 < faded_in <= FADING * RATE
    assert not int(compensation("constant").diagnostics()[1]["withheld"])


def test_muting_changes_nothing_for_who_is_asleep() -> None:
    tool = list(texture(1.0))
    waited, new = (copy.deepcopy(built("inverse", RATE, False)) for _ in range(2))
    waited.mute(True)
    forces(waited, tool[:1] * 10)
    waited.mute(False)
    assert forces(waited, tool) == forces(new, tool)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_gain_that_returned_to_one_leaves_no_trace(controller: str) -> None:
    tool = texture(0.5)
    always, changed = (copy.deepcopy(built(controller, RATE, False)) for _ in range(2))
    changed.set_gain(0.25)
    for stream in (always, changed):
        assert not answers(stream, tool[:1]).any()  # idle
    changed.set_gain(1.0)
    np.testing.assert_array_equal(answers(changed, tool[1:]), answers(always, tool[1:]))


def test_a_gain_scales_desired_acceleration_and_force() -> None:
    tool = texture(0.5)
    half, whole = (copy.deepcopy(built("dynamic", RATE, False)) for _ in range(2))
    half.set_gain(0.5)
    np.testing.assert_allclose(answers(half, tool), 0.5 * answers(whole, tool), atol=1e-12)


@pytest.mark.parametrize("controller", ["inverse", "adaptive", "feedback"])
def test_a_handle_moves_in_proportion_to_the_gain(controller: str) -> None:
    def moved(gain: float) -> FloatArray:
        stream = compensation(controller)
        return on_handle(stream, tool, {0: (stream.set_gain, gain)})[1000:]

    tool = GRAVITY + 0.5 * (texture(2.5) - GRAVITY)
    whole = moved(1.0)
    for gain in (0.5, 1.5):
        found = moved(gain)
        np.testing.assert_allclose(found[:, 0], gain * whole[:, 0], atol=1e-9)
        assert np.std(found[:, 1] - gain * whole[:, 1]) <= 0.2 * gain * np.std(whole[:, 1])


@pytest.mark.parametrize("controller", ["inverse", "adaptive", "feedback"])
def test_a_texture_that_is_faded_in_does_not_drive_the_actuator_to_its_stops(
    controller: str,
) -> None:
    stream = OneCoil(CompensationParameters(controller, gain=0.0), RATE)
    found = on_handle(stream, texture(4.0), {1000: (stream.set_gain, 1.0)})
    assert not found[:1000, 1].any()
    assert stream.guard.cushioned == 0


def test_a_changed_gain_takes_effect_along_a_ramp() -> None:
    tool = texture(0.5)
    changed, whole = compensation("constant"), compensation("constant")
    np.testing.assert_array_equal(answers(changed, tool[:200]), answers(whole, tool[:200]))
    changed.set_gain(0.0)
    ramp = round(RAMP * RATE)
    expected = answers(whole, tool[200:])[:, 0]
    expected[:ramp] *= np.linspace(1.0, 0.0, ramp + 1)[1:]
    expected[ramp:] = 0.0
    found = answers(changed, tool[200:])
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-12)
    assert not found[ramp:, 1].any()
    assert changed.first.gain == 0.0
    changed.set_gain(1.0)
    answers(changed, tool[:ramp])
    assert changed.first.gain == 1.0


def test_a_reset_ends_a_ramp() -> None:
    stream = compensation("constant")
    stream.set_gain(2.0)
    stream.reset()
    assert stream.first.gain == 2.0


@pytest.mark.parametrize("earlier", ["", "dynamic"])
def test_while_the_gain_is_zero_another_controller_takes_over_at_once(earlier: str) -> None:
    tool = texture(2.0)
    changed, always = (copy.deepcopy(built(it, RATE, False)) for it in ("constant", "inverse"))
    for stream in (changed, always):
        stream.set_gain(0.0)
        answers(stream, tool[:200])
    if earlier:
        changed.select(earlier)
        answers(changed, tool[200:400])
    changed.select("inverse")
    assert changed.active == changed.controller == "inverse"
    for stream in (changed, always):
        assert not answers(stream, tool[400:800]).any()
        stream.set_gain(1.0)
    # The high-pass began at another time, and the actuator's travel was estimated from then on.
    np.testing.assert_allclose(
        answers(changed, tool[800:]), answers(always, tool[800:]), atol=0.05
    )


def test_an_equal_controller_while_another_listens_stays_at_a_gain_of_zero() -> None:
    stream = compensation("constant")
    tool = texture(1.0)
    stream.select("dynamic")
    stream.set_gain(0.0)
    answers(stream, tool[:100])
    stream.select("constant")
    assert stream.active == stream.controller == "constant"
    stream.set_gain(1.0)
    assert np.abs(answers(stream, tool[100:])).max() < GRAVITY  # no step


def test_an_actuator_that_the_handle_swings_is_braked_though_no_force_is_asked() -> None:
    stream = OneCoil(CompensationParameters("none"), RATE)
    swing = 45.0 * np.sin(2 * np.pi * 15.0 * np.arange(800) / RATE)
    forces = [stream.sample(0.0, acceleration)[1] for acceleration in swing.tolist()]
    assert max(map(abs, forces)) > 0.1
