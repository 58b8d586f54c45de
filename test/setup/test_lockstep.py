# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.control.filters import high_passed
from haptic_accel.core.evaluation.metrics import aligned, evaluate
from haptic_accel.core.topics import CONTACT_FORCE, MASTER_ARM_FORCE
from haptic_accel.core.trial import Trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup


def trial(coupling: str) -> Trial:
    arguments = GraphArguments(surface="text", duration=5.0, coupling=coupling)
    return lockstep_trial(Setup.of(arguments))


def test_on_one_host_both_couplings_let_feel_the_surface_alike() -> None:
    spring, passive = map(trial, ("spring", "passive"))
    first, second = (each.evaluate(first=2000).nrmse_percent for each in (spring, passive))
    assert second == pytest.approx(first, abs=1.0)
    forces = [each.arms[MASTER_ARM_FORCE.name] for each in (spring, passive)]
    assert not np.array_equal(*forces), "the law is another one"
    pressed = [force[2000:, 2].mean() for force in forces]
    assert pressed[1] == pytest.approx(pressed[0], rel=0.05)


def test_the_scripted_hand_strokes_the_workshop_s_bench() -> None:
    found = virtual("none", "ideal")
    assert found.surface == "workshop"
    force = found.arms[CONTACT_FORCE.name]
    stroke = slice(1100, 1400)
    assert force[stroke, 2].mean() == pytest.approx(1.0, rel=0.3)
    assert abs(force[stroke, 0]) == pytest.approx(0.35 * force[stroke, 2], rel=0.05)


@pytest.mark.parametrize(("rig", "most"), [("ideal", 2.0), ("paper", 10.0)])
def test_a_virtual_surface_is_displayed_as_well_as_a_real_one(rig: str, most: float) -> None:
    assert virtual("adaptive", rig, duration=4.0).evaluate().nrmse_percent < most


def test_a_tap_is_felt_one_sample_after_the_latency_and_as_strong() -> None:
    # With smooth arms, as the coil cancels the steps of encoders also before the tap.
    without, trial = (virtual(each, "ideal", smooth=True) for each in ("none", "adaptive"))
    onset = int(np.argmax(trial.arms[CONTACT_FORCE.name][:, 2] > 0))
    assert trial.desired_acceleration[onset] != 0.0
    assert not np.any(trial.desired_acceleration[:onset])
    felt = np.flatnonzero(trial.handle_acceleration != without.handle_acceleration)
    assert felt[0] == onset + trial.latency + 1
    tap = slice(onset, onset + 20)
    desired, actual = trial.desired_acceleration[tap], trial.actual_acceleration[tap]
    assert np.abs(actual).max() == pytest.approx(np.abs(desired).max(), rel=0.1)


def virtual(controller: str, rig: str, duration: float = 2.0, *, smooth: bool = False) -> Trial:
    given = GraphArguments(slave="virtual", controller=controller, rig=rig, duration=duration)
    setup = Setup.of(given)
    if smooth:
        setup = setup.changed({"slave_device": {"virtual.arm.position_resolution": 0.0}})
    return lockstep_trial(setup)


@pytest.mark.parametrize("reduction", ["axis", "sum", "principal"])
def test_of_three_coils_one_alone_has_the_error_of_a_handle_with_one(reduction: str) -> None:
    given = {"rig": "three_axis_ideal", "controller": "inverse", "reduction": reduction}
    arguments = GraphArguments(**given, duration=4.0)
    setup = Setup.of(arguments)
    alone = lockstep_trial(setup)
    one_coil = setup.changed({"compensator": {"axes": "z", "plant.model": ""}})
    single = lockstep_trial(one_coil)
    assert not alone.actuator_force[:, :2].any()
    errors = [vector_error(each) for each in (alone, single)]
    # The single coil's plant is that of Table I, with a tenth too little force.
    assert errors[0] == pytest.approx(errors[1], abs=2.5)
    assert errors[0] == pytest.approx(alone.evaluate(first=2000).nrmse_percent)


def vector_error(trial: Trial) -> float:
    """Return the error of the handle's vector to the tool's, %; one coil's trial desires one."""
    corner, rate = trial.high_pass_frequency, trial.rate
    desired = high_passed(trial.tool_acceleration, corner, rate)
    delay = trial.after / rate
    desired, actual = aligned(desired, trial.handle_acceleration, corner, rate, delay)
    return evaluate(desired[2000:], actual[2000:], rate, 0.0).nrmse_percent
