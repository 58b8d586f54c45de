from __future__ import annotations

import numpy as np
import pytest

from haptic_accel.core.topics import CONTACT_FORCE, MASTER_ARM_FORCE
from haptic_accel.core.trial import Trial
from haptic_accel.graph.arguments import GraphArguments
from haptic_accel.graph.lockstep import lockstep_trial


def trial(coupling: str) -> Trial:
    return lockstep_trial(GraphArguments(surface="text", duration=5.0, coupling=coupling))


def test_on_one_host_both_couplings_let_feel_the_surface_alike() -> None:
    spring, passive = map(trial, ("spring", "passive"))
    first, second = (each.evaluate(first=2000).nrmse_percent for each in (spring, passive))
    assert second == pytest.approx(first, abs=1.0)
    forces = [each.arms[MASTER_ARM_FORCE.name] for each in (spring, passive)]
    assert not np.array_equal(*forces), "the law is another one"
    pressed = [force[2000:, 2].mean() for force in forces]
    assert pressed[1] == pytest.approx(pressed[0], rel=0.05)


def test_the_scripted_hand_strokes_the_workshop_s_bench() -> None:
    found = lockstep_trial(GraphArguments(slave="virtual", duration=2.0))
    assert found.surface == "workshop"
    force = found.arms[CONTACT_FORCE.name]
    stroke = slice(1100, 1400)
    assert force[stroke, 2].mean() == pytest.approx(1.0, rel=0.3)
    assert abs(force[stroke, 0]) == pytest.approx(0.35 * force[stroke, 2], rel=0.05)
    assert np.abs(found.tool_acceleration).max() > 1.0
