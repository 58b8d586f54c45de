# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, fields, replace
from pathlib import Path

import numpy as np
import pytest

from fit_rig import CONTROLLERS, HIGHEST, LOWEST, Unknowns, deviations, run
from haptic_accel.analysis.experiment import RIG_NOTES
from haptic_accel.core.evaluation.metrics import REGRESSION, TABLE_II, Evaluation
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.setup.arguments import SURFACES, GraphArguments
from haptic_accel.setup.setup import Setup

SOURCE = Path(__file__).resolve().parents[2]


def paper() -> dict[tuple[str, str], list[Evaluation]]:
    """Return evaluations that are just the paper's."""
    evaluations = {}
    for surface in SURFACES:
        for controller in CONTROLLERS:
            slope, r2 = REGRESSION[controller]
            error = TABLE_II[surface, controller]
            evaluations[surface, controller] = [Evaluation(error, slope, r2 / slope, r2)]
    return evaluations


def kept(surface: str) -> RigParameters:
    """Return the rig as config/ describes it."""
    return Setup.of(GraphArguments(rig="paper", surface=surface)).rig()


def test_the_papers_own_figures_do_not_deviate() -> None:
    # Six cells; slope and R^2 of two controllers.
    assert deviations(paper()) == pytest.approx(np.zeros(10), abs=1e-9)


def test_eight_points_in_one_cell_are_a_deviation_of_one() -> None:
    evaluations = paper()
    (found,) = evaluations["text", "dynamic"]
    evaluations["text", "dynamic"] = [replace(found, nrmse_percent=found.nrmse_percent + 8.0)]
    expected = np.zeros(10)
    expected[list(evaluations).index(("text", "dynamic"))] = 1.0
    assert deviations(evaluations) == pytest.approx(expected, abs=1e-9)


def outcome() -> Unknowns:
    """Return what config/ keeps of a fit."""
    master = kept("plywood").master
    return Unknowns(
        master.mount.frequency,
        master.mount.damping,
        master.drive.delay,
        *(kept(surface).slave.surface.contact_damping for surface in SURFACES),
    )


def test_the_kept_outcome_lies_within_what_is_plausible() -> None:
    both = (astuple(each) for each in (LOWEST, outcome(), HIGHEST))
    for low, value, high in zip(*both, strict=True):
        assert low <= value <= high


@pytest.mark.parametrize("surface", SURFACES)
def test_the_kept_outcome_makes_the_rig_that_is_kept(surface: str) -> None:
    rig = kept(surface)
    assert HIGHEST.rig(rig) != rig
    assert outcome().rig(HIGHEST.rig(rig)) == rig


def test_every_condition_is_run_for_every_seed() -> None:
    with ThreadPoolExecutor(1) as pool:
        found = run(HIGHEST, seeds=2, duration=1.0, pool=pool)
    assert set(found) == {(s, c) for s in SURFACES for c in CONTROLLERS}
    assert all(len(evaluations) == 2 for evaluations in found.values())


def test_every_page_states_the_number_of_fitted_values() -> None:
    surfaces = [SOURCE / f"config/surfaces/{name}.yaml" for name in SURFACES]
    files = (SOURCE / "config/rigs/paper.yaml", *surfaces)
    marked = sum(path.read_text().count("; fitted;") for path in files)
    assert marked == len(fields(Unknowns)) == 6
    names = ["config/rigs/paper.yaml", "docs/virtual_rig.md"]
    told = [(SOURCE / name).read_text() for name in names]
    assert all("Six numbers" in text for text in [*told, RIG_NOTES["paper"]])
