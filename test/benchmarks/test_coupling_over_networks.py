# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of the coupling over networks."""

from __future__ import annotations

import json
from pathlib import Path

import coupling_over_networks as benchmark
import pytest
from coupling_over_networks import Condition, measure, over

FIELDS = (
    *("law", "one_way_ms", "jitter_ms", "loss", "energy_out_mj", "end_speed_m_s"),
    *("free_error_mm", "nrmse_percent", "indistinguishable_percent"),
)


def row(*condition: object) -> dict[str, float]:
    found = measure(Condition(*condition))  # type: ignore[arg-type]
    assert isinstance(found, dict)
    return found


@pytest.mark.slow
def test_a_spring_over_a_network_is_unstable_and_the_passive_law_is_not() -> None:
    near = over(6.25, 1.25)
    spring, passive = row("spring", near, near), row("passive", near)
    assert spring["energy_out_mj"] > 100
    assert spring["end_speed_m_s"] > 0.1
    assert passive["energy_out_mj"] <= 4.0
    assert passive["end_speed_m_s"] < 0.05
    assert passive["nrmse_percent"] < 50
    assert set(FIELDS) <= set(passive)


def test_the_slave_rests_on_a_wall_whatever_delay_comes_suddenly() -> None:
    found = row("passive", over(250.0, 50.0), over(6.25, 1.25))
    assert found["energy_out_mj"] <= 4.0
    assert found["end_speed_m_s"] < 0.05


@pytest.mark.slow
def test_the_error_in_free_space_stays_within_millimetres() -> None:
    assert row("passive", over(20.0, 10.0))["free_error_mm"] <= 5.0


def test_random_networks_give_no_more_energy_than_was_granted() -> None:
    assert all(0.0 <= float(measure(seed)) <= 1.0 for seed in range(3))  # type: ignore[arg-type]


@pytest.mark.slow
def test_the_command_prints_and_writes_its_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Its processes are copies of this one; all of its conditions take two minutes.
    monkeypatch.setattr(benchmark, "CONDITIONS", benchmark.CONDITIONS[-1:])
    monkeypatch.setattr(benchmark, "TRIALS", 1)
    table = tmp_path / "table.json"
    benchmark.coupling_over_networks.main(["--json", str(table)], standalone_mode=False)
    assert "NRMSE" in capsys.readouterr().out
    found = json.loads(table.read_text())
    assert (found["trials"], len(found["rows"])) == (1, 1)
    assert 0.0 <= found["worst_energy_over_bound"] <= 1.0
