"""High-pass, controller and limit as one: limits hold and no bad sample stays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy import signal

from haptic_accel.core.compensation import (
    PEAK_FORCE,
    Compensation,
    CompensationParameters,
    build_controller,
    check_rate,
)
from haptic_accel.core.controllers import CONTROLLERS
from haptic_accel.core.controllers.constant import ConstantParameters
from haptic_accel.core.filters import high_pass, inverse_of
from haptic_accel.core.model import ApproximateModel, FloatArray
from haptic_accel.core.parameters import ParameterError

RATE = 1000.0

untimed = settings(deadline=None)
controllers = st.sampled_from(sorted(CONTROLLERS))
signals = arrays.arrays(np.float64, st.integers(1, 200), elements=st.floats(-20.0, 20.0))
# Infinity, NaN and the largest numbers as often as ordinary ones.
anything = st.lists(
    st.one_of(
        st.floats(-50.0, 50.0),
        st.floats(),
        st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308]),
    ),
    max_size=100,
)


def compensation(controller: str, rate: float = RATE) -> Compensation:
    return Compensation(CompensationParameters(controller), rate)


def forces(of: Compensation, tool_acceleration: list[float]) -> list[float]:
    return [of.sample(value, 0.0)[1] for value in tool_acceleration]


# Ordinary samples


@pytest.mark.parametrize("controller", ["none", "constant", "dynamic"])
@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@untimed
@given(values=signals)
def test_samples_give_what_the_whole_signal_gives(
    controller: str, rate: float, values: FloatArray
) -> None:
    desired = signal.sosfilt(high_pass(15.0, rate), values)
    force = {
        "none": np.zeros_like(values),
        "constant": 0.128 * desired,
        "dynamic": signal.sosfilt(inverse_of(ApproximateModel(), rate), desired),
    }[controller]
    stream = compensation(controller, rate)
    output = np.array([stream.sample(value, 0.0) for value in values.tolist()])
    assert output[:, 0] == pytest.approx(desired, abs=1e-9)
    assert output[:, 1] == pytest.approx(np.clip(force, -PEAK_FORCE, PEAK_FORCE), abs=1e-9)
    assert stream.rejected == 0


def test_its_corner_can_be_chosen() -> None:
    stream = Compensation(CompensationParameters("constant", high_pass_frequency=100.0), RATE)
    # At the corner a Butterworth high-pass lets 1/sqrt(2) through.
    output = [stream.sample(math.sin(2 * math.pi * 0.1 * index), 0.0)[0] for index in range(1000)]
    assert np.std(output[500:]) == pytest.approx(0.5, rel=1e-3)


def test_parameters_reach_the_controller_they_are_for() -> None:
    heavy = {"constant": ConstantParameters(1.0)}
    stream = Compensation(CompensationParameters("constant"), RATE, heavy)
    desired, force = stream.sample(1.0, 0.0)
    assert force == desired
    stream = Compensation(CompensationParameters("none"), RATE, heavy)
    assert stream.sample(1.0, 0.0)[1] == 0.0


def test_reset_forgets_the_past() -> None:
    used, fresh = compensation("dynamic"), compensation("dynamic")
    forces(used, [1.0, -2.0, 3.0])
    used.reset()
    assert forces(used, [1.0, 2.0, 3.0]) == forces(fresh, [1.0, 2.0, 3.0])


# The actuator's limit


def test_a_force_beyond_the_peak_is_cut_and_counted() -> None:
    stream = compensation("constant")
    # 6.6 N / 0.128 kg = 51.6 m/s^2, of which the first sample passes 88 %.
    assert [stream.sample(50.0, 0.0)[1] < PEAK_FORCE, stream.saturated] == [True, 0]
    stream.reset()
    assert [stream.sample(100.0, 0.0)[1], stream.saturated] == [6.6, 1]
    stream.reset()
    assert [stream.sample(-100.0, 0.0)[1], stream.saturated] == [-6.6, 2]


@untimed
@given(arrays.arrays(np.float64, 50, elements=st.floats(-500.0, 500.0)), st.floats(0.0, 10.0))
def test_exactly_the_forces_beyond_the_peak_are_cut(values: FloatArray, peak: float) -> None:
    parameters = CompensationParameters("dynamic", peak_force=peak)
    limited = Compensation(parameters, RATE)
    free = Compensation(CompensationParameters("dynamic", peak_force=100.0), RATE)
    cut = 0
    for force, wanted in zip(
        forces(limited, values.tolist()), forces(free, values.tolist()), strict=True
    ):
        assert abs(force) <= peak
        assert force == pytest.approx(min(peak, max(-peak, wanted)))
        cut += abs(wanted) > peak
    assert limited.saturated == cut


# Samples that are none


@untimed
@given(controllers, anything, st.one_of(st.just(0.0), st.floats()))
def test_whatever_comes_in_the_force_is_finite_and_limited(
    controller: str, tool_acceleration: list[float], handle_acceleration: float
) -> None:
    stream = compensation(controller)
    for value in tool_acceleration:
        desired, force = stream.sample(value, handle_acceleration)
        assert math.isfinite(desired)
        assert abs(force) <= PEAK_FORCE


@untimed
@given(
    controllers, st.lists(st.one_of(st.floats(-50.0, 50.0), st.sampled_from([math.nan, math.inf])))
)
def test_a_sample_that_is_not_finite_counts_as_zero(controller: str, values: list[float]) -> None:
    stream, clean = compensation(controller), compensation(controller)
    replaced = [value if math.isfinite(value) else 0.0 for value in values]
    assert [stream.sample(v, 0.0) for v in values] == [clean.sample(v, 0.0) for v in replaced]
    assert stream.rejected == sum(not math.isfinite(value) for value in values)


def test_a_handle_acceleration_that_is_not_finite_is_counted_too() -> None:
    stream = compensation("dynamic")
    stream.sample(1.0, math.nan)
    stream.sample(math.inf, -math.inf)
    assert stream.rejected == 3


@pytest.mark.parametrize("controller", ["none", "constant", "dynamic"])
@pytest.mark.parametrize(
    "absurd", [[1e308], [1e308, -1e308], [1e308] * 5, [1e300, math.nan, -1e300], [1e200] * 3]
)
def test_even_numbers_that_overflow_are_forgotten(controller: str, absurd: list[float]) -> None:
    stream, fresh = compensation(controller), compensation(controller)
    forces(stream, absurd)
    # The slowest pole, 12 Hz with damping 0.3, takes 31 s from 1e308 down to 1.
    forces(stream, [0.0] * 40_000)
    for value in (1.0, -5.0, 10.0):
        assert stream.sample(value, 0.0) == pytest.approx(fresh.sample(value, 0.0), abs=1e-6)


# What is refused


@pytest.mark.parametrize("rate", [0.0, -1000.0, 29.0, 30.0, math.nan])
def test_a_rate_too_low_for_the_high_pass_is_refused(rate: float) -> None:
    with pytest.raises(
        ParameterError, match=r"^rate = \S+: must be above twice high_pass_frequency = 15 Hz$"
    ):
        compensation("dynamic", rate)
    with pytest.raises(ParameterError, match="high_pass_frequency = 15 Hz$"):
        check_rate(CompensationParameters(), rate)


def test_a_rate_just_above_is_not() -> None:
    check_rate(CompensationParameters(), 31.0)
    assert compensation("dynamic", 31.0).sample(0.0, 0.0) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("controller", "magic"),
        ("high_pass_frequency", 0.0),
        ("high_pass_frequency", math.nan),
        ("peak_force", -1.0),
        ("peak_force", math.inf),
    ],
)
def test_impossible_parameters_are_refused(field: str, value: float | str) -> None:
    with pytest.raises(ParameterError, match=f"^{field} = {value!r}: must be "):
        CompensationParameters(**{field: value})  # type: ignore[arg-type]


# Controllers by name


def test_the_papers_controllers_are_there() -> None:
    assert set(CONTROLLERS) >= {"none", "constant", "dynamic"}
    for name, controller in CONTROLLERS.items():
        assert isinstance(build_controller(name, RATE), controller)


def test_an_unknown_controller_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(
        ParameterError,
        match=r"^controller = 'dynamics': must be one of none, constant, dynamic$",
    ):
        build_controller("dynamics", RATE)


def test_an_absurd_sample_does_not_hold_the_actuator_at_its_limit() -> None:
    compensation = Compensation(CompensationParameters("dynamic"), 1000.0)
    assert compensation.sample(1e30, 0.0) == (0.0, 0.0)
    assert compensation.rejected == 1
    assert compensation.sample(0.0, 0.0) == (0.0, 0.0)
