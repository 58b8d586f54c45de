# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of the coupling over networks."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.cli.network import CONDITIONS, TRIALS, Condition, measure, over
from running import Command

Start = Callable[..., Command]
FIELDS = (
    *("law", "one_way_ms", "jitter_ms", "loss", "energy_out_mj", "end_speed_m_s"),
    *("free_error_mm", "nrmse_percent", "st_sim"),
)


def row(*condition: object) -> dict[str, float]:
    found = measure(Condition(*condition))  # type: ignore[arg-type]
    assert isinstance(found, dict)
    return found


def test_a_spring_over_a_network_is_unstable_and_the_passive_law_is_not() -> None:
    network = over(6.25, 1.25)
    spring, passive = row("spring", network, network), row("passive", network)
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


def test_the_error_in_free_space_stays_within_millimetres() -> None:
    assert row("passive", over(20.0, 10.0))["free_error_mm"] <= 5.0


def test_random_networks_give_no_more_energy_than_was_granted() -> None:
    assert all(0.0 <= float(measure(seed)) <= 1.0 for seed in range(3))  # type: ignore[arg-type]


@pytest.mark.quiet
@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_command_prints_and_writes_its_rows(haptic_accel: Start, tmp_path: Path) -> None:
    command = haptic_accel("bench", "network", "--json", "table.json")
    assert command.end(patience=800.0) == 0, command.text
    assert "NRMSE" in command.text
    found = json.loads((tmp_path / "table.json").read_text())
    assert (found["trials"], len(found["rows"])) == (TRIALS, len(CONDITIONS))
    assert 0.0 <= found["worst_energy_over_bound"] <= 1.0
