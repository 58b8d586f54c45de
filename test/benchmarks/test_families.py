# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Families of inputs, handles and sensors: their halves, and what is counted."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from families import FAMILIES, RATE, Task, progress, run_member, summary

from running import Start

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "families.py"


@pytest.mark.quiet
@pytest.mark.slow
def test_one_half_is_told_and_the_other_is_counted(start: Start, tmp_path: Path) -> None:
    time = np.arange(8000) / RATE
    (tmp_path / "logged").mkdir()
    sine = np.sin(2 * np.pi * 100 * time)
    for name in "ab":
        file = tmp_path / "logged" / f"{name}.csv"
        np.savetxt(file, sine, header="acceleration", comments="")
    command = start(
        SCRIPT,
        *("strange", "recordings", "--recordings", "logged", "--recording-rate", "1000"),
        *("--members", "1", "--controllers", "none,inverse", "--json", "figures.json"),
    )
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    found = {(row["family"], row["rig"]) for row in figures["rows"]}
    assert found == {("strange", "ideal"), ("recordings", "ideal"), ("recordings", "paper")}
    assert all(row["reported"] for row in figures["rows"])
    counted = {line["members of"]: line["members"] for line in figures["summary"]}
    assert counted["recordings, paper, hidden"] == counted["recordings, paper, reported"] == 1
    assert counted["strange, ideal, hidden"] == 1
    assert "worst" in command.text


@pytest.mark.parametrize("family", FAMILIES)
def test_every_kind_is_in_both_halves_and_another_seed_gives_others(family: str) -> None:
    found, other = (list(FAMILIES[family](seed, 1)) for seed in (1, 2))
    halves = [[each.kind for each in found if each.reported == half] for half in (False, True)]
    assert halves[0] == halves[1]
    assert [each.kind for each in other] == [each.kind for each in found]
    both = zip(found, other, strict=True)
    assert any(one.name != two.name or one.grips != two.grips for one, two in both)


def test_the_force_after_silence_is_seen_and_what_is_wrong_is_named() -> None:
    members = {each.kind: each for each in FAMILIES["sensors"](1, 1) if each.reported}
    turned = run_member(Task(members["handle's sign"], ("none", "inverse")))
    assert set(turned["controllers"]) == {"constant", "inverse"}
    assert turned["controllers"]["constant"]["named_after_s"] < 1.0
    right = replace(members["tool's sign"], gains=np.eye(2))
    found = run_member(Task(right, ("none", "inverse")))
    assert found["controllers"]["inverse"]["force_after_silence_n"] < 0.1
    assert "not named" in progress(found)


def test_windows_above_none_and_false_names_are_counted() -> None:
    def followed(errors: list[float], *warnings: tuple[float, str]) -> dict[str, object]:
        ends = {"nrmse_percent": errors[0], "last_percent": errors[-1]}
        return {**ends, "nrmse_by_2_s_percent": errors, "warnings": warnings}

    row = {
        **{"family": "inputs", "kind": "sine", "named": "", "described": True, "rig": "ideal"},
        "limited_bound_percent": 20.0,
        "controllers": {
            "none": followed([100.0, 99.0, 100.0, 98.0]),
            "inverse": followed([103.0, 7.0, 50.0, 100.5]),
            "adaptive": followed([30.0, 8.0, 49.0, 95.0], (3.0, "above 150 Hz: run identify")),
        },
    }
    inverse, adaptive = (summary([row], name) for name in ("inverse", "adaptive"))
    assert (inverse["windows_above"], inverse["windows"]) == (2, 4)
    assert (inverse["windows_above_after"], inverse["windows_after"]) == (1, 2)
    assert inverse["worst_above_points"] == 3.0
    assert adaptive["above_inverse_points"] == 1.0
    assert (inverse["false_names"], adaptive["false_names"]) == (0, 1)
    assert (inverse["given_up"], inverse["near_bound"], adaptive["near_bound"]) == (1, 0, 0)
