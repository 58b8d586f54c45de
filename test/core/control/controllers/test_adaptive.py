# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from band_noise import band_noise

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.controllers.adaptive import (
    AdaptiveController,
    AdaptiveParameters,
    InverseFamily,
    design_family,
)
from haptic_accel.core.control.controllers.fixed import InverseController, InverseParameters
from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.estimation import LARGEST_FACTORS
from haptic_accel.core.control.inversion import Goal, design_bank, design_inverse, predict
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import AccelerometerParameters, FloatArray, HandleParameters
from haptic_accel.core.parameters import Checked
from haptic_accel.core.rig.master_rig import MasterRig, MasterRigParameters
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import Trial, run_trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup

RATE = 1000.0
LOOP = Loop(RATE)
TABLE_I = HandleParameters()
HANDS = [
    replace(TABLE_I, m_h=0.09, k_u=900.0, b_u=6.0),
    replace(TABLE_I, m_h=0.16, k_u=2700.0, b_u=20.0),
]


def factors(hand: HandleParameters) -> FloatArray:
    return np.array([hand.m_h, hand.b_u, hand.k_u])


@pytest.fixture(scope="module")
def family() -> InverseFamily:
    return design_family(Plant(), RATE)


def texture(seconds: float, rate: float = RATE) -> FloatArray:
    """Return broad vibration, m/s^2."""
    return band_noise(40.0, 200.0, seconds, 1.7, seed=0, rate=rate)


def run(
    controller: str,
    handle: HandleParameters,
    seconds: float = 5.0,
    latency: int = LATENCY,
    **own: Checked,
) -> Trial:
    return run_trial(
        controller,
        RigParameters(MasterRigParameters(handle=handle)),
        duration=seconds,
        latency=latency,
        recording=texture(seconds),
        controllers=own,
    )


def error(trial: Trial, start: float) -> float:
    return trial.evaluate(round(start * trial.rate)).nrmse_percent


@pytest.mark.parametrize(("hand", "latency"), [(HANDS[0], 0), (HANDS[0], 1), (HANDS[1], 5)])
def test_it_follows_a_hand_that_the_inverse_does_not_know(
    hand: HandleParameters, latency: int
) -> None:
    adaptive, inverse = (
        error(run(name, hand, latency=latency), 2.0) for name in ("adaptive", "inverse")
    )
    assert adaptive < inverse / 2
    assert adaptive < 12.0


def test_with_the_assumed_hand_it_is_the_inverse() -> None:
    adaptive, inverse = (error(run(name, TABLE_I), 2.0) for name in ("adaptive", "inverse"))
    assert adaptive < inverse + 1.0


def test_frozen_it_stays_what_it_is() -> None:
    frozen = run("adaptive", HANDS[0], 2.0, adaptive=AdaptiveParameters(frozen=True))
    inverse = run("inverse", HANDS[0], 2.0)
    assert frozen.actuator_force == pytest.approx(inverse.actuator_force, abs=1e-9)


def test_it_can_be_frozen_and_freed_while_running() -> None:
    controller = AdaptiveController(AdaptiveParameters(), LOOP)
    random = np.random.default_rng(0)

    def feed(samples: int) -> None:
        for value in random.normal(0.0, 3.0, samples).tolist():
            controller.applied(controller.force(value, value))
            controller.adapt()

    controller.freeze(True)
    feed(2000)
    assert controller.diagnostics()["grip estimates"] == "0"
    controller.freeze(False)
    feed(2000)
    assert controller.diagnostics()["grip estimates"] != "0"
    controller.reset()
    assert controller.diagnostics()["grip estimates"] == "0"
    assert float(controller.diagnostics()["m_h (kg)"]) == pytest.approx(TABLE_I.m_h)


def test_a_new_grip_comes_without_a_jump_in_force() -> None:
    trial = run("adaptive", HANDS[0])
    still = run("inverse", HANDS[0])
    # Steps from sample to sample are those of the texture, in the first look's change too.
    step = np.abs(np.diff(trial.actuator_force)).max()
    assert step < 1.5 * np.abs(np.diff(still.actuator_force)).max()


def test_for_the_assumed_grip_the_family_has_the_inverse(family: InverseFamily) -> None:
    found, wanted = family.bank(factors(TABLE_I)), design_bank(Plant(), RATE)
    for ours, theirs in ((found.taps, wanted.taps), (found.motion, wanted.motion)):
        assert ours == pytest.approx(theirs, abs=1e-6 * np.abs(theirs).max())


def test_a_latency_that_is_granted_does_not_change_the_family(family: InverseFamily) -> None:
    late = design_family(Plant().delayed(3), RATE, Goal(granted_delay=4))
    for hand in (TABLE_I, *HANDS):
        taps = family.taps(factors(hand))
        assert late.taps(factors(hand)) == pytest.approx(taps, abs=1e-9 * np.abs(taps).max())


@pytest.mark.parametrize("hand", HANDS)
def test_for_another_grip_it_is_near_the_design_for_that(
    family: InverseFamily, hand: HandleParameters
) -> None:
    plant = Plant(hand)
    ours = replace(design_inverse(plant, RATE), taps=family.taps(factors(hand))[0])
    found, best = predict(ours, plant), predict(design_inverse(plant, RATE), plant)
    nominal = predict(design_inverse(Plant(), RATE), plant)
    assert found.nrmse_percent < best.nrmse_percent + 0.3 * (
        nominal.nrmse_percent - best.nrmse_percent
    )


def hand(seed: int) -> HandleParameters:
    """Return a random hand."""
    draw = np.random.default_rng(seed).uniform
    mass, k, b = draw(0.7, 1.3), 2.0 ** draw(-1.0, 1.0), 2.0 ** draw(-1.0, 1.0)
    return replace(TABLE_I, m_h=mass * TABLE_I.m_h, k_u=k * TABLE_I.k_u, b_u=b * TABLE_I.b_u)


@pytest.mark.parametrize("seed", [100, 200, 300])
def test_it_keeps_up_with_a_grip_that_changes_every_second(seed: int) -> None:
    grips = [(float(second), hand(seed + second)) for second in range(1, 5)]

    def squared_error(controller: str) -> FloatArray:
        trial = run_trial(controller, duration=5.0, recording=texture(5.0), grips=grips)
        late = trial.after
        wrong = trial.actual_acceleration[late:] - trial.desired_acceleration[:-late]
        return np.asarray(wrong**2)

    adaptive, inverse = squared_error("adaptive"), squared_error("inverse")
    assert adaptive[1000:].mean() < inverse[1000:].mean()
    # The jolt of a loaded grip that changes is nobody's; after it the new grip is known.
    known = np.arange(len(adaptive)) % 1000 > 150
    known[:1000] = False
    assert adaptive[known].mean() < inverse[known].mean() / 3.0


def test_a_hand_outside_the_range_is_named() -> None:
    controller = AdaptiveController(AdaptiveParameters(), LOOP)
    assert controller.warning == ""
    master = MasterRig(MasterRigParameters(replace(TABLE_I, m_h=0.7)), RATE)
    random = np.random.default_rng(0)
    applied = measured = 0.0
    for index in range(1500):
        master.advance(index / RATE)
        controller.applied(applied)
        controller.force(0.0, measured)
        controller.adapt()
        measured = master.measure().acceleration[ACTUATOR_AXIS]
        applied = float(random.normal(0.0, 0.5))
        master.apply_actuator_force(along_actuator(applied))
    largest = f"{LARGEST_FACTORS[0] * TABLE_I.m_h:.4g}"
    assert controller.warning == (
        f"grip outside the range of adaptation: m_h at its upper end, {largest} kg"
    )
    controller.reset()
    assert controller.warning == ""


@pytest.mark.parametrize("measured", [math.nan, math.inf, 0.0])
def test_without_a_trusted_handle_grip_and_plant_stay_as_assumed(measured: float) -> None:
    controller = AdaptiveController(AdaptiveParameters(), LOOP)
    inverse = InverseController(InverseParameters(), LOOP)
    assumed = controller.diagnostics()
    forces = []
    for value in texture(2.0).tolist():
        forces.append((controller.force(value, measured), inverse.force(value, math.nan)))
        controller.applied(0.0)
        controller.adapt()
    later = controller.diagnostics()
    for name in ("m_h (kg)", "b_u (N s/m)", "k_u (N/m)"):
        assert later[name] == assumed[name]
    # Only the surface is learnt.
    own, given = np.array(forces).T
    assert 0.5 * np.std(given) < np.std(own) < 1.1 * np.std(given)


def test_a_resonance_is_learnt_from_a_force_that_hardly_shows_in_the_noise() -> None:
    # The accelerometer has ten times the described noise, and there is no silence to hear it.
    master = {
        "simulated.mount.frequency": 133.0,
        "simulated.mount.damping": 0.02,
        "simulated.accelerometer.noise_density": 10.0 * AccelerometerParameters().noise_density,
    }
    given = GraphArguments(rig="paper", controller="adaptive", duration=9.0)
    rising = np.minimum(np.arange(9000) / 200.0, 1.0)
    tool = rising * band_noise(15.0, 400.0, 9.0, 2.0, seed=5)
    trial = lockstep_trial(Setup.of(given).changed({"master_device": master}), recording=tool)
    errors = [trial.evaluate(1000 * second, 1000 * second + 1000) for second in range(9)]
    # A reduced force that is seen, but not above what is accepted, comes first.
    assert max(each.nrmse_percent for each in errors[:6]) < 115.0
    assert errors[8].nrmse_percent < 75.0


def test_a_handle_that_is_not_learnt_is_named() -> None:
    controller = AdaptiveController(AdaptiveParameters(), LOOP)
    random = np.random.default_rng(3)
    for number in range(10_000):
        # A handle that does not move by the force.
        controller.force(float(random.standard_normal()), float(random.standard_normal()))
        controller.applied(1e-4 * float(random.standard_normal()))
        controller.adapt()
        controller.judged(0.0, 1.0 if number < 1000 else 1e-3)
        if number == 4000:
            assert "not learnt" not in controller.warning
    assert controller.warning.startswith("the handle's response is not learnt in 4 s of contact")
    controller.judged(0.0, 1.0)
    assert "not learnt" not in controller.warning
