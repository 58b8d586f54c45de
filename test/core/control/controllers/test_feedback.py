# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The feedback as a controller: its samples, the rig in its loop, and its way out and back."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from band_noise import band_noise
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.compensation import LARGEST_ACCELERATION
from haptic_accel.core.control.controllers import CONTROLLERS, Loop
from haptic_accel.core.control.controllers.fixed import (
    FADING,
    FITTING,
    REGAINED,
    FeedbackController,
    FeedbackParameters,
    InverseController,
    InverseParameters,
)
from haptic_accel.core.control.feedback_design import GripRange
from haptic_accel.core.control.inversion import TexturePrior
from haptic_accel.core.handle.mechanics import approximate_model
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, HandleParameters
from haptic_accel.core.rig.master_rig import MasterRig, MasterRigParameters
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import run_trial
from nightly import rest_slow

RATE = 4000.0
LOOP = Loop(RATE)
NAN = math.nan
CORNERS = GripRange().grips(HandleParameters())


@functools.cache
def built(feedforward: str = "inverse", rate: float = RATE) -> FeedbackController:
    return FeedbackController(FeedbackParameters(feedforward=feedforward), Loop(rate))


def fresh(feedforward: str = "inverse", rate: float = RATE) -> FeedbackController:
    controller = built(feedforward, rate)
    controller.reset()
    return controller


def texture(rate: float, seconds: float = 2.0) -> FloatArray:
    """Noise from 50 to 150 Hz, 1.5 m/s^2 RMS."""
    return band_noise(50.0, 150.0, seconds, 1.5, rate=rate)


@pytest.mark.parametrize("frequency", [25.0, 80.0, 300.0])
def test_samples_make_the_loop_that_was_designed(frequency: float) -> None:
    """A tone as measurement: the force is -K B times it, and one sample later in the loop."""
    controller, plant = fresh("none"), Plant()
    count = round(RATE)
    angle = 2 * np.pi * frequency / RATE * np.arange(2 * count)
    forces = [controller.force(0.0, value) for value in np.sin(angle)]
    answer = 2j / count * np.dot(forces[count:], np.exp(-1j * angle[count:]))
    at = np.array([frequency])
    around = -answer * plant.response(at, RATE) * np.exp(-2j * np.pi * at / RATE)
    assert around == pytest.approx(controller.design.loop(plant, at), rel=1e-4)


@pytest.mark.parametrize("handle", CORNERS)
@pytest.mark.parametrize("feedforward", ["inverse", "none"])
def test_a_blow_dies_out_at_every_corner_grip(
    feedforward: str, handle: HandleParameters, ideal_master: MasterRigParameters
) -> None:
    controller = fresh(feedforward)
    rig = MasterRig(replace(ideal_master, handle=handle), RATE)
    rig.disturb(handle_velocity=0.02)
    struck = rig.energy()
    before = 0.0
    for index in range(round(0.8 * RATE)):
        rig.advance(index / RATE)
        rig.apply_actuator_force(along_actuator(controller.force(0.0, before)))
        before = rig.measure().acceleration[ACTUATOR_AXIS]
    assert rig.energy() < 1e-4 * struck


@pytest.mark.parametrize("handle", rest_slow((CORNERS[at] for at in (0, 7, 1, 4)), now=2))
def test_it_follows_better_than_the_inverse_where_the_grip_is_another(
    handle: HandleParameters, ideal_rig: RigParameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The reduction of a force that moves a light handle too much would help the inverse alone.
    for controller in (InverseController, FeedbackController):
        monkeypatch.setattr(controller, "reducible", False)
    rig = replace(ideal_rig, master=replace(ideal_rig.master, handle=handle))
    expected = TexturePrior(rise=60.0)
    own = {
        "inverse": InverseParameters(texture=expected),
        "feedback": FeedbackParameters(texture=expected),
    }
    given = {"duration": 1.5, "rate": RATE, "recording": texture(RATE), "controllers": own}
    inverse, feedback = (
        run_trial(name, rig, **given).evaluate().nrmse_percent
        for name in own  # type: ignore[arg-type]
    )
    if handle == HandleParameters():
        assert feedback == pytest.approx(inverse, abs=0.5)
    else:
        assert feedback < 0.9 * inverse


@pytest.mark.parametrize("feedforward", ["constant", "dynamic", "inverse"])
def test_a_handle_that_does_as_foreseen_gets_the_feedforward_alone(feedforward: str) -> None:
    """The model's prediction, or the desired acceleration two samples late, is no surprise."""
    controller, alone = fresh(feedforward), CONTROLLERS[feedforward]
    parameters = alone.Parameters()
    if feedforward == "dynamic":
        parameters = approximate_model(HandleParameters())
    reference = alone(parameters, LOOP)
    desired = texture(RATE, 0.25)
    model = controller.design.model
    sent = np.zeros(len(desired))
    for tick, wanted in enumerate(desired):
        if feedforward == "inverse":
            past = sent[max(0, tick - 1 - len(model)) : max(0, tick - 1)]
            measured = float(np.dot(model[: len(past)], past[::-1]))
        else:
            measured = desired[tick - 2] if tick > 1 else 0.0
        sent[tick] = controller.force(wanted, measured)
        assert sent[tick] == pytest.approx(reference.force(wanted, 0.0), abs=1e-9)


@pytest.mark.parametrize("measured", [0.0, NAN])
def test_a_force_that_was_limited_or_whose_effect_was_never_heard_is_no_surprise(
    measured: float,
) -> None:
    controller = fresh()
    expected = InverseController(InverseParameters(), LOOP)
    for wanted in texture(RATE, 0.1):
        force = controller.force(wanted, measured)
        if measured == 0.0:
            controller.applied(0.0)
        assert force == pytest.approx(expected.force(wanted, 0.0), abs=1e-12)


def test_gravity_at_the_start_is_no_surprise() -> None:
    controller = fresh()
    assert all(controller.force(0.0, 9.81) == 0.0 for _ in range(100))


def test_it_fades_out_without_measurement_and_comes_back() -> None:
    controller, reference = fresh(), InverseController(InverseParameters(), LOOP)
    measured = 5.0 * texture(RATE, 1.0)

    def answer(tick: int, heard: float) -> float:
        return controller.force(1.0, heard) - reference.force(1.0, 0.0)

    with_feedback = [answer(tick, measured[tick]) for tick in range(800)]
    assert max(map(abs, with_feedback)) > 0.1
    assert controller.warning == ""
    without = [answer(tick, NAN) for tick in range(800, 900)]
    assert controller.warning == "feedback off: handle acceleration stale"
    assert controller.diagnostics()["feedback off"] == "1"
    assert controller.diagnostics()["feedback gain (N per m/s^2)"] == "0.000"
    fading = round(FADING * RATE)
    assert without[fading:] == pytest.approx(np.zeros(100 - fading), abs=1e-12)
    regained = round(REGAINED * RATE)
    waiting = [answer(tick, measured[tick]) for tick in range(900, 900 + regained - 1)]
    assert waiting == pytest.approx(np.zeros(regained - 1), abs=1e-12)
    assert controller.warning
    back = [answer(tick, measured[tick]) for tick in range(900 + regained, 1800)]
    assert controller.warning == ""
    assert max(map(abs, back)) > 0.1
    # No step on the way: nothing faster than what the feedback does by itself.
    largest = max(np.abs(np.diff(with_feedback)))
    assert max(np.abs(np.diff([*with_feedback, *without, *waiting, *back]))) < 1.5 * largest


def test_after_saturation_it_stays_off_until_the_response_fits() -> None:
    controller = fresh()
    for measured in [*texture(RATE, 0.2), math.inf, *texture(RATE, 0.5)]:
        controller.force(1.0, measured)
    controller.judged(FITTING - 0.1, 1.0)
    assert controller.warning.startswith("feedback off: handle acceleration was saturated")
    assert controller.diagnostics()["feedback gain (N per m/s^2)"] == "0.000"
    controller.judged(FITTING, 1.0)
    assert controller.warning == ""
    for measured in texture(RATE, 0.1):
        controller.force(1.0, measured)
    assert controller.diagnostics()["feedback gain (N per m/s^2)"] != "0.000"


numbers = st.floats(-LARGEST_ACCELERATION, LARGEST_ACCELERATION)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(numbers, st.one_of(numbers, st.just(NAN))), max_size=60))
def test_it_is_finite_whatever_is_measured_and_new_after_a_reset(
    samples: list[tuple[float, float]],
) -> None:
    controller = fresh(rate=1000.0)
    first = [controller.force(*sample) for sample in samples]
    assert np.isfinite(first).all()
    controller.reset()
    assert [controller.force(*sample) for sample in samples] == first


def test_the_status_says_gain_and_margin() -> None:
    status = fresh().diagnostics()
    assert float(status["feedback margin"]) >= 0.5
    assert float(status["feedback gain (N per m/s^2)"]) > 0.0
    assert status["feedback off"] == "0"
