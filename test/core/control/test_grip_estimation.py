from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from haptic_accel.core.control.grip_estimation import (
    LARGEST,
    SMALLEST,
    AdaptationParameters,
    GripEstimator,
)
from haptic_accel.core.control.inversion.plant import Plant
from haptic_accel.core.model import AccelerometerParameters, HandleParameters
from haptic_accel.core.rig.master_rig import DriveParameters, MasterRig, MasterRigParameters

RATE = 1000.0
TABLE_I = HandleParameters()
SOFT = replace(TABLE_I, m_h=0.1, k_u=900.0, b_u=7.0)
STIFF = replace(TABLE_I, m_h=0.16, k_u=2600.0, b_u=19.0)
PLANT = Plant()


def estimator(**parameters: float) -> GripEstimator:
    return GripEstimator(PLANT, RATE, AdaptationParameters(**parameters))


def rig(handle: HandleParameters, noise: float = 0.0, rate: float = RATE) -> MasterRig:
    sensor = AccelerometerParameters(noise_density=noise, bits=32)
    return MasterRig(
        MasterRigParameters(handle, drive=DriveParameters(bits=32), accelerometer=sensor),
        rate,
    )


def drive(
    of: GripEstimator,
    master: MasterRig,
    seconds: float,
    force: float = 0.5,
    start: float = 0.0,
    rate: float = RATE,
) -> None:
    """Excite the handle by white force, N RMS, and let the estimator see it."""
    random = np.random.default_rng(0)
    first = round(start * rate)
    applied = 0.0
    measured = 0.0
    for index in range(first, first + round(seconds * rate)):
        master.advance(index / rate)
        of.sample(applied, measured)  # both of the sample before
        measured = master.measure().acceleration
        applied = float(random.normal(0.0, force)) if force else 0.0
        master.apply_actuator_force(applied)
        of.step()


def grip_of(handle: HandleParameters) -> np.ndarray:
    return np.array([handle.m_h, handle.b_u, handle.k_u])


@pytest.mark.parametrize("handle", [TABLE_I, SOFT, STIFF])
@pytest.mark.parametrize("noise", [0.0, 0.00245])
def test_the_grip_is_found_from_force_and_acceleration(
    handle: HandleParameters, noise: float
) -> None:
    found = estimator()
    drive(found, rig(handle, noise), 3.0)
    assert found.looks > 5
    assert found.grip[0] == pytest.approx(handle.m_h, rel=0.05)
    assert found.grip[1] == pytest.approx(handle.b_u, rel=0.15)
    # Above 15 Hz stiffness hardly counts.
    assert found.grip[2] == pytest.approx(handle.k_u, rel=0.35)


def test_it_is_found_at_4_khz_too() -> None:
    found = GripEstimator(PLANT, 4000.0, AdaptationParameters())
    drive(found, rig(SOFT, rate=4000.0), 2.5, rate=4000.0)
    assert found.grip[0] == pytest.approx(SOFT.m_h, rel=0.05)


def test_a_change_of_grip_is_followed_within_two_seconds() -> None:
    found = estimator()
    master = rig(SOFT)
    drive(found, master, 2.0)
    master.change_grip(STIFF)
    drive(found, master, 2.0, start=2.0)
    assert found.grip[0] == pytest.approx(STIFF.m_h, rel=0.05)
    assert found.grip[1] == pytest.approx(STIFF.b_u, rel=0.2)


@pytest.mark.parametrize("force", [0.0, 1e-3])
def test_without_excitation_it_stays_put(force: float) -> None:
    found = estimator()
    drive(found, rig(SOFT, noise=0.00245), 3.0, force=force)
    assert found.looks == 0
    assert found.grip == pytest.approx(grip_of(TABLE_I))


def test_what_was_learnt_stays_while_nothing_is_felt() -> None:
    found = estimator()
    master = rig(SOFT, noise=0.00245)
    drive(found, master, 3.0)
    learnt = found.grip.copy()
    drive(found, master, 1.0, force=0.0, start=3.0)  # the last look that saw excitation
    looks = found.looks
    learnt = found.grip.copy()
    drive(found, master, 5.0, force=0.0, start=4.0)
    assert found.looks == looks
    assert found.grip == pytest.approx(learnt)


def test_a_single_frequency_leaves_no_nonsense() -> None:
    found = estimator()
    master = rig(SOFT)
    applied = measured = 0.0
    for index in range(3000):
        master.advance(index / RATE)
        found.sample(applied, measured)
        measured = master.measure().acceleration
        applied = 0.5 * math.sin(2 * math.pi * 90.0 * index / RATE)
        master.apply_actuator_force(applied)
        found.step()
    factors = found.grip / grip_of(TABLE_I)
    assert np.all(factors > 0.3)
    assert np.all(factors < 3.0)


def test_some_missing_samples_do_no_harm_many_stop_it() -> None:
    for every, looks in ((200, True), (20, False)):
        found = estimator()
        master = rig(SOFT)
        random = np.random.default_rng(0)
        applied = measured = 0.0
        for index in range(3000):
            master.advance(index / RATE)
            found.sample(applied, math.nan if index % every == 0 else measured)
            measured = master.measure().acceleration
            applied = float(random.normal(0.0, 0.5))
            master.apply_actuator_force(applied)
            found.step()
        assert (found.looks > 0) == looks
        if looks:
            assert found.grip[0] == pytest.approx(SOFT.m_h, rel=0.1)


@settings(deadline=None, max_examples=20)
@given(
    st.integers(0, 2**31),
    st.floats(0.0, 100.0),
    st.floats(0.0, 1e4),
)
@example(0, 1.0, 0.0)
def test_whatever_it_sees_the_grip_stays_in_the_safe_set(
    seed: int, force: float, acceleration: float
) -> None:
    found = estimator()
    random = np.random.default_rng(seed)
    for f, a in zip(
        random.normal(0, force, 1500), random.normal(0, acceleration, 1500), strict=True
    ):
        found.sample(float(f), float(a))
        found.step()
    assert np.isfinite(found.grip).all()
    factors = found.grip / grip_of(TABLE_I)
    assert np.all(factors >= SMALLEST * (1 - 1e-9))
    assert np.all(factors <= LARGEST * (1 + 1e-9))


def test_reset_forgets_the_grip() -> None:
    used, fresh = estimator(), estimator()
    drive(used, rig(SOFT), 2.0)
    used.reset()
    assert used.grip == pytest.approx(grip_of(TABLE_I))
    drive(used, rig(STIFF), 2.0)
    drive(fresh, rig(STIFF), 2.0)
    assert used.grip == pytest.approx(fresh.grip)
