# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters: what is let through, what is refused, and in which words."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from haptic_accel.core.control.compensation import CompensationParameters
from haptic_accel.core.control.controllers.fixed import (
    ConstantParameters,
    FeedbackParameters,
    InverseParameters,
)
from haptic_accel.core.control.inversion import TexturePrior
from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.model import AccelerometerParameters, ApproximateModel, HandleParameters
from haptic_accel.core.parameters import (
    Checked,
    ParameterError,
    Specification,
    checked,
    from_flat,
    parameter,
    schema,
    suggestion,
)
from haptic_accel.core.rig.master_rig import DriveParameters, ExplorationParameters
from haptic_accel.core.rig.slave_rig import SurfaceParameters, ToolParameters

ANY_NUMBER = Specification("any")

whole = st.integers(-(2**53), 2**53)
finite = st.floats(allow_nan=False, allow_infinity=False)
not_finite = st.sampled_from([math.nan, math.inf, -math.inf])
not_numbers = st.one_of(
    st.none(),
    st.booleans(),
    st.text(),
    st.binary(),
    st.lists(st.text()),
    st.dictionaries(st.text(), st.floats()),
)


@dataclass(frozen=True)
class Spring(Checked):
    stiffness: float = parameter(250.0, "stiffness", unit="N/m", low=0, high=1000.0)
    mass: float = parameter(0.1, "mass", unit="kg", low=0, above=True)


@dataclass(frozen=True)
class Probe:
    spring: Spring = field(default_factory=Spring)
    bits: int = parameter(16, "resolution", low=4, high=32)


@dataclass(frozen=True)
class Machine:
    probe: Probe = field(default_factory=Probe)
    name: str = parameter("plain", "its name")
    mode: str = parameter("slow", "how", choices=("slow", "fast"))
    running: bool = parameter(True, "whether it runs")
    offset: float = parameter(0.0, "any number", unit="m")


def refusal(default: Any, value: Any, specification: Specification = ANY_NUMBER) -> str:
    with pytest.raises(ParameterError) as caught:
        checked("x", value, default, specification)
    return str(caught.value)


# Numbers


@given(whole)
def test_an_int_for_a_float_and_a_whole_float_for_an_int_become_one(value: int) -> None:
    for given_value, default in ((value, 1.0), (float(value), 1)):
        result = checked("x", given_value, default, ANY_NUMBER)
        assert type(result) is type(default)
        assert result == value


@given(finite)
def test_a_fraction_is_no_int(value: float) -> None:
    assume(value != math.floor(value))
    assert refusal(1, value) == f"x = {value}: must be a whole number, a finite number"


@given(not_finite, st.sampled_from([1, 1.0]))
def test_nan_and_infinity_are_refused_for_any_number(value: float, default: Any) -> None:
    assert refusal(default, value).startswith(f"x = {value}: must be ")


@given(not_numbers, st.sampled_from([1, 1.0]))
def test_what_is_no_number_is_refused_in_one_line(value: Any, default: Any) -> None:
    message = refusal(default, value)
    assert len(message.splitlines()) == 1
    assert message.startswith("x = ")
    assert ": must be " in message


def test_a_whole_number_beyond_all_floats_is_refused() -> None:
    assert refusal(1.0, 10**400).endswith(": must be a finite number")
    assert refusal(1, -(10**400)).endswith(": must be a whole number, a finite number")


@given(finite, finite, finite)
def test_bounds_themselves_are_allowed(value: float, one: float, other: float) -> None:
    low, high = sorted((one, other))
    specification = Specification("bounded", low=low, high=high)
    if low <= value <= high:
        assert checked("x", value, 1.0, specification) == value
    else:
        assert "must be from" in refusal(1.0, value, specification)
    assert checked("x", low, 1.0, specification) == low
    assert checked("x", high, 1.0, specification) == high


@pytest.mark.parametrize(
    ("specification", "value", "message"),
    [
        (Specification("", "kg", low=0.0), -1, "x = -1: must be at least 0 kg"),
        (Specification("", "kg", low=0.0, above=True), 0.0, "x = 0.0: must be above 0 kg"),
        (Specification("", "Hz", high=1e3), 1001.0, "x = 1001.0: must be at most 1000 Hz"),
        (Specification("", "m", low=0.1, high=2), 3.0, "x = 3.0: must be from 0.1 to 2 m"),
        (Specification("", low=0, high=1, above=True), 0, "x = 0: must be above 0 to 1"),
        (Specification("", "N"), math.nan, "x = nan: must be a finite number N"),
        (Specification("", low=0), "1", "x = '1': must be at least 0"),
    ],
)
def test_the_message_names_the_value_and_what_is_allowed(
    specification: Specification, value: Any, message: str
) -> None:
    assert refusal(1.0, value, specification) == message


# Words


@given(st.text())
def test_a_text_without_choices_may_be_anything(value: str) -> None:
    assert checked("x", value, "", ANY_NUMBER) == value


@given(st.text())
def test_only_the_choices_are_allowed_and_named_in_one_line(value: str) -> None:
    assume(value not in ("slow", "fast"))
    message = refusal("slow", value, Specification("how", choices=("slow", "fast")))
    hint = suggestion(value, ("slow", "fast"))
    assert message == f"x = {value!r}: must be one of slow, fast{hint}"
    assert len(message.splitlines()) == 1


@given(st.one_of(st.none(), st.integers(), st.floats(), st.booleans()))
def test_what_is_no_text_is_refused_for_text(value: Any) -> None:
    assert refusal("", value) == f"x = {value}: must be text"


@given(st.one_of(st.none(), st.integers(), st.floats(), st.text()))
def test_only_true_and_false_are_true_or_false(value: Any) -> None:
    assert refusal(True, value).endswith(": must be true or false")


# Dataclasses


IMPOSSIBLE: dict[type[Checked], list[tuple[str, Any, str]]] = {
    HandleParameters: [
        ("m_a", -0.018, "above 0 kg"),
        ("m_a", 0.0, "above 0 kg"),
        ("m_h", -1.0, "above 0 kg"),
        ("m_h", math.nan, "above 0 kg"),
        ("k_s", -1.0, "at least 0 N/m"),
        ("k_u", math.inf, "at least 0 N/m"),
        ("b_s", -2.0, "at least 0 N s/m"),
        ("b_u", math.nan, "at least 0 N s/m"),
    ],
    ApproximateModel: [
        ("zero_1_frequency", 0.0, "above 0 Hz"),
        ("pole_2_damping", -1.0, "above 0"),
        ("gain", math.nan, "above 0 m/s.2/N"),
    ],
    AccelerometerParameters: [
        *(("range", 0.0, ""), ("bandwidth", math.nan, ""), ("noise_density", -1.0, "")),
        *(("bits", 3, ""), ("bits", 8.5, "a whole number")),
    ],
    DriveParameters: [
        *(("delay", -1.0, "from"), ("slip_velocity", 0.0, "")),
        *(("stop_stiffness", math.nan, ""), ("bits", 64, "")),
    ],
    ExplorationParameters: [
        *(("stroke_speed", -0.1, ""), ("turn_time", 0.0, ""), ("height", math.nan, "")),
        *(("strokes", 0, ""), ("strokes", 1.5, "a whole number")),
    ],
    ToolParameters: [
        *(("mass", 0.0, "from"), ("viscous_friction", -1.0, "from")),
        *(("height", math.nan, "from"), ("slip_velocity", 0.0, "from")),
    ],
    SurfaceParameters: [
        *(("stiffness", 0.0, "from"), ("friction", -0.1, "from")),
        *(("roughness", math.nan, "from"), ("bump_pitch", 0.0, "from")),
    ],
    CouplingParameters: [
        ("k_m", -1.0, "from 0 to 5000 N/m"),
        ("k_sl", math.nan, "from 0 to 5000 N/m"),
        ("damping", -0.1, "from 0 to 50 N s/m"),
        ("scale", 0.0, "from 0.01 to 100"),
        ("max_force", math.inf, "from 0 to 100 N"),
    ],
    CompensationParameters: [
        *(("controller", "magic", "one of none"), ("high_pass_frequency", 0.0, "")),
        ("high_pass_frequency", math.nan, ""),
    ],
    ConstantParameters: [("mass", value, "at least 0 kg") for value in (-0.1, math.nan, math.inf)],
    FeedbackParameters: [("feedforward", "adaptive", "one of ")],
    InverseParameters: [
        ("granted_time", -0.001, "from 0 to 0.1 s"),
        ("granted_time", 1.5, "from 0 to 0.1 s"),
        ("memory", 3.0, "from 0.05 to 0.4 s"),
    ],
    TexturePrior: [("rise", 0.0, "from"), ("fall", math.inf, "from")],
}
"""Values that parameters may not have, and how the line goes on that says so."""


@pytest.mark.parametrize(
    ("owner", "name", "value", "allowed"),
    [(owner, *row) for owner, rows in IMPOSSIBLE.items() for row in rows],
)
def test_what_is_physically_impossible_is_refused(
    owner: type[Checked], name: str, value: Any, allowed: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{name} = {value!r}: must be {allowed}"):
        owner(**{name: value})


def test_a_parameter_class_stores_ints_as_floats() -> None:
    assert type(Spring(stiffness=100).stiffness) is float


def test_schema_lists_all_parameters_by_dotted_name() -> None:
    found = schema(Machine)
    assert {name: default for name, (default, _) in found.items()} == {
        "probe.spring.stiffness": 250.0,
        "probe.spring.mass": 0.1,
        "probe.bits": 16,
        "name": "plain",
        "mode": "slow",
        "running": True,
        "offset": 0.0,
    }
    assert found["probe.spring.stiffness"][1].unit == "N/m"
    assert found["mode"][1].choices == ("slow", "fast")


def test_schema_puts_a_prefix_before_every_name() -> None:
    assert set(schema(Spring, "left.")) == {"left.stiffness", "left.mass"}


def test_schema_refuses_a_field_that_is_neither_parameter_nor_parameters() -> None:
    @dataclass
    class Wrong:
        number: float = 1.0

    with pytest.raises(TypeError, match=r"^number: neither"):
        schema(Wrong)


@given(
    st.floats(0, 1000), st.integers(4, 32), st.text(), st.sampled_from(["slow", "fast"]), finite
)
def test_from_flat_puts_every_value_in_its_place(
    stiffness: float, bits: int, name: str, mode: str, offset: float
) -> None:
    values = {
        "probe.spring.stiffness": stiffness,
        "probe.bits": bits,
        "name": name,
        "mode": mode,
        "running": False,
        "offset": offset,
    }
    machine = Machine(Probe(Spring(stiffness), bits), name, mode, False, offset)
    assert from_flat(Machine, values) == machine
    prefixed = {f"here.{key}": value for key, value in values.items()}
    assert from_flat(Machine, prefixed, "here.") == machine


def test_from_flat_does_not_look_at_other_names() -> None:
    assert from_flat(Spring, {"colour": "red", "probe.stiffness": -1}) == Spring()


def test_from_flat_says_the_dotted_name_of_what_is_wrong() -> None:
    with pytest.raises(
        ParameterError, match=r"^here\.probe\.spring\.mass = 0: must be above 0 kg$"
    ):
        from_flat(Machine, {"here.probe.spring.mass": 0}, "here.")
