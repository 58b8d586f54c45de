# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import three_coils
from bag_maker import BagContent, write_bag
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.handle.plant import read_matrix_plant
from haptic_accel.core.identification.evaluation import stages
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import POSTURES
from haptic_accel.core.topics import ACTUATOR_FORCE, HANDLE_ACCELERATION
from haptic_accel.core.trial import run_identification
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.files import EVERY_NODE, update_parameter_file
from haptic_accel.setup.processes import graph
from haptic_accel.setup.setup import Setup
from haptic_accel.setup.words import parse_assignments
from nightly import rest_slow
from observing import Observer
from running import Start
from verbs import WITHOUT_FRICTION, next_command, output_of, refusal, status_of

TABLE_I = {"m_a": 0.018, "k_s": 266.0, "b_s": 2.0, "m_h": 0.128, "k_u": 1500.0, "b_u": 11.0}


def test_table_i_comes_back_as_a_parameter_file(ran: Callable[..., str], tmp_path: Path) -> None:
    # The ideal rig with as much noise as the paper's sensor has behind its low-pass.
    noisy = "simulated: {accelerometer: {noise_density: 0.00017}}"
    (tmp_path / "noise.yaml").write_text(f"master_device: {{ros__parameters: {{{noisy}}}}}")
    text = ran(
        *("identify", "--lockstep", "rig:=ideal", "params_file:=noise.yaml", "--trials", "2"),
        *("--json", "metrics.json", "--out", "found", "--update", "noise.yaml"),
    )
    last = text.rstrip().splitlines()[-1]
    words = "params_file:=noise.yaml controller:=adaptive rig:=ideal"
    assert last.endswith(f"next: haptic-accel teleop {words}")
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert set(metrics["parameters"]) == set(TABLE_I)
    for file in ("noise.yaml", "found/handle.yaml"):
        held = Setup.of(GraphArguments(params_file=str(tmp_path / file))).values["compensator"]
        for name in ("b_s", "k_s"):
            known = metrics["parameters"][name]["value"]
            assert held[f"actuator.{name}"] == pytest.approx(known, rel=1e-5)
    updated = (tmp_path / "noise.yaml").read_text()
    assert "noise_density: 0.00017" in updated
    assert 'device: "simulated"' in updated
    for name, true in TABLE_I.items():
        found = metrics["parameters"][name]
        assert found["unit"]
        # Mass and spring of the actuator were known.
        error = found["standard_error"] or 0.0
        assert (error == 0.0) == (name in ("m_a", "k_s"))
        assert error < 0.04 * true, name
        assert found["value"] == pytest.approx(true, abs=2 * error), name
    assert metrics["delay_s"] == pytest.approx(0.0, abs=20e-6)
    assert metrics["max_magnitude_error_db"] < 1.0
    assert metrics["max_phase_error_deg"] < 5.0
    assert metrics["band_hz"] == [15.0, 180.0]
    for name in ("fig4_sweep.png", "fig5_models.png"):
        assert (tmp_path / "found" / name).read_bytes().startswith(b"\x89PNG")
    # What was written is what the graph takes.
    arguments = GraphArguments(rig="ideal", params_file=str(tmp_path / "found" / "handle.yaml"))
    graph(arguments)
    handle = Setup.of(arguments).rig().master.handle
    assert handle.m_h == pytest.approx(metrics["parameters"]["m_h"]["value"], rel=1e-5)
    # A friction that may be none is left out.
    assert abs(metrics["friction_n"]) <= 2 * metrics["friction_standard_error_n"]
    assert "friction: 0.0" in (tmp_path / "found" / "handle.yaml").read_text()


@pytest.mark.quiet
@pytest.mark.slow
def test_on_the_papers_rig_models_follow_the_handle_to_400_hz(
    haptic_accel: Start, tmp_path: Path
) -> None:
    command = haptic_accel(
        *("identify", "--lockstep", "rig:=paper", "--end-frequency", "450"),
        *("--start-amplitude", "0.3"),
        *("--json", "metrics.json", "--out", "found"),
    )
    assert command.end() == 0, command.text
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["band_hz"] == [15.0, 400.0]
    # The true response is without dry friction, of which the discrete model knows nothing.
    assert metrics["max_magnitude_error_db"] < 1.0
    assert metrics["max_phase_error_deg"] < 5.0
    assert metrics["physical_model"]["magnitude_db"] < 0.2
    assert metrics["physical_model"]["phase_deg"] < 1.0
    assert metrics["mount"]["frequency"] == pytest.approx(287.0, rel=0.02)


@pytest.mark.parametrize(
    ("words", "status", "named"),
    [
        (["--lockstep", "--start-amplitude", "0", "--end-amplitude", "0.001"], 1, "force"),
        (["--lockstep", "--start-amplitude", "0.8", "--trials", "1"], 1, "force limited"),
        (["--lockstep", "--free", "m_h,colour"], 2, "colour"),
        (["--lockstep", "--free", "friction,friction,m_h"], 2, "once"),
        (["--lockstep", "--free", "friction"], 2, "free = friction: must hold"),
        (["--from", "no_bag"], 2, "no_bag"),
        (["--from", "no.csv", "--recording-rate", "1000"], 2, "no.csv"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    words: list[str], status: int, named: str, here: Path
) -> None:
    assert named in refusal("identify", *words, status=status)
    assert not list(here.rglob("handle.yaml"))
    assert not list(here.rglob("identify_*"))


SHORT = ("--duration", "1", "--trials", "1")


def forces(bag: Path) -> np.ndarray:
    """Return the actuator's forces in a bag, N."""
    values: np.ndarray = read_bag(bag).signals[ACTUATOR_FORCE.name].values
    return values[:, ACTUATOR_AXIS]


@pytest.mark.slow
def test_the_live_graph_finds_the_handle_grip_by_grip(haptic_accel: Start, tmp_path: Path) -> None:
    command = haptic_accel(
        # Two trials, because one during which the host was away is left out.
        *("identify", "rig:=ideal", "--grips", "pinch,hook", "--duration", "1", "--trials", "2"),
        *("--json", "metrics.json", "--out", "found"),
    )
    assert command.end() == 0, command.text
    assert any("repeat 3 of 3" in line for line in command.lines)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    for grip, (m_h, k_u, b_u) in (("pinch", POSTURES["pinch"]), ("hook", POSTURES["hook"])):
        found = {n: p["value"] for n, p in metrics["grips"][grip]["parameters"].items()}
        assert found["m_h"] == pytest.approx(m_h * TABLE_I["m_h"], rel=0.02)
        assert found["k_u"] == pytest.approx(k_u * TABLE_I["k_u"], rel=0.02)
        assert found["b_u"] == pytest.approx(b_u * TABLE_I["b_u"], rel=0.05)
        assert metrics["grips"][grip]["delay_s"] == pytest.approx(0.0, abs=20e-6)
        sent = forces(tmp_path / "found" / "bags" / grip)
        assert np.abs(sent).max() > 1.0
        assert sent[-1] == 0.0
    # The same bag, evaluated later.
    again = haptic_accel(
        *("identify", "rig:=ideal", "--from", "pinch=found/bags/pinch", "--duration", "1"),
        *("--json", "again.json", "--out", "again"),
    )
    assert again.end() == 0, again.text
    later = json.loads((tmp_path / "again.json").read_text())
    assert later["parameters"] == metrics["grips"]["pinch"]["parameters"]
    assert later["max_magnitude_error_db"] is None  # the truth of a recording is not known
    # Another sweep than it was made with.
    swept = ("--duration", "1", "--end-frequency", "300")
    wrong = haptic_accel("identify", "--from", "found/bags/pinch", *swept)
    assert wrong.end() == 1
    assert "actuator_force: correlates" in wrong.text


@pytest.mark.quiet
def test_an_actuator_near_its_stops_is_left_without_force(
    haptic_accel: Start, tmp_path: Path
) -> None:
    strong = ("--start-amplitude", "4", "--end-amplitude", "4", "--out", "found")
    command = haptic_accel("identify", "rig:=ideal", *SHORT, *strong)
    assert command.end() == 1, command.text
    assert "travel: " in command.text
    assert "smaller amplitude" in command.text
    assert "Traceback" not in command.text
    assert forces(tmp_path / "found" / "bags" / "average")[-1] == 0.0
    assert not (tmp_path / "found" / "handle.yaml").exists()


SHORT_TRAVEL = {EVERY_NODE: {"actuator": {"travel": 0.0012}}}


@pytest.mark.slow
def test_default_amplitudes_that_are_too_strong_are_lowered(here: Path) -> None:
    update_parameter_file(here / "short.yaml", SHORT_TRAVEL)
    words = ("--lockstep", "rig:=ideal", "params_file:=short.yaml", *SHORT, *WITHOUT_FRICTION)
    said = output_of("identify", *words, "--json", "metrics.json", "--out", "found")
    told = [line for line in said.splitlines() if "repeated with" in line]
    shares = [int(line.partition("repeated with ")[2].split()[0]) for line in told]
    assert shares[:3] == [71, 50, 35][: len(shares)]
    assert all("use a smaller amplitude" in line for line in told)
    metrics = json.loads((here / "metrics.json").read_text())
    assert metrics["parameters"]["m_h"]["value"] == pytest.approx(TABLE_I["m_h"], rel=0.02)
    # Amplitudes that were given are kept.
    assert status_of("identify", *words, "start_amplitude:=0.25", "--out", "again") == 1


@pytest.mark.slow
def test_live_amplitudes_that_are_too_strong_are_lowered(
    haptic_accel: Start, tmp_path: Path
) -> None:
    update_parameter_file(tmp_path / "short.yaml", SHORT_TRAVEL)
    words = ("rig:=ideal", "params_file:=short.yaml", *SHORT, *WITHOUT_FRICTION)
    command = haptic_accel("identify", *words, "--out", "found")
    assert command.end() == 0, command.text
    assert "use a smaller amplitude; repeated with 71 % of the amplitudes" in command.text
    bags = sorted(bag.name for bag in tmp_path.glob("found/bags/*"))
    assert bags == ["average", *(f"average_{run}" for run in range(2, len(bags) + 1))]
    share = math.sqrt(0.5) ** (len(bags) - 1)
    assert np.abs(forces(tmp_path / "found" / "bags" / bags[-1])).max() <= 1.68 * share + 1e-9
    assert (tmp_path / "found" / "handle.yaml").exists()


@pytest.mark.quiet
def test_a_stop_takes_the_force_off_and_keeps_the_recording(
    haptic_accel: Start, observer: Observer, tmp_path: Path
) -> None:
    command = haptic_accel("identify", "rig:=ideal", "--out", "found")
    command.wait_for("repeat 1 of 3")
    with observer.watching(ACTUATOR_FORCE) as wait_for:
        wait_for(lambda message: message.wrench.force.z != 0.0)
    assert command.end(signal.SIGINT) == 130, command.text
    sent = forces(tmp_path / "found" / "bags" / "average")
    assert np.abs(sent).max() > 0.0
    assert sent[-1] == 0.0


@pytest.mark.quiet
def test_an_emergency_stop_ends_the_run(haptic_accel: Start, tmp_path: Path) -> None:
    command = haptic_accel("identify", "rig:=ideal", "--out", "found")
    command.wait_for("repeat 1 of 3")
    haptic_accel("estop")  # waits for a coupler, which is not there to confirm
    assert command.end() == 1, command.text
    assert "emergency stop: force taken off" in command.text
    assert forces(tmp_path / "found" / "bags" / "average")[-1] == 0.0


COLUMNS = "actuator_force,handle_acceleration"


def recording(file: Path, header: str = COLUMNS, **sweep: float) -> None:
    """Write a CSV file of a sweep of one second."""
    parameters = SweepParameters(duration=1.0, **sweep)
    (trial,) = run_identification(parameters=parameters, rate=1000.0, latency=0)
    columns = np.column_stack([trial.actuator_force, trial.handle_acceleration])
    np.savetxt(file, columns, delimiter=",", header=header, comments="")


def test_a_csv_recording_has_named_columns(here: Path) -> None:
    words = ("--from", "bench.csv", "--recording-rate", "1000", "--duration", "1")
    words += WITHOUT_FRICTION
    missing = {"force,acceleration": "actuator_force", "actuator_force,a": "handle_acceleration"}
    for header, named in missing.items():
        recording(here / "bench.csv", header)
        assert named in refusal("identify", *words, "--out", "found")
    recording(here / "bench.csv")
    told = output_of("identify", *words, "--json", "metrics.json", "--out", "found")
    shown = ["reading bench.csv", *stages(["average"])[:3], "discrete model"]
    assert told.splitlines()[: len(shown)] == shown
    metrics = json.loads((here / "metrics.json").read_text())
    assert metrics["parameters"]["m_h"]["value"] == pytest.approx(TABLE_I["m_h"], rel=0.02)
    assert (here / "found" / "index.html").is_file()


G = 9.80665


@pytest.mark.parametrize(
    ("header", "force", "acceleration", "words"),
    rest_slow(
        [
            ("actuator_force [mN],handle_acceleration [g]", 1000.0, 1 / G, ()),
            (COLUMNS, 1.0, 1 / G, ("m_h = 1.2", "in another unit")),
        ]
    ),
)
def test_units_are_converted_or_a_mass_outside_all_sense_is_doubted(
    here: Path, header: str, force: float, acceleration: float, words: Sequence[str]
) -> None:
    (trial,) = run_identification(parameters=SweepParameters(duration=1.0), rate=1000.0, latency=0)
    columns = [trial.actuator_force * force, trial.handle_acceleration * acceleration]
    times = np.arange(len(columns[0])) / 1000.0
    table = np.column_stack([times, *columns])
    np.savetxt(here / "bench.csv", table, delimiter=",", header="t," + header, comments="")
    found = ("identify", "--from", "bench.csv", "--duration", "1", "--json", "metrics.json")
    found += WITHOUT_FRICTION
    refused = refusal(*found, "--recording-rate", "2000")
    assert "column t says 1000 Hz, recording_rate = 2000" in refused
    told = output_of(*found, "--out", "found")
    metrics = json.loads((here / "metrics.json").read_text())
    mass = TABLE_I["m_h"] * (1 if "[g]" in header else force / acceleration)
    assert metrics["parameters"]["m_h"]["value"] == pytest.approx(mass, rel=0.1)
    for each in words:
        assert each in told
        assert any(each in doubt for doubt in metrics["doubts"])
    assert words or not any("in another unit" in doubt for doubt in metrics["doubts"])


def test_a_recording_that_hit_the_stops_is_refused_by_its_estimated_travel(here: Path) -> None:
    recording(here / "hard.csv", start_amplitude=1.2)
    words = ("--recording-rate", "1000", "--duration", "1", "--start-amplitude", "1.2")
    words += WITHOUT_FRICTION
    told = refusal("identify", "--from", "hard.csv", *words, "--out", "found", status=1)
    assert "travel = " in told
    again = advised(told)
    assert (again.start_amplitude, again.end_amplitude, again.duration) == (0.6, 0.84, 1.0)
    assert not (here / "found" / "handle.yaml").exists()


def advised(text: str) -> IdentifyArguments:
    """Return the arguments of the command that a text advises at its end."""
    verb, *words = next_command("next: " + text.splitlines()[-1].partition("; next: ")[2])
    assert verb == "identify"
    return parse_assignments([word for word in words if ":=" in word], IdentifyArguments)


@pytest.mark.parametrize("kept", [0, 1])
@pytest.mark.parametrize("lack", ["", "interruptions", "actuator force deadlines missed"])
def test_trials_that_lack_samples_are_left_out_with_the_command_for_others(
    here: Path, capsys: pytest.CaptureFixture[str], kept: int, lack: str
) -> None:
    sweep = SweepParameters(duration=1.0)
    trials = run_identification(parameters=sweep, rate=1000.0, latency=0, trials=2)
    force = np.concatenate([trial.actuator_force for trial in trials])
    acceleration = np.concatenate([trial.handle_acceleration for trial in trials])
    signals = {ACTUATOR_FORCE.name: force, HANDLE_ACCELERATION.name: acceleration}
    end = len(force) - kept * len(trials[1].actuator_force)
    lost = {} if lack else {HANDLE_ACCELERATION.name: range(500, end, 10)}
    # One interruption is enough; a late force spoils a single sample.
    grown = 1 if lack == "interruptions" else 50
    counts = [(t, {lack: str(grown * min(t, end // 1000 - 1))}) for t in range(7) if lack]
    reports = [(float(t), "master_device", "OK", values) for t, values in counts]
    content = BagContent(signals, arms=False, dropped=lost, diagnostics=reports)
    write_bag(here / "my bag", content)
    words = ("--duration", "1", "grip:=pinch", "--free", "m_h,k_u,b_u,delay", "--out", "found")
    assert status_of("identify", "--from", "my bag", *words) == (0 if kept else 1)
    told = next(line for line in capsys.readouterr().err.splitlines() if "left out" in line)
    again = advised(told)
    assert (again.rate, again.grip, again.duration) == (500.0, "pinch", 1.0)
    assert told.endswith(" --free m_h,k_u,b_u,delay")


@pytest.mark.slow
def test_a_doubtful_handle_is_marked_and_the_graph_warns_of_it(
    haptic_accel: Start, ask: Callable[..., tuple[int, str]], here: Path
) -> None:
    recording(here / "near.csv", start_amplitude=0.75)
    words = ("--recording-rate", "1000", "--duration", "1", "--start-amplitude", "0.75")
    status, said = ask("identify", "--from", "near.csv", *words, "--out", "found")
    assert status == 0, said
    assert "travel = 3.7" in said
    graph = haptic_accel("teleop", "rig:=ideal", "params_file:=found/handle.yaml", "duration:=1")
    assert graph.end() == 0, graph.text
    assert "plant: travel = 3.7" in graph.text


def test_a_recording_in_three_axes_gives_one_file_for_the_compensator(here: Path) -> None:
    (trial,) = three_coils.trials(three_coils.plant(), 1)
    rest = np.zeros((300, 3))
    signals = {
        ACTUATOR_FORCE.name: np.concatenate([rest, trial.actuator_force, rest]),
        HANDLE_ACCELERATION.name: np.concatenate([rest, trial.handle_acceleration, rest]),
    }
    write_bag(here / "bag", BagContent(signals, arms=False))
    words = ("--start-frequency", "8", "--end-frequency", "450", "--duration", "1")
    words += WITHOUT_FRICTION
    shown = output_of("identify", "--from", "bag", *words, "--out", "found")
    assert "cross-coupling: -1" in shown
    model = here / "found" / "identification.json"
    held = Setup.of(GraphArguments(params_file=str(here / "found" / "handle.yaml"))).values
    assert held["compensator"]["axes"] == "x, y, z"
    assert held["compensator"]["plant.model"] == str(model)
    frequency = np.arange(20.0, 401.0)
    ratio = read_matrix_plant(model).response(frequency, 1000.0)
    ratio /= three_coils.plant().response(frequency, 1000.0)
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 1.0
    assert np.abs(np.angle(ratio, deg=True)).max() < 5.0
    # Several grips are not pooled.
    grips = ("--from", "pinch=bag", "--from", "hook=bag")
    refused = refusal("identify", *grips, *words, "--out", "again")
    assert "grips = pinch, hook: must be one for three axes" in refused


@pytest.mark.slow
def test_three_axes_are_identified_in_lockstep(here: Path) -> None:
    words = ("rig:=three_axis_ideal", "--trials", "1", "--json", "metrics.json", "--out", "found")
    assert status_of("identify", "--lockstep", *words, *WITHOUT_FRICTION) == 0
    metrics = json.loads((here / "metrics.json").read_text())
    assert metrics["max_magnitude_error_db"] < 1.0
    assert metrics["max_phase_error_deg"] < 5.0
    assert min(metrics["mean_coherence"]) > 0.99
    assert read_matrix_plant(here / "metrics.json").rate == 1000.0
    assert (here / "found" / "index.html").is_file()


def test_three_axes_have_a_band_of_their_own() -> None:
    arguments = IdentifyArguments.from_specified(rig="three_axis", duration=2.0)
    assert arguments.band == (8.0, 450.0)
    assert (arguments.duration, arguments.trials) == (2.0, 2)
    assert IdentifyArguments.from_specified().band == (10.0, 200.0)


@pytest.mark.slow
def test_the_live_graph_finds_three_axes(haptic_accel: Start, tmp_path: Path) -> None:
    words = ("--trials", "1", "--json", "metrics.json", *WITHOUT_FRICTION, "--out", "found")
    command = haptic_accel("identify", "rig:=three_axis", *words)
    assert command.end() == 0, command.text
    assert any("repeat 12 of 12" in line for line in command.lines)
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["max_magnitude_error_db"] < 1.5
    assert metrics["max_phase_error_deg"] < 8.0
    sent = read_bag(tmp_path / "found" / "bags" / "average").signals[ACTUATOR_FORCE.name].values
    assert np.abs(sent).max(axis=0) == pytest.approx(2.0, abs=0.1)
    assert not sent[-1].any()
