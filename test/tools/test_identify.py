from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.startup.arguments import GraphArguments
from haptic_accel.startup.graph import graph, graph_parameters, rig_parameters
from running import Command

Start = Callable[..., Command]
TABLE_I = {"m_a": 0.018, "k_s": 266.0, "b_s": 2.0, "m_h": 0.128, "k_u": 1500.0, "b_u": 11.0}


def test_table_i_comes_back_as_a_parameter_file(haptic_accel: Start, tmp_path: Path) -> None:
    # The ideal rig with the noise of the paper's sensor.
    (tmp_path / "noise.yaml").write_text(
        "master_device: {ros__parameters: {simulated: {accelerometer: {noise_density: 0.00245}}}}"
    )
    command = haptic_accel(
        *("identify", "--lockstep", "rig:=ideal", "config:=noise.yaml", "--trials", "2"),
        *("--json", "figures.json", "--out", "found"),
    )
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert set(figures["parameters"]) == set(TABLE_I)
    for name, true in TABLE_I.items():
        found = figures["parameters"][name]
        assert found["value"] == pytest.approx(true, rel=0.02), name
        assert found["unit"]
        # Mass and spring of the actuator were known.
        assert (found["standard_error"] is None) == (name in ("m_a", "k_s"))
    assert figures["delay_s"] == pytest.approx(0.0, abs=20e-6)
    assert figures["max_magnitude_error_db"] < 1.0
    assert figures["max_phase_error_deg"] < 5.0
    assert figures["band_hz"] == [15.0, 180.0]
    for name in ("fig4_sweep.png", "fig5_models.png"):
        assert (tmp_path / "found" / name).read_bytes().startswith(b"\x89PNG")
    # What was written is what the graph takes.
    arguments = GraphArguments(rig="ideal", config=str(tmp_path / "found" / "handle.yaml"))
    graph(arguments)
    handle = rig_parameters(graph_parameters(arguments)).master.handle
    assert handle.m_h == pytest.approx(figures["parameters"]["m_h"]["value"], rel=1e-5)


def test_on_the_papers_rig_models_follow_the_handle_to_400_hz(
    haptic_accel: Start, tmp_path: Path
) -> None:
    command = haptic_accel(
        *("identify", "--lockstep", "rig:=paper", "--end-frequency", "450", "--trials", "4"),
        *("--json", "figures.json", "--out", "found"),
    )
    assert command.end() == 0, command.text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["band_hz"] == [15.0, 400.0]
    # The true response is without dry friction, which is what the error comes from.
    assert figures["max_magnitude_error_db"] < 1.1
    assert figures["max_phase_error_deg"] < 5.0
    assert figures["physical_model"]["magnitude_db"] < 1.0
    assert figures["physical_model"]["phase_deg"] < 5.0
    assert figures["mount"]["frequency"] == pytest.approx(280.0, rel=0.02)


@pytest.mark.parametrize(
    ("words", "status", "named"),
    [
        (["--lockstep", "--trials", "0"], 2, "trials"),
        (["--lockstep", "--end-frequency", "600"], 2, "end_frequency"),
        (["--lockstep", "--start-amplitude", "0", "--end-amplitude", "0.001"], 1, "force"),
        (["--lockstep", "rig:=nothing"], 2, "rig"),
        (["--lockstep", "--out", "."], 2, "out"),
        (["--lockstep", "--json", "no/such/folder.json"], 2, "json"),
        ([], 2, "lockstep"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    haptic_accel: Start, words: list[str], status: int, named: str
) -> None:
    command = haptic_accel("identify", *words)
    assert command.end() == status, command.text
    assert len(command.lines) == 1, command.text
    assert named in command.text
