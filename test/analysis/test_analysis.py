# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""From bags to metrics: known answers, groups, pairs, and what bags lack."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag_maker import BagContent, of_trial, write_bag
from haptic_accel.analysis import bands, compare, groups, load, signals, spectra, trials
from haptic_accel.analysis.experiment import experiment_warnings
from haptic_accel.analysis.frames import RUNS, table_two
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.summary import UNFOLLOWED, summary
from haptic_accel.analysis.writing import as_json, write_analysis
from haptic_accel.core import topics
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray, MountParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.tick.device_side import LATE_TIME, LONGEST, PAST_TICK
from haptic_accel.core.trial import Trial
from nightly import rest_slow

RATE = 1000.0


def texture(seed: int, seconds: float) -> FloatArray:
    """Return noise far above the hand's own motion, and below half the rate."""
    from scipy import signal

    sections = signal.butter(4, (40.0, 300.0), "bandpass", fs=RATE, output="sos")
    noise = np.random.default_rng(seed).normal(0.0, 4.0, round(seconds * RATE))
    return np.asarray(signal.sosfilt(sections, noise))


def copy(
    controller: str = "dynamic",
    surface: str = "plywood",
    *,
    gain: float = 0.8,
    delay: int = 1,
    noise: float = 0.0,
    seed: int = 0,
    seconds: float = 3.0,
    blind: bool = False,
) -> BagContent:
    """Return a bag in which the handle copies what is desired, scaled and some samples later.

    Of a blind trial the handle's acceleration was not recorded.
    """
    desired = texture(seed, seconds)
    disturbed = desired + noise * texture(seed + 1000, seconds)
    handle = gain * np.concatenate([np.zeros(delay), disturbed[: len(desired) - delay]])
    force = 0.128 * desired
    time = np.arange(len(desired)) / RATE
    trial = Trial(surface, controller, RATE, time, desired, desired, handle, force)
    content = of_trial(trial, seed=seed)
    if blind:
        del content.signals[topics.HANDLE_ACCELERATION.name]  # type: ignore[attr-defined]
    return content


def analysed(folder: Path, content: BagContent, **options: Any) -> tuple[Analysis, Any]:
    """Return the analysis of a bag with one trial, and the trial's row."""
    analysis = load(write_bag(folder / "bag", content), **options)
    return analysis, trials(analysis).iloc[0]


def line_with(words: str, analysis: Analysis) -> str:
    (found,) = [line for line in summary(analysis) if words in line]
    return found


def test_a_scaled_and_delayed_copy_has_exact_figures(tmp_path: Path) -> None:
    _, found = analysed(tmp_path, copy(gain=0.75, delay=3, seconds=6.0), shift="3")
    assert found["nrmse_percent"] == pytest.approx(25.0, abs=0.1)
    assert found["slope_actual_on_desired"] == pytest.approx(0.75, abs=1e-3)
    assert found["slope_desired_on_actual"] == pytest.approx(1 / 0.75, abs=2e-3)
    assert found["r2"] == pytest.approx(1.0, abs=1e-4)
    assert found["delay_ms"] == pytest.approx(3.0, abs=0.01)
    assert found["nrmse_60_125_Hz_percent"] == pytest.approx(25.0, abs=0.2)
    assert found["nrmse_low_percent"] <= found["nrmse_percent"] <= found["nrmse_high_percent"]
    assert found["force_rms_N"] == pytest.approx(0.128 * np.sqrt(np.mean(texture(0, 6.0) ** 2)))


def test_the_share_that_a_hand_could_not_tell_is_reported_beside_the_error(tmp_path: Path) -> None:
    # A hand notices 3 dB, a gain of 0.71, but not 2 dB, a gain of 0.79.
    for controller, gain in (("constant", 0.68), ("dynamic", 0.81)):
        write_bag(tmp_path / controller, copy(controller, gain=gain))
    analysis = load(tmp_path)
    found = trials(analysis).set_index("controller").indistinguishable_percent
    assert found["constant"] == pytest.approx(0.0, abs=1.0)
    assert found["dynamic"] == pytest.approx(100.0, abs=1.0)
    told = line_with("a hand could not tell", analysis)
    assert re.search(r": constant \d\.\d %, dynamic (99|100)\.\d %\.$", told)


def test_the_shift_is_what_was_asked_for(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", copy(gain=1.0, delay=3))
    paper, measured, fixed = (
        trials(load(tmp_path, shift=shift)).iloc[0] for shift in ("paper", "measured", "3")
    )
    assert (paper["shift_ms"], fixed["shift_ms"]) == (1.0, 3.0)
    assert measured["shift_ms"] == pytest.approx(3.0, abs=0.01)
    assert fixed["nrmse_percent"] < 0.5
    assert measured["nrmse_percent"] < 1.0
    assert paper["nrmse_percent"] > 50.0


@pytest.mark.parametrize(
    ("stated", "samples"), [(None, 1), (0, 1), (1, 2), (3, 4), (-5, 1), ("much", 1), (10**9, 1)]
)
def test_a_bag_is_shifted_by_its_latency_and_one_sample(
    tmp_path: Path, stated: object, samples: int
) -> None:
    content = copy(gain=1.0, delay=samples, seconds=2.0)
    if stated is not None:
        content.metadata["arguments"]["latency"] = stated
    analysis, found = analysed(tmp_path, content)
    assert found["shift_ms"] == samples
    assert found["latency_samples"] == samples - 1
    assert found["nrmse_percent"] < 3.0
    words = f"{samples} ms ({samples} sample{'s' * (samples > 1)})"
    assert any(f"shifted back by {words}: dynamic" in line for line in summary(analysis))


def test_a_bag_is_shifted_by_the_delay_that_its_controller_is_granted(tmp_path: Path) -> None:
    for controller, samples in (("inverse", 4), ("dynamic", 2)):
        content = copy(controller, gain=1.0, delay=samples, seconds=2.0)
        content.metadata["arguments"]["latency"] = 1
        content.metadata["parameters"]["compensator"]["inverse.granted_delay"] = 3
        write_bag(tmp_path / controller, content)
    found = trials(load(tmp_path)).set_index("controller")
    assert found.shift_ms.to_dict() == {"inverse": 4.0, "dynamic": 2.0}
    assert found.granted_samples.to_dict() == {"inverse": 3, "dynamic": 1}
    assert (found.nrmse_percent < 3.0).all()


@pytest.mark.parametrize(
    ("delay", "least", "most"),
    [(0.0, 0.0, 5.0), (1.5e-3, 20.0, 100.0), (4e-3, 25.0, 200.0)],  # a part has to be foreseen
)
def test_the_bounds_are_those_of_the_simulated_handle_and_tell_what_cannot_be_followed(
    tmp_path: Path, delay: float, least: float, most: float
) -> None:
    content = copy(seconds=4.0)
    content.metadata["arguments"]["master"] = "simulated"
    content.metadata["parameters"]["master_device"] = {"simulated.drive.delay": delay}
    analysis, found = analysed(tmp_path, content)
    assert least <= found.bound_percent <= found.limited_bound_percent
    assert found.bound_percent < most
    lowest = found.limited_bound_percent
    told = f"within the actuator's limits: plywood {lowest:.1f} %."
    assert line_with("error possible", analysis).endswith(told)
    alone = "The input itself cannot be followed on plywood"
    assert any(line.startswith(alone) for line in summary(analysis)) == (lowest >= UNFOLLOWED)


@pytest.mark.parametrize(
    ("rounding", "counted"),
    [(0.0, 1), (1e-12, 1), (1e-3, 3)],  # the same, another processor's last digits, other samples
)
def test_copies_in_several_folders_are_one_trial(
    tmp_path: Path, rounding: float, counted: int
) -> None:
    content = copy(seconds=2.0)
    noise = np.random.default_rng(0)
    folders = [tmp_path / name for name in ("one", "two", "three")]
    for folder in folders:
        signals = {
            name: values * (1.0 + rounding * noise.normal(size=values.shape))
            for name, values in content.signals.items()
        }
        write_bag(folder / "bag", replace(content, signals=signals))
    analysis = load(*folders)
    assert len(analysis.trials) == counted
    said = [line for lines in analysis.problems.values() for line in lines]
    assert [line.startswith("counts once: it has the same") for line in said] == [True] * (
        3 - counted
    )
    assert len(load(*folders, apart=True).trials) == 3  # of runs to be compared


def test_bags_of_several_latencies_are_named_together(tmp_path: Path) -> None:
    for latency in (0, 1):
        content = copy(delay=latency + 1, seed=latency, seconds=2.0)
        content.metadata["arguments"]["latency"] = latency
        write_bag(tmp_path / f"bag{latency}", content)
    assert load(tmp_path).shifted_by == "1 ms (1 sample) or 2 ms (2 samples)"


def test_controllers_without_a_surface_in_common_have_their_errors_told(tmp_path: Path) -> None:
    write_bag(tmp_path / "a", copy("constant", "plywood", gain=0.75))
    write_bag(tmp_path / "b", copy("dynamic", "vinyl", gain=0.9))
    told = line_with("Error (NRMSE)", load(tmp_path))
    for words in ("constant on plywood 25.0 %", "dynamic on vinyl 10.0 %", "no average"):
        assert words in told
    assert "missing" not in told


def test_an_average_is_over_the_surfaces_that_have_all_errors(tmp_path: Path) -> None:
    for controller, gain in (("constant", 0.75), ("dynamic", 0.9)):
        write_bag(tmp_path / f"{controller}_text", copy(controller, "text", gain=gain))
    write_bag(tmp_path / "vinyl", copy("dynamic", "vinyl", gain=0.5))
    write_bag(tmp_path / "blind", copy("constant", "vinyl", seed=1, blind=True))
    told = line_with("Error (NRMSE, averaged over text), ", load(tmp_path))
    assert "shifted back by 1 ms (1 sample): dynamic 10.0 %" in told


def test_without_a_handle_the_force_is_told_and_no_error(tmp_path: Path) -> None:
    analysis, found = analysed(tmp_path, copy(blind=True))
    assert "No error could be determined." in summary(analysis)
    # None was due.
    for name in ("nrmse_percent", "travel_mm", "deadlines_missed_percent"):
        assert math.isnan(found[name])
    assert found["force_peak_N"] > 0


def test_coherence_is_that_of_signal_in_noise(tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", copy(noise=0.5, seconds=30.0))
    found = spectra(load(tmp_path))
    inside = found[(found.frequency_Hz > 60) & (found.frequency_Hz < 250)]
    assert inside.coherence.mean() == pytest.approx(1 / (1 + 0.5**2), abs=0.03)


def test_signals_with_next_to_nothing_in_common_have_no_slope(tmp_path: Path) -> None:
    _, found = analysed(tmp_path, copy(noise=4.0), shift="1")
    assert 0.0 < found["r2"] < 0.09
    assert math.isnan(found["slope_desired_on_actual"])
    assert math.isnan(found["slope_actual_on_desired"])


def test_trials_are_grouped_and_their_scatter_is_told(tmp_path: Path) -> None:
    for seed, gain in enumerate((0.7, 0.8, 0.9)):
        write_bag(tmp_path / f"run{seed}" / "bag", copy(gain=gain, seed=seed))
    write_bag(tmp_path / "other", copy("none", "vinyl", gain=0.0))
    analysis = load(tmp_path)
    table = groups(analysis).set_index(["controller", "surface"])
    group = table.loc[("dynamic", "plywood")]
    assert group["trials"] == 3
    assert group["nrmse_percent"] == pytest.approx(20.0, abs=0.1)
    # Student: 4.303 * 10 / sqrt(3) = 24.84; on a logarithmic scale, relative to the mean of 20.
    factor = group["nrmse_percent_high"] / group["nrmse_percent"]
    assert factor == pytest.approx(math.exp(24.84 / 20), rel=0.01)
    assert "3 trials" in group["interval"]
    alone = table.loc[("none", "vinyl")]
    assert "1 trial: too few" in alone["interval"]
    assert math.isnan(alone["nrmse_percent_low"])
    assert table_two(table.reset_index()).counts == {"none": "1", "dynamic": "3"}
    assert len(set(trials(analysis)["trial"])) == 4
    assert set(bands(analysis)["band"]) >= {"30-60 Hz", "250-500 Hz"}


def test_controllers_are_compared_pair_by_pair(tmp_path: Path) -> None:
    expected = []
    for seed, (one, other) in enumerate([(0.6, 0.75), (0.5, 0.7), (0.7, 0.8), (0.65, 0.85)]):
        write_bag(tmp_path / f"a{seed}", copy("constant", gain=one, seed=seed))
        write_bag(tmp_path / f"b{seed}", copy("inverse", gain=other, seed=seed))
        expected.append(100 * ((1 - other) - (1 - one)))
    write_bag(tmp_path / "alone", copy("inverse", gain=0.5, seed=77))
    found = compare(load(tmp_path), "controller:constant,inverse").iloc[0]
    assert found["pairs"] == 4
    assert found["difference_percent"] == pytest.approx(np.mean(expected), abs=0.1)
    assert found["p_t"] < 0.05
    assert math.isnan(found["p_wilcoxon"])


def test_two_single_runs_are_a_pair_and_not_tested(tmp_path: Path) -> None:
    places = [tmp_path / "a", tmp_path / "b"]
    for place, gain in zip(places, (0.5, 0.9), strict=True):
        write_bag(place, replace(copy(gain=gain), metadata={}))
    found = compare(load(*places, apart=True), RUNS, places).iloc[0]
    assert found["pairs"] == 1
    assert found["difference_percent"] == pytest.approx(-40.0, abs=0.1)
    assert math.isnan(found["p_t"])
    assert "too few" in found["verdict"]


def test_a_comparison_that_cannot_be_is_refused(tmp_path: Path) -> None:
    analysis, _ = analysed(tmp_path, copy(seconds=2.0))
    for wanted in ("", "surface:a,b", "controller:a", "controller:a,a", RUNS):
        with pytest.raises(ParameterError, match="compare"):
            compare(analysis, wanted)


def test_what_is_no_bag_harms_no_other(tmp_path: Path) -> None:
    write_bag(tmp_path / "good", copy())
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "bad_0.mcap").write_bytes(b"nonsense")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "metadata.yaml").write_text("")
    analysis = load(tmp_path)
    assert [trial.name for trial in analysis.trials] == ["good"]
    assert set(analysis.problems) == {"bad", "empty"}


def test_travel_is_that_of_the_suspension(tmp_path: Path) -> None:
    # A force held for long moves the actuator by force over stiffness: Table I's 266 N/m.
    samples = 3000
    zero = np.zeros(samples)
    trial = Trial("plywood", "none", RATE, zero, zero, zero, zero, np.full(samples, 0.5))
    _, found = analysed(tmp_path, of_trial(trial))
    assert found["travel_mm"] == pytest.approx(1e3 * 0.5 / 266.0, rel=5e-3)
    assert math.isnan(found["nrmse_percent"])  # nothing was desired


def test_a_travel_beyond_the_stops_is_left_out_and_said(tmp_path: Path) -> None:
    # Table I: 266 N/m and 3.8 mm either way, so that 1.5 N would need 5.6 mm.
    desired = texture(0, 2.0)
    zero = np.zeros(len(desired))
    for name, force in (("hard", 1.5), ("soft", 0.5)):
        trial = Trial("text", name, RATE, zero, desired, desired, zero, np.full(zero.size, force))
        write_bag(tmp_path / name, of_trial(trial))
    analysis = load(tmp_path)
    found = trials(analysis).set_index("trial")
    assert math.isnan(found.travel_mm["hard"])
    assert "stops" in found.notes["hard"]
    assert found.travel_mm["soft"] == pytest.approx(1.88, abs=0.05)
    told = line_with("actuator gave", analysis)
    assert "reached its stops, 3.8 mm either way, in 1 of 2 trials" in told
    assert "5.6" not in told


def test_a_handle_that_is_not_as_the_compensator_was_told_is_named(tmp_path: Path) -> None:
    desired = texture(0, 3.0)
    time = np.arange(len(desired)) / RATE
    lines = np.fft.rfftfreq(len(desired), 1.0 / RATE)

    def trial(frequency: float) -> Trial:
        plant = Plant(mount=MountParameters(frequency, 0.05)).coupled()
        response = np.append(0.0, plant.delayed(0).response(lines[1:], RATE))
        handle = np.fft.irfft(response * np.fft.rfft(0.128 * desired), len(desired))
        signals = desired, desired, handle, 0.128 * desired
        return Trial("plywood", "constant", RATE, time, *signals, latency=0)

    for name, frequency in (("known", 290.0), ("unknown", 180.0)):
        content = of_trial(trial(frequency), seed=0)
        mount = {"plant.mount.frequency": 290.0, "plant.mount.damping": 0.05}
        content.metadata["parameters"]["compensator"] |= mount
        write_bag(tmp_path / name, content)
    analysis = load(tmp_path)
    told = {t.name: [n for n in t.notes if "not as described" in n] for t in analysis.trials}
    assert told["known"] == []
    assert len(told["unknown"]) == 1
    assert "run identify, a mode near 184 Hz is not described (from 0." in told["unknown"][0]
    assert any(
        "In 1 of 2 trials the handle is not as described " in line for line in summary(analysis)
    )
    for name, message in (("silent", "OK"), ("loud", "the handle is not as described above 1 Hz")):
        # The live compensator knew which samples were missing or out of order.
        said = [(seconds, "compensator", message, {}) for seconds in (1.0, 2.0)]
        write_bag(tmp_path / name / "bag", replace(content, diagnostics=said))
        analysis = load(tmp_path / name)
        assert [n for t in analysis.trials for n in t.notes if "not as described" in n] == []
        assert any("above 1 Hz" in line for line in summary(analysis)) == (name == "loud")


def test_trials_without_contact_are_in_no_mean(tmp_path: Path) -> None:
    air = copy(gain=40.0, seed=7, seconds=2.0)
    for values in air.signals.values():
        values *= 0.02
    alone = load(write_bag(tmp_path / "air", air))
    assert groups(alone).empty
    told = line_with("1 of 1 trial had no contact", alone)
    assert "Check that the tool touched the surface" in told
    for seed in range(3):
        write_bag(tmp_path / f"touch{seed}", copy(gain=0.75, seed=seed, seconds=2.0))
    analysis = load(tmp_path)
    (group,) = groups(analysis).to_dict("records")
    assert group["trials"] == 3
    assert group["nrmse_percent"] == pytest.approx(25.0, abs=0.2)
    found = trials(analysis).set_index("trial")
    assert not found.contact["air"]
    assert math.isnan(found.nrmse_percent["air"])
    assert any("1 of 4 trials had no contact" in line for line in summary(analysis))


def test_trials_of_one_seed_show_the_same_excerpt(tmp_path: Path) -> None:
    for seed in range(2):
        for controller in ("constant", "dynamic", "inverse"):
            # Live runs of a seed are not the same sample by sample.
            written = copy(controller, seed=seed, seconds=2.0)
            desired = written.signals[topics.DESIRED_ACCELERATION.name]
            desired[:] += 0.3 * texture(len(controller), 2.0)
            write_bag(tmp_path / f"{controller}{seed}", written)
    found: dict[str, set[float]] = {}
    for trial in load(tmp_path).trials:
        assert trial.portrait is not None
        assert trial.portrait.begin == trial.traces.excerpt
        found.setdefault(trial.segment.pair[0], set()).add(trial.portrait.begin)
    assert {len(begins) for begins in found.values()} == {1}


def test_lost_samples_are_counted_by_topic(tmp_path: Path) -> None:
    force, tool = topics.ACTUATOR_FORCE.name, topics.TOOL_ACCELERATION.name
    dropped = {force: [500, 501, 900], tool: [700]}
    bag = write_bag(tmp_path / "bag", replace(copy(seconds=2.0), dropped=dropped))
    found = load(bag).trials[0].segment.delivery
    assert (found.lost[force], found.lost[tool]) == (3, 1)
    assert sum(found.lost.values()) == 4
    assert found.missed["slave"] == 0


def late_forces(tmp_path: Path, **counts: str) -> tuple[list[str], dict[str, Any]]:
    """Return summary and row of a bag whose master has reported counts of both its forces."""
    reported = {"tick lateness max (us)": "86000.0"}
    for force, missed in (("actuator force", "7"), ("arm force", "0")):
        reported |= {f"{force} due": "1000", f"{force} deadlines missed": missed}
        reported |= {f"{force} {name}": value for name, value in counts.items()}
    content = replace(copy(), diagnostics=[(3.0, "master_device", "", reported)])
    content.metadata["arguments"]["master"] = "simulated"
    analysis, _ = analysed(tmp_path, content)
    (row,) = as_json(analysis)["trials"]
    return summary(analysis), row


def test_forces_that_were_late_by_the_clock_are_told_as_a_hand_would_have_felt_them(
    tmp_path: Path,
) -> None:
    told, row = late_forces(tmp_path, **{PAST_TICK: "2", LONGEST: "5250", LATE_TIME: "0.02"})
    # 0.02 s of the 1000 forces' 1 s.
    assert (
        "7 of 2000 forces took effect more than 0.25 periods after their due time, the latest by"
        " 5.2 ms; the actuator's up to 2.00 % of a trial's time." in told
    )
    assert any(line.startswith("For 3 of them the simulated world waited") for line in told)
    assert row["late_time_percent"] == pytest.approx(2.0)
    assert row["late_longest_ms"] == pytest.approx(5.25)
    more = {"past_tick": 2, "longest_us": 5250.0, "late_s": 0.02}
    assert row["deadlines"]["actuator force"] == {"due": 1000, "missed": 7, **more}


def test_forces_that_were_late_as_the_arms_let_go_are_counted(tmp_path: Path) -> None:
    def report(moment: float, missed: int) -> tuple[float, str, str, dict[str, str]]:
        counts = {"due": "1000", "deadlines missed": str(missed), LONGEST: f"{missed}000"}
        counts |= {PAST_TICK: "0", LATE_TIME: f"0.{missed:03}"}
        values = {f"actuator force {name}": value for name, value in counts.items()}
        return moment, "master_device", "", values

    reports = [report(5.5, 1), report(6.5, 90), report(7.5, 95)]
    write_bag(tmp_path / "bag", replace(copy(seconds=6.0), diagnostics=reports))
    analysis = load(tmp_path)
    (trial,) = analysis.trials
    counts = trial.segment.delivery.deadlines["actuator force"]
    assert (counts["missed"], counts["longest_us"], counts["late_s"]) == (90, 90e3, 0.09)
    # However many trials had such forces, one line says so.
    told, advice = experiment_warnings(replace(analysis, trials=[trial] * 12), composed=True)
    assert told == (
        f"In 12 of 12 trials, up to 9.0 % ({trial.surface} / {trial.controller}) of the"
        " actuator forces took effect late, the latest by 90.0 ms, which a hand on a real"
        " handle would feel."
    )
    assert advice.startswith("haptic-accel doctor")


def test_an_older_bag_keeps_its_counts_and_says_what_they_leave_out(tmp_path: Path) -> None:
    told, row = late_forces(tmp_path)
    assert (
        "7 of 2000 forces came after the tick at which they were due, as older bags count them:"
        " where a device stood still itself, no force was counted; ticks began up to 86.0 ms late."
        in told
    )
    counts = {"actuator force": 7, "master arm force": 0}
    assert row["deadlines"] == {name: {"due": 1000, "missed": n} for name, n in counts.items()}
    assert row["deadlines_missed_percent"] == pytest.approx(0.7)  # of the actuator's alone
    assert row["late_time_percent"] is None


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        (None, ""),
        ({"run": "lockstep"}, "in lockstep, without ROS"),
        ({}, "live on ROS 2, each node in a process of its own"),
        ({"composed": True}, "live on ROS 2, its nodes composed into one process"),
        (
            {"side": "master", "composed": True},
            "live on ROS 2, its nodes composed into one process, the other arm on another host",
        ),
    ],
)
def test_a_report_tells_how_its_trials_ran_and_does_not_guess(
    tmp_path: Path, metadata: dict[str, object] | None, words: str
) -> None:
    content = copy(seconds=2.0)
    if metadata and "run" in metadata:
        content.metadata["run"] = metadata["run"]  # type: ignore[index]
    elif metadata is not None:
        content.metadata["arguments"].update(metadata)
        content = replace(content, diagnostics=[(1.0, "master_device", "OK", {})])
    analysis, found = analysed(tmp_path, content)
    told = f"1 trial ran {words}." if words else "How 1 trial ran is not stated by the bags."
    assert told in summary(analysis)
    assert found.run == words


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    ("name", "value"),
    rest_slow(
        [
            (topics.DESIRED_ACCELERATION.name, 1e10),
            (topics.HANDLE_ACCELERATION.name, -1.7e308),
            (topics.HANDLE_ACCELERATION.name, 1e200),
            (topics.DESIRED_ACCELERATION.name, -1.7e308),
            (topics.ACTUATOR_FORCE.name, -1.7e308),
        ],
        now=2,
    ),
)
def test_a_damaged_value_counts_as_missing(tmp_path: Path, name: str, value: float) -> None:
    content = copy(seconds=2.0)
    content.signals[name][700] = value
    analysis, _ = analysed(tmp_path, content)
    write_analysis(analysis, tmp_path)
    told = f"{name}: 1 of 2000 samples count as missing: no numbers, or beyond 1e+09"
    assert told in analysis.problems["bag"]


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_trials_of_one_seed_may_differ_in_length(tmp_path: Path) -> None:
    for controller, seconds in (("constant", 6.0), ("dynamic", 1.5)):
        write_bag(tmp_path / controller, copy(controller, seconds=seconds, seed=4))
    analysis = load(tmp_path)
    write_analysis(analysis, tmp_path)
    assert all(trial.portrait for trial in analysis.trials)


def test_samples_of_a_trial_come_with_their_time(tmp_path: Path) -> None:
    written = copy(seconds=2.0)
    bag = write_bag(tmp_path / "bag", written)
    found = signals(bag)
    name = topics.ACTUATOR_FORCE.name
    np.testing.assert_array_equal(found[name], written.signals[name])
    assert found.index[-1] == pytest.approx(1.999)
    with pytest.raises(ParameterError, match="number = 2"):
        signals(bag, 2)


@pytest.mark.parametrize(
    ("place", "shift", "words"),
    [
        ("nothing", "granted", "no such"),
        ("", "granted", "with bags in it"),
        *(("", shift, "shift = ") for shift in ("", "later", "nan", "1e9")),
    ],
)
def test_what_cannot_be_loaded_is_refused(
    tmp_path: Path, place: str, shift: str, words: str
) -> None:
    with pytest.raises(ParameterError, match=words):
        load(tmp_path / place, shift=shift)


def test_a_single_file_is_a_bag_and_one_named_twice_counts_once(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", copy(seconds=2.0))
    assert len(load(bag, tmp_path).trials) == 1
    (file,) = bag.glob("*.mcap")
    shutil.copy(file, tmp_path / "alone.mcap")
    analysis = load(tmp_path / "alone.mcap")
    assert [trial.name for trial in analysis.trials] == ["alone.mcap"]
