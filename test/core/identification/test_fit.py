# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fits to the simulated rig, which knows nothing of them, and to many seeds of noise."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from haptic_accel.core.handle.mechanics import sampled_response
from haptic_accel.core.identification.estimate import FrequencyResponse, dft_ratio
from haptic_accel.core.identification.fit import DEFAULT_FREE, MOUNT, HandleFit, fit_handle
from haptic_accel.core.identification.sweep import SweepParameters, kept_repeats, sweep
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.trial import run_identification

RATE = 1000.0
SWEEP = SweepParameters()
FREQUENCY = np.linspace(10.0, 450.0, 45)
NOISE = 0.07  # m/s^2, that of the paper's accelerometer
TABLE_I = HandleParameters()


def measured(
    rig: MasterRigParameters,
    seed: int = 0,
    rate: float = RATE,
    of: SweepParameters = SWEEP,
) -> FrequencyResponse:
    (trial,) = run_identification(rig, of, rate, seed, latency=0)
    force, acceleration = (
        kept_repeats(values, of, rate)
        for values in (trial.actuator_force, trial.handle_acceleration)
    )
    return dft_ratio(force, acceleration, rate, of.band)


def errors(fit: HandleFit, true: HandleParameters) -> dict[str, float]:
    """Relative error of each fitted parameter of the handle."""
    names = fit.standard_errors.keys() - {"delay"}
    return {name: getattr(fit.handle, name) / getattr(true, name) - 1 for name in names}


# Recovery of the rig's parameters


@pytest.mark.parametrize("seed", range(5))
def test_table_i_comes_back(seed: int) -> None:
    fit = fit_handle(measured(MasterRigParameters(), seed))
    assert max(map(abs, errors(fit, TABLE_I).values())) < 0.02
    assert abs(fit.delay) < 20e-6
    assert fit.residual == pytest.approx(1.0, abs=0.2)
    assert (fit.handle.m_a, fit.handle.k_s) == (TABLE_I.m_a, TABLE_I.k_s)
    assert fit.band == pytest.approx(SWEEP.band)


@pytest.mark.parametrize(
    "hand",
    [
        {"b_s": 2.5, "m_h": 0.2, "k_u": 3500.0, "b_u": 12.0},
        {"b_s": 3.5, "m_h": 0.08, "k_u": 700.0, "b_u": 5.0},
        {"m_h": 0.25, "k_u": 600.0, "b_u": 30.0},
    ],
)
def test_another_hand_comes_back_too(hand: dict[str, float]) -> None:
    true = replace(TABLE_I, **hand)
    fit = fit_handle(measured(MasterRigParameters(handle=true)))
    assert max(map(abs, errors(fit, true).values())) < 0.03
    assert abs(fit.delay) < 20e-6


def test_pooled_recordings_are_more_certain() -> None:
    responses = [measured(MasterRigParameters(), seed) for seed in range(4)]
    one, pooled = (fit_handle(each, free=("k_u", "b_u")) for each in (responses[0], responses))
    for name, error in pooled.standard_errors.items():
        assert error == pytest.approx(one.standard_errors[name] / 2, rel=0.3)
    assert max(map(abs, errors(pooled, TABLE_I).values())) < 0.005


def test_mass_and_spring_of_the_actuator_can_be_free() -> None:
    estimate = measured(MasterRigParameters())
    fit = fit_handle(estimate, free=("m_a", "b_s", "m_h", "k_u", "b_u"))
    assert set(fit.standard_errors) == {"m_a", "b_s", "m_h", "k_u", "b_u"}
    for name, error in errors(fit, TABLE_I).items():
        assert abs(error) < 4 * fit.standard_errors[name] / getattr(TABLE_I, name)


def test_a_delay_may_be_known() -> None:
    estimate = noisy_response(np.random.default_rng(0), 1.3e-3)
    fit = fit_handle(estimate, free=("m_h", "b_u"), delay=1.3e-3)
    assert fit.delay == 1.3e-3
    assert max(map(abs, errors(fit, TABLE_I).values())) < 0.01
    assert np.abs(fit.response(FREQUENCY, RATE)).shape == FREQUENCY.shape


# Bias and standard errors


FORCE = np.tile(sweep(SWEEP, RATE), 2)


def noisy_response(random: np.random.Generator, delay: float) -> FrequencyResponse:
    """Return an estimate from Table I's settled answer to the sweep, and white noise."""
    lines = np.fft.rfftfreq(2000, 1 / RATE)
    spectrum = np.fft.rfft(FORCE[:2000])
    spectrum[1:-1] *= sampled_response(TABLE_I, lines[1:-1], RATE, delay)
    spectrum[[0, -1]] = 0.0
    clean = np.tile(np.fft.irfft(spectrum), 2)
    noise = random.normal(0.0, NOISE, len(clean))
    return dft_ratio(FORCE, clean + noise, RATE, SWEEP.band)


@pytest.mark.parametrize("delay", [1.3e-3])
def test_estimates_are_unbiased_and_their_errors_honest(delay: float) -> None:
    scaled = []
    for seed in range(20):
        fit = fit_handle(noisy_response(np.random.default_rng(seed), delay))
        found, true = asdict(fit.handle) | {"delay": fit.delay}, asdict(TABLE_I) | {"delay": delay}
        scaled.append([(found[n] - true[n]) / e for n, e in fit.standard_errors.items()])
    # Twenty seeds: a mean beyond 0.75 is 3.4 of its standard deviations.
    assert np.abs(np.mean(scaled, axis=0)).max() < 0.75
    assert np.mean(np.abs(scaled) < 2) > 0.85
    assert (np.std(scaled, axis=0) > 0.5).all()  # nor are they too large


# What is refused


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"free": ()}, r"^free = \(\): must hold at least one parameter besides friction$"),
        (
            {"free": ("m",)},
            "^free = 'm': must be among m_a, k_s, b_s, m_h, k_u, b_u, mount_frequency,"
            " mount_damping, delay, friction$",
        ),
        ({"free": ("m_h", "m_h")}, "^free = m_h, m_h: must hold each parameter once$"),
        (
            {"free": ("m_a", "k_s", "b_s", "m_h", "k_u", "b_u")},
            "^free = all six parameters of the handle: must be at most five",
        ),
        ({"delay": 0.5}, "^delay = 0.5: must be from -0.001 to 0.01 s$"),
        ({"low_pass_frequency": 0.0}, "^low_pass_frequency = 0.0: must be above 0 Hz$"),
        ({"known": HandleParameters(b_s=0.0)}, "^b_s = 0: must be above 0 to be the start of a"),
    ],
)
def test_what_cannot_be_fitted_is_refused(arguments: dict[str, object], message: str) -> None:
    estimate = noisy_response(np.random.default_rng(0), 0.0)
    with pytest.raises(ParameterError, match=message):
        fit_handle(estimate, **arguments)  # type: ignore[arg-type]


def test_a_response_without_coherence_cannot_be_fitted() -> None:
    estimate = noisy_response(np.random.default_rng(0), 0.0)
    nothing = replace(estimate, coherence=np.zeros_like(estimate.coherence))
    with pytest.raises(ParameterError, match="^responses: 0 lines with some coherence, must be"):
        fit_handle(nothing)


@pytest.mark.parametrize("frequency", [180.0, 300.0])
def test_the_accelerometers_mount_is_found_with_the_handle(frequency: float) -> None:
    mount = MountParameters(frequency=frequency, damping=0.13)
    wide = SweepParameters(end_frequency=450.0)
    response = measured(MasterRigParameters(mount=mount), seed=4, of=wide)
    start = MountParameters(frequency=250.0, damping=0.2)
    found = fit_handle(response, free=(*DEFAULT_FREE, *MOUNT), mount=start)
    assert found.mount.frequency == pytest.approx(frequency, rel=0.01)
    assert found.mount.damping == pytest.approx(0.13, rel=0.02)
    assert found.handle.m_h == pytest.approx(0.128, rel=0.02)
    assert found.handle.k_u == pytest.approx(1500.0, rel=0.02)
    assert found.delay == pytest.approx(0.0, abs=20e-6)
    # Without the mode nothing fits.
    assert fit_handle(response).residual > 10 * found.residual
