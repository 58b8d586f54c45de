from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from haptic_accel.core.metrics import REGRESSION, TABLE_II, Evaluation
from haptic_accel.startup.arguments import GraphArguments
from haptic_accel.startup.graph import graph_parameters, rig_parameters
from haptic_accel.tools.experiment import SURFACES
from haptic_accel.tools.fit_rig import CONTROLLERS, HIGHEST, LOWEST, Unknowns, distance, run


def paper() -> dict[tuple[str, str], list[Evaluation]]:
    """Return evaluations that are just the paper's."""
    evaluations = {}
    for surface in SURFACES:
        for controller in CONTROLLERS:
            slope, r2 = REGRESSION[controller]
            error = TABLE_II[surface, controller]
            evaluations[surface, controller] = [Evaluation(error, slope, r2 / slope, r2)]
    return evaluations


def test_the_papers_own_figures_are_at_no_distance() -> None:
    assert distance(paper()) == pytest.approx(0.0)


def test_eight_points_in_one_cell_are_a_distance_of_one() -> None:
    evaluations = paper()
    (found,) = evaluations["text", "dynamic"]
    evaluations["text", "dynamic"] = [replace(found, nrmse_percent=found.nrmse_percent + 8.0)]
    assert distance(evaluations) == pytest.approx(1.0)


def test_the_kept_outcome_lies_within_what_is_plausible() -> None:
    master = rig_parameters(graph_parameters(GraphArguments(rig="paper"))).master
    kept = Unknowns(
        master.structure.frequency,
        master.structure.damping,
        master.actuator.delay,
        master.actuator.coulomb_friction,
    )
    for low, value, high in zip(
        vars(LOWEST).values(), vars(kept).values(), vars(HIGHEST).values(), strict=True
    ):
        assert low <= value <= high


def test_every_condition_is_run_for_every_seed() -> None:
    with ThreadPoolExecutor(1) as pool:
        found = run(HIGHEST, seeds=2, duration=1.0, pool=pool)
    assert set(found) == {(s, c) for s in SURFACES for c in CONTROLLERS}
    assert all(len(evaluations) == 2 for evaluations in found.values())
