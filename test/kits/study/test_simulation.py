# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated observers against the theory of each task, their rig, and simulated studies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from kits.study.protocol_maker import make_levels, make_protocol
from kits.study.studies import write_study
from kits.study.study_runs import asking, run
from scipy.integrate import trapezoid
from scipy.stats import norm

from haptic_accel.kits.study.procedures import Plan
from haptic_accel.kits.study.protocol import Bounds, Extras, Observer, Procedure, Protocol
from haptic_accel.kits.study.session import (
    SAME_WITHIN,
    SimulatedParticipant,
    SimulatedRig,
    power,
    simulate_study,
    write_simulated,
)
from haptic_accel.kits.study.trials import COMPLETE, Screen, TrialRecord

EXTRAS = Extras(practice=0)
SURE = Observer(lapse=0.0)
REPEATS = 1000


def _records(protocol: Protocol, seed: int = 3) -> list[TrialRecord]:
    return list(run(Plan(protocol, seed, 0), asking(SimulatedParticipant(protocol, seed))))


def _study(task: str, *strengths: float, observer: Observer = SURE) -> Protocol:
    return make_protocol(
        task,
        len(strengths),
        procedure=Procedure(repeats=REPEATS),
        extras=EXTRAS,
        observer=observer,
        strengths={f"surface=s{number}": value for number, value in enumerate(strengths)},
    )


def _correct(protocol: Protocol) -> float:
    return float(np.mean([each.correct for each in _records(protocol)]))


def _two_intervals(d: float) -> float:
    return float(norm.cdf(d / 2**0.5))


def _abx(d: float) -> float:
    # Macmillan, Creelman 2005, equation 9.10 (differencing).
    halves = norm.cdf(d / 2**0.5) * norm.cdf(d / 6**0.5)
    return float(halves + norm.cdf(-d / 2**0.5) * norm.cdf(-d / 6**0.5))


def _same_different(d: float) -> float:
    within = SAME_WITHIN / 2**0.5
    same = 2 * norm.cdf(within) - 1
    different = norm.cdf(d / 2**0.5 - within) + norm.cdf(-d / 2**0.5 - within)
    return float((same + different) / 2)


def _triangle(d: float) -> float:
    # Ennis, Journal of Sensory Studies 8(4), 1993: the integral over the difference of the equal
    # two.
    x = np.linspace(0, 12, 4001)
    root = d * (2 / 3) ** 0.5
    beyond = norm.cdf(-x * 3**0.5 + root) + norm.cdf(-x * 3**0.5 - root)
    return float(2 * trapezoid(beyond * norm.pdf(x), x))


THEORIES: list[tuple[str, Callable[[float], float]]] = [("2ifc", _two_intervals), ("abx", _abx)]
THEORIES += [("same_different", _same_different), ("odd_one_out", _triangle)]


@pytest.mark.parametrize("d", [0.0, 1.0, 2.5])
@pytest.mark.parametrize(("task", "theory"), THEORIES)
def test_the_proportion_correct_follows_the_theory(
    task: str, theory: Callable[[float], float], d: float
) -> None:
    expected = theory(d)
    error = (expected * (1 - expected) / REPEATS) ** 0.5
    assert _correct(_study(task, 0.5, 0.5 + d)) == pytest.approx(expected, abs=3.5 * error)


def test_a_comparison_that_is_weaker_is_found_as_often() -> None:
    assert _correct(_study("2ifc", 2.0, 0.0)) > 0.88


def test_the_preference_follows_thurstone() -> None:
    records = _records(_study("preference", 0.0, 1.0))
    answered = [(each.trial.stimuli, each.answer.value) for each in records if each.answer]
    preferred = [str(stimuli[int(value) - 1]) for stimuli, value in answered]
    share = preferred.count("surface=s1") / len(preferred)
    assert share == pytest.approx(_two_intervals(1.0), abs=0.05)


@pytest.mark.parametrize(("apart", "correct"), [(3.0, 0.9), (0.0, 1 / 3)])
def test_conditions_far_apart_are_identified_and_equal_ones_by_chance(
    apart: float, correct: float
) -> None:
    found = _correct(_study("identification", 0.0, apart, 2 * apart))
    assert found == pytest.approx(correct, abs=0.05)


def test_ratings_have_the_mean_of_their_strength() -> None:
    means = _mean_ratings(_study("rating", 40.0, 70.0))
    expected = {"surface=s0": pytest.approx(40, abs=2), "surface=s1": pytest.approx(70, abs=2)}
    assert means == expected


def test_conditions_far_apart_are_rated_less_similar() -> None:
    means = _mean_ratings(_study("similarity", 0.0, 0.5, 4.0))
    assert means["surface=s0 / surface=s1"] > means["surface=s1 / surface=s2"] + 20


def _mean_ratings(protocol: Protocol) -> dict[str, float]:
    ratings: dict[str, list[float]] = {}
    for each in _records(protocol):
        assert each.answer is not None
        ratings.setdefault(each.trial.track, []).append(float(each.answer.value))
    return {track: float(np.mean(values)) for track, values in ratings.items()}


@pytest.mark.parametrize("task", ["2ifc", "identification", "rating", "same_different"])
def test_lapses_are_random_but_admitted_answers(task: str) -> None:
    records = _records(_study(task, 0.0, 9.0, observer=Observer(lapse=1.0)))
    answers = Counter(each.answer.value for each in records if each.answer)
    assert set(answers) == set(records[0].trial.answers)


def test_at_the_threshold_d_prime_is_1() -> None:
    given = {"procedure": Procedure(repeats=REPEATS), "extras": EXTRAS}
    observer = Observer(threshold=0.25, slope=2.0, lapse=0.0)
    records = _records(make_levels(values=(1.25, 1.5), observer=observer, **given))
    for level, d, tolerance in ((1.25, 1.0, 0.05), (1.5, 4.0, 0.02)):
        correct = np.mean([each.correct for each in records if each.trial.level == level])
        assert correct == pytest.approx(_two_intervals(d), abs=tolerance)


def test_observers_differ_by_the_spread() -> None:
    protocol = make_levels(observer=Observer(threshold=0.25, spread=0.5))
    condition = protocol.pairs[0].comparison
    # With a slope of 1, the strength is the distance over the threshold.
    strengths = [SimulatedParticipant(protocol, seed).strength(condition) for seed in range(500)]
    assert np.std(np.log(strengths)) == pytest.approx(0.5, rel=0.15)
    assert np.median(strengths) == pytest.approx(0.1 / 0.25, rel=0.15)


def test_an_answer_depends_on_seed_and_trial_alone() -> None:
    protocol = _study("2ifc", 0.0, 1.0)
    trials = [each.trial for each in _records(protocol)[:20]]
    participant = SimulatedParticipant(protocol, 5)
    forward = [asking(participant)(trial) for trial in trials]
    backward = [asking(SimulatedParticipant(protocol, 5))(trial) for trial in reversed(trials)]
    assert forward == backward[::-1]


def test_a_screen_without_a_trial_gets_its_first_answer() -> None:
    participant = SimulatedParticipant(make_protocol(), 1)
    assert participant.ask(Screen("1", "consent", answers=("agree", "no"))).value == "agree"
    assert participant.ask(Screen("2", "ready")).value == ""


def test_the_rig_delivers_what_is_asked_within_the_bounds_and_exposes() -> None:
    protocol = make_protocol(bounds=Bounds(least_rms=5.0))
    rig = SimulatedRig(protocol)
    presented = rig.present(protocol.conditions[0], 2.0)
    assert presented.end - presented.begin == 2_000_000_000
    assert presented.read_back == {"surface": "s0"}
    assert presented.desired_rms >= protocol.bounds.least_rms
    assert presented.late == presented.lost == presented.clipped == 0
    once = rig.exposure
    rig.present(protocol.conditions[0], 2.0)
    assert rig.exposure == pytest.approx(2 * once)
    assert once > 0


def test_a_simulated_study_is_complete_and_repeatable(tmp_path: Path) -> None:
    protocol = write_study(tmp_path).protocol
    first, again, other = (simulate_study(protocol, 4, seed) for seed in (1, 1, 2))
    assert [each.participant for each in first] == ["S01", "S02", "S03", "S04"]
    assert {(each.ended, each.digest) for each in first} == {(COMPLETE, protocol.digest)}
    assert [each.row for each in first] == [0, 1, 2, 3]
    answers = [[record.answer for record in each.records] for each in first]
    assert answers == [[record.answer for record in each.records] for each in again]
    assert answers != [[record.answer for record in each.records] for each in other]


def test_a_written_study_is_the_simulated_one(tmp_path: Path) -> None:
    study = write_study(tmp_path)
    assert len([*write_simulated(study, 3, 5)]) == 3
    for written, each in zip(study.sessions, simulate_study(study.protocol, 3, 5), strict=True):
        assert written.participant == each.participant
        answers = [record.answer for record in each.records]
        assert [record.answer for record in written.records] == answers


def test_power_has_an_interval() -> None:
    found = power("told apart", [True] * 80 + [False] * 20)
    assert (found.name, found.share) == ("told apart", 0.8)
    # Wilson's interval: Brown, Cai, DasGupta, Statistical Science 16(2), 2001.
    assert (found.low, found.high) == pytest.approx((0.7112, 0.8666), abs=1e-4)
