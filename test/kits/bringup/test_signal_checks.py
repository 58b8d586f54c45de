# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of a new rig's signals, with signals whose answer is known."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from haptic_accel.kits.bringup import signal_checks

RATE = 1000.0
RANDOM = np.random.default_rng(0)
NOISE = 0.07  # m/s^2, of an ADXL320J


def at_rest(samples: int = 1000) -> np.ndarray:
    return 0.5 + RANDOM.normal(0.0, NOISE, samples)


def failed(signal: np.ndarray) -> list[str]:
    return [check.text for check in signal_checks.rest_checks(signal) if not check.passed]


def test_a_sensor_at_rest_passes_with_its_noise() -> None:
    counted, noise = signal_checks.rest_checks(at_rest())
    assert counted.passed
    assert noise.passed
    assert float(noise.text.split()[3]) == pytest.approx(NOISE, rel=0.1)


def test_what_is_wrong_with_a_signal_is_named() -> None:
    gap = at_rest()
    gap[100:200] = np.nan
    loud = at_rest() * 20
    clipped = np.clip(RANDOM.normal(0.0, 40.0, 1000), -49.0, 49.0)
    assert failed(np.full(100, np.nan)) == ["no signal"]
    assert failed(np.full(100, 3.0)) == ["the signal is constant"]
    assert failed(gap) == ["100 of 1000 samples missing (at most 1%)"]
    assert failed(clipped) == ["the signal is clipped at 49 m/s^2"]
    assert failed(loud)[0].startswith("noise at rest 1.")


def test_a_tap_is_told_from_noise() -> None:
    signal = at_rest()
    assert not signal_checks.is_tapped(signal, NOISE)
    signal[500:505] += 5.0
    assert signal_checks.is_tapped(signal, NOISE)
    assert not signal_checks.is_tapped(np.full(10, np.nan), NOISE)


@pytest.mark.parametrize("phase", [0.0, -0.5, math.pi])
def test_the_response_is_that_of_the_probed_system(phase: float) -> None:
    time = np.arange(1000) / RATE
    omega = 2 * math.pi * signal_checks.PROBE_FREQUENCY
    force = 0.3 * np.cos(omega * time)
    acceleration = 0.3 * 7.0 * np.cos(omega * time + phase) + at_rest()
    acceleration[::50] = np.nan
    expected = pytest.approx(cmath.rect(7.0, phase), abs=0.1)
    assert signal_checks.response(force, acceleration, RATE) == expected


def test_responses_are_judged() -> None:
    def passed(small: complex, large: complex) -> list[bool]:
        return [check.passed for check in signal_checks.probe_checks(small, large, noise=0.01)]

    assert passed(7.0, 7.0) == [True, True, True]
    assert passed(-7.0, -7.0) == [True, False, True]
    assert passed(3.0, 7.0) == [True, True, False]
    assert passed(0.0, 0.01 / signal_checks.PROBE_FORCES[1]) == [False]


def test_a_tool_that_hears_the_handle_is_told() -> None:
    assert signal_checks.apart_check(0.7, 7.0).passed
    heard = signal_checks.apart_check(7.0, 7.0)
    assert not heard.passed
    assert "picks up 100% of the handle's motion" in heard.text


def test_the_time_until_a_handle_is_quiet_is_that_of_its_decay() -> None:
    # An amplitude that decays with a time constant of 20 ms is a tenth after 20 ms ln 10 = 46 ms.
    time = np.arange(1000) / RATE
    envelope = np.where(time < 0.5, 1.0, np.exp(-(time - 0.5) / 0.02))
    signal = 3.0 * envelope * np.cos(2 * math.pi * signal_checks.PROBE_FREQUENCY * time)
    assert signal_checks.quiet_after(signal, RATE, 500, 0.0) == pytest.approx(0.046, abs=0.01)
    assert signal_checks.quiet_after(np.ones(1000), RATE, 500, noise=0.0) == math.inf
    assert signal_checks.quiet_after(np.where(time < 0.5, 1.0, 0.0), RATE, 500, noise=0.0) == 0.0


def test_current_and_proof_are_judged() -> None:
    assert signal_checks.current_check(0.095, 0.1).passed
    assert not signal_checks.current_check(-0.1, 0.1).passed
    assert signal_checks.proof_check(100.0, 12.0, least=5.0).passed
    assert not signal_checks.proof_check(100.0, 13.0, least=5.0).passed
