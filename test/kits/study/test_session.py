# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sessions: what a participant sees, what stops them, and that nothing is lost or asked twice."""

from __future__ import annotations

import os
import random
import signal
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from kits.study.studies import TEXT, FaultyRig, Scripted, make_session, run_session, write_study

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.study import trials
from haptic_accel.kits.study.folder import Study
from haptic_accel.kits.study.log import LOG, read_session
from haptic_accel.kits.study.session import MOST_BROKEN_OFF, NO_CONSENT, SimulatedRig
from nightly import rest_slow

STOPPED = "stopped by the participant"


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return write_study(tmp_path / "study")


def stop_at(number: int) -> Callable[[trials.Screen], str | None]:
    """Return an act that presses stop the given time that it is called, from 1."""
    calls = iter(range(1, number + 1))

    def act(_: trials.Screen) -> None:
        if next(calls, number) == number:
            raise trials.StoppedError(STOPPED)

    return act


def noting_stops(study: Study) -> tuple[SimulatedRig, list[None]]:
    """Return a rig, and the list to which it adds each stop."""
    rig, stops = SimulatedRig(study.protocol), []
    rig.stop = lambda: stops.append(None)  # type: ignore[method-assign]
    return rig, stops


def timeless(session: trials.SessionRecord) -> trials.SessionRecord:
    """Return a session without its times."""
    records = tuple(
        replace(
            each,
            **dict.fromkeys(("asked", "answered", "asked_steady", "answered_steady"), 0),
            presented=tuple(replace(one, begin=0, end=0) for one in each.presented),
        )
        for each in session.records
    )
    return replace(session, begun=0, records=records, exposure=round(session.exposure, 9))


def test_a_session_goes_from_consent_to_its_end_with_the_texts_of_its_protocol(
    study: Study,
) -> None:
    participant = Scripted(study)
    session = run_session(study, study.begin("P01"), participant)
    assert session.ended == trials.COMPLETE
    assert session.consent == "2026-1"
    kinds = Counter(each.trial.kind for each in session.records)
    assert kinds == {trials.PRACTICE: 2, trials.MAIN: 12}
    assert len(session.counted) == 12
    trial = ["wait", "stimulus", "wait", "stimulus", "question"]
    practice, block = [*trial, "feedback"], trial * 5
    begin = ["consent", "instructions", "ready", *practice, *practice, "ready"]
    assert participant.kinds == [*begin, *block, "break", *block, "break", *trial * 2, "end"]
    (consent,), (instructions,) = participant.of("consent"), participant.of("instructions")
    assert (consent.text, consent.answers) == ("I agree to take part.", ("agree", "disagree"))
    assert instructions.text == "Stroke the surface."
    question = participant.of("question")[0]
    assert (question.text, question.answers) == ("Were they the same?", ("same", "different"))
    assert {screen.text for screen in participant.of("feedback")} <= {"right", "wrong"}
    assert [screen.interval for screen in participant.of("stimulus")[:2]] == [1, 2]
    assert [screen.text for screen in participant.of("ready")] == ["practice", "begin"]
    progress = [screen.progress for screen in participant.screens]
    assert progress == sorted(progress)
    assert len({screen.id for screen in participant.screens}) == len(progress)


def test_who_does_not_agree_feels_nothing(study: Study) -> None:
    participant = Scripted(study, {"consent": lambda _: "disagree"})
    session = run_session(study, study.begin("P01"), participant)
    assert (session.ended, session.consent, session.records) == (NO_CONSENT, "", ())
    assert participant.kinds == ["consent", "stopped"]


@pytest.mark.parametrize("kind", ["consent", "instructions", "wait", "stimulus", "question"])
def test_stop_stops_at_once_and_the_session_goes_on_later(study: Study, kind: str) -> None:
    rig, stops = noting_stops(study)
    participant = Scripted(study, {kind: stop_at(1)})
    session = run_session(study, study.begin("P01"), participant, rig)
    assert (session.ended, participant.kinds[-2:]) == (STOPPED, [kind, "stopped"])
    assert stops
    again = Scripted(study)
    session = run_session(study, study.resume("P01"), again)
    assert session.ended == trials.COMPLETE
    assert len(session.counted) == 12
    assert ("consent" in again.kinds) == (kind == "consent")


def test_a_break_is_not_repeated_at_the_begin_of_a_sitting(study: Study) -> None:
    run_session(study, study.begin("P01"), Scripted(study, {"break": stop_at(1)}))
    again = Scripted(study)
    run_session(study, study.resume("P01"), again)
    assert again.kinds.count("break") == 1


@pytest.mark.parametrize(
    ("fault", "flaw"),
    [
        ({"late": 50.0}, "late = 50: must be at most 2 %"),
        ({"lost": float("nan")}, "lost = nan: must be at most 1 %"),
        ({"clipped": 5.5}, "clipped = 5.5: must be at most 5 %"),
        ({"desired_rms": 0.1}, "desired RMS = 0.1: must be at least 0.3 m/s^2"),
        (trials.UndeliveredError("the graph has gone"), "the graph has gone"),
    ],
)
def test_a_trial_that_was_not_delivered_is_repeated(
    study: Study, fault: trials.UndeliveredError | dict[str, float], flaw: str
) -> None:
    rig = FaultyRig(study.protocol, {4: fault})  # the first stimulus after practice
    session = run_session(study, study.begin("P01"), rig=rig)
    flawed, repeated = session.records[2:4]
    assert (flawed.flaw, flawed.attempt, repeated.flaw, repeated.attempt) == (flaw, 0, "", 1)
    assert flawed.trial == repeated.trial
    assert (flawed.answer is None) == isinstance(fault, trials.UndeliveredError)
    assert len(session.counted) == 12


def test_an_error_counts_only_with_a_controller(study: Study) -> None:
    faults = {number: {"error": 90.0} for number in range(100)}
    session = run_session(study, study.begin("P01"), rig=FaultyRig(study.protocol, faults))
    for record in session.records:
        controllers = {str(each["controller"]) for each in record.trial.stimuli}
        assert bool(record.flaw) == ("adaptive" in controllers)
    assert session.ended == trials.COMPLETE


def test_a_gain_of_zero_asks_for_no_vibration(tmp_path: Path) -> None:
    text = TEXT.replace("controller: [none, adaptive]", "gain: [0, 1]")
    strengths = "strengths: {controller=none: 0, controller=adaptive: 3}\n"
    study = write_study(tmp_path, text.replace(strengths, ""))
    faults = {number: {"desired_rms": 0.0} for number in range(200)}
    session = run_session(study, study.begin("P01"), rig=FaultyRig(study.protocol, faults))
    still = [each for each in session.records if not each.flaw]
    assert {each["gain"] for record in still for each in record.trial.stimuli} == {0.0}


def test_a_rig_that_delivers_nothing_ends_the_session(study: Study) -> None:
    faults = {number: trials.UndeliveredError("no graph") for number in range(100)}
    participant = Scripted(study)
    rig = FaultyRig(study.protocol, faults)
    session = run_session(study, study.begin("P01"), participant, rig)
    assert session.ended == f"{MOST_BROKEN_OFF} trials in succession broke off"
    # Each time the participant is asked to begin again, so that nobody misses trials.
    assert participant.kinds.count("ready") == MOST_BROKEN_OFF


def test_a_lost_page_breaks_a_trial_off(study: Study) -> None:
    def lose(screen: trials.Screen) -> None:
        if screen.interval == 2 and not lost:
            lost.append(screen)
            raise trials.UndeliveredError("no page")

    lost: list[trials.Screen] = []
    session = run_session(study, study.begin("P01"), Scripted(study, {"stimulus": lose}))
    assert session.records[0].flaw == "no page"
    assert len(session.records[0].presented) == 1
    assert session.ended == trials.COMPLETE


def test_rig_and_page_may_both_fail(study: Study) -> None:
    def miss(_: trials.Screen) -> None:
        before = participant.screens[-2].kind
        if before == "stimulus" and not missed:
            missed.append(before)
            raise trials.UndeliveredError("no page")

    missed: list[str] = []
    participant = Scripted(study, {"wait": miss, "ready": miss})
    rig = FaultyRig(study.protocol, {0: trials.UndeliveredError("no graph")})
    session = run_session(study, study.begin("P01"), participant, rig)
    assert (session.records[0].flaw, session.ended) == ("no graph", trials.COMPLETE)
    assert missed


def test_exposure_of_a_day_ends_a_sitting(tmp_path: Path) -> None:
    study = write_study(tmp_path, TEXT.replace("bounds:", "limits: {exposure: 0.01}\nbounds:"))
    rig = SimulatedRig(study.protocol)
    rig.exposure = 0.01**2 * 8 * 3600 - 0.005  # m^2/s^3, just below
    session = run_session(study, study.begin("P01"), rig=rig)
    assert session.ended == "limit of exposure: A(8) has reached 0.01 m/s^2"
    assert 0 < len(session.records) < 14
    assert session.exposure == pytest.approx(rig.exposure)
    assert len(run_session(study, study.resume("P01")).records) == len(session.records)


def test_time_ends_a_session(tmp_path: Path) -> None:
    study = write_study(tmp_path, TEXT.replace("bounds:", "limits: {minutes: 1}\nbounds:"))
    run_session(study, study.begin("P01"), Scripted(study, {"question": stop_at(4)}))
    log = study.resume("P01")
    session = make_session(study, log)
    session.records[0] = replace(session.records[0], asked_steady=0, answered_steady=61 * 10**9)
    assert session.run().ended == "limit of time: trials have taken 1 min"
    log.close()


def test_a_log_of_another_plan_is_refused(study: Study) -> None:
    # A fixed seed: the first trials of some seeds are those of the next one, too.
    begun = study.begin("P01", seed=1)
    run_session(study, begun, Scripted(study, {"question": stop_at(4)}))
    with study.resume("P01") as log, pytest.raises(ParameterError, match="P01: the log is not of"):
        make_session(study, log, more_seed=1)


def test_a_full_disk_stops_the_forces_and_loses_nothing(study: Study) -> None:
    rig, stops = noting_stops(study)
    log = study.begin("P01")
    kept, add = [], log.add

    def full(kind: str, **content: object) -> None:
        if len(log.entries) == 8:
            raise OSError(28, "No space left on device", str(log.file))
        add(kind, **content)
        kept.append(kind)

    log.add = full  # type: ignore[method-assign]
    with pytest.raises(OSError, match="No space left"):
        run_session(study, log, rig=rig)
    assert stops
    before = read_session(study.participant_folder("P01"))
    assert before.ended == ""
    after = run_session(study, study.resume("P01"))
    assert after.records[: len(before.records)] == before.records
    assert len(after.counted) == 12


class Acknowledged(Scripted):
    """Participant who writes down each question, and each answer once the next screen is shown."""

    def __init__(self, study: Study, file: Path) -> None:
        super().__init__(study)
        self._notes = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
        self._given = b""

    def ask(
        self, screen: trials.Screen, trial: trials.PlannedTrial | None = None
    ) -> trials.Answer:
        answer = super().ask(screen, trial)
        if screen.kind in ("question", "consent"):
            name = trial.number if trial else screen.kind
            os.write(self._notes, f"asked {name}\n".encode())
            self._given = f"acknowledged {name} {answer.value}\n".encode()
        return answer

    def _see(self, screen: trials.Screen) -> str | None:
        os.write(self._notes, self._given)
        self._given = b""
        return super()._see(screen)


def run_killed(study: Study, notes: Path, seconds: float) -> bool:
    """Run or resume a session in a process that is killed after a time; return if it ended."""
    child = os.fork()
    if not child:
        status = 1
        try:
            # No handler: the kernel ends the process, between any two instructions.
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.setitimer(signal.ITIMER_REAL, seconds)
            begun = [each for each in study.sessions if each.participant == "P01"]
            if not (begun and begun[0].ended == trials.COMPLETE):
                log = study.resume("P01") if begun else study.begin("P01", 7)
                run_session(study, log, Acknowledged(study, notes))
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, -signal.SIGALRM)
    return status == 0


@pytest.mark.parametrize("sessions", rest_slow([12, 200]))
def test_killed_sessions_lose_nothing_and_ask_nothing_twice(tmp_path: Path, sessions: int) -> None:
    durations = []
    for name in ("first", "second", "third"):  # the first one loads libraries, too
        study, begun = write_study(tmp_path / name), time.monotonic()
        whole = timeless(run_session(study, study.begin("P01", 7)))
        durations.append(time.monotonic() - begun)
    chance, kills, inside = random.Random(1), 0, 0
    for number in range(sessions):
        study = write_study(tmp_path / f"{number}")
        notes = tmp_path / f"{number}.txt"
        longest = min(durations)  # so that most are killed, however fast the machine is
        while not run_killed(study, notes, chance.uniform(0, longest)):
            kills += 1
            inside += (study.participant_folder("P01") / LOG).exists()
            longest *= 2  # so that each session ends
        lines = notes.read_text().splitlines()
        acknowledged: Counter[str] = Counter()
        for line in lines:
            what, name, *answer = line.split()
            if what == "acknowledged":
                acknowledged[name] += 1
            else:
                assert name not in acknowledged, f"{name} is asked again"
        assert set(acknowledged.values()) == {1}
        found = read_session(study.participant_folder("P01"))
        assert timeless(found) == whole
        answers = {str(each.trial.number): each.answer.value for each in found.records}  # type: ignore[union-attr]
        for line in lines:
            what, name, *answer = line.split()
            if what == "acknowledged" and name != "consent":
                assert answers[name] == answer[0]
    assert kills > sessions
    assert inside > sessions // 2
