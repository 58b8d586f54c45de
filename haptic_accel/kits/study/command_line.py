# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel study``: studies with participants, from a template to exported data."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from datetime import datetime
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from rich.progress import Progress

from haptic_accel import ParameterError, commands
from haptic_accel.core.process import INTERRUPTED
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.kits.study import folder as folders
from haptic_accel.kits.study.conditions import check_blanks, check_deliverable
from haptic_accel.kits.study.exposure import daily_exposure
from haptic_accel.kits.study.log import Log
from haptic_accel.kits.study.procedures import Plan, describe
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.session import Session, power, simulate_study, write_simulated
from haptic_accel.kits.study.tables import FORMS, exclusions, export_study, titled
from haptic_accel.kits.study.trials import COMPLETE, SessionRecord, UndeliveredError

if TYPE_CHECKING:
    from haptic_accel.commands import Workers


F = TypeVar("F", bound=Callable[..., Any])

OPERATOR = "stopped by the operator"
"""Reason of a sitting's end by a signal or the stop key."""

LAST_SCREEN = 1.0
"""Time for the page to load its last screen, s."""


def study_argument(verb: F) -> F:
    """Add the argument for the folder of a study, which the command receives as a `Study`."""

    @wraps(verb)
    def with_study(*arguments: Any, study: Path, **settings: Any) -> Any:
        return verb(*arguments, study=folders.Study(study), **settings)

    argument = click.argument("study", metavar="[STUDY]", type=commands.FILE, default=".")
    return cast("F", argument(with_study))


participant_option = click.option(
    "--participant", required=True, metavar="PSEUDONYM", help="Pseudonym, such as P07; no name."
)
yes_option = click.option("--yes", is_flag=True, help="Skip the confirmation.")
port_option = click.option(
    "--port", default=0, type=click.IntRange(0, 65535), metavar="PORT", help="TCP port; 0 for any."
)
open_option = click.option(
    "--open/--no-open", "opened", default=True, help="Open the page in a browser."
)


@commands.verb("haptic-accel study new --template compensated_or_not my_study")
@click.option(
    "--template",
    required=True,
    type=commands.one_of(folders.templates()),
    metavar="NAME",
    help=f"One of {', '.join(folders.templates())}.",
)
@click.argument("folder", metavar="FOLDER", type=commands.FILE)
def new(template: str, folder: Path) -> None:
    """Write a study from a template: one file to read, and to change."""
    print(folders.write_template(template, folder))
    print(commands.next_command("study", "check", str(folder)))


@commands.verb("haptic-accel study check my_study")
@study_argument
def check(study: folders.Study) -> None:
    """Check that a study can be run as it is written, and describe what it asks.

    Reads all its files, and checks each condition against the arguments of the graph. Refuses
    blanks of the template, which simulate does not mind.
    """
    check_deliverable(study.protocol)
    Plan(study.protocol, 0, 0)
    print(*describe(study.protocol), sep="\n")
    print(commands.next_command("study", "simulate", str(study.folder)))
    check_blanks(study.protocol)


@commands.verb(
    "haptic-accel study simulate my_study --studies 500",
    "haptic-accel study simulate my_study --write tried",
)
@study_argument
@click.option(
    "--studies", default=200, type=click.IntRange(1, 100_000), help="Number of simulated studies."
)
@click.option(
    "--participants",
    type=click.IntRange(1, 10_000),
    show_default="as planned",
    help="Number of observers in each.",
)
@click.option("--seed", default=1, type=click.IntRange(0), help="Seed of all random numbers.")
@click.option(
    "--write",
    "written",
    type=commands.FILE,
    metavar="FOLDER",
    help="New folder for one simulated study, unblinded; no power is estimated.",
)
@commands.workers_options
@commands.json_option
def simulate(
    study: folders.Study,
    *,
    studies: int,
    participants: int | None,
    seed: int,
    written: Path | None,
    workers: Workers,
    json_file: Path | None,
) -> None:
    """Run a study with simulated observers, and estimate the power of its planned tests.

    The observers follow `observer` and `strengths` of the protocol. The power is the share of
    simulated studies in which a test is significant, with its 95 % interval.
    """
    # Imported here, because the libraries take a second to load.
    from haptic_accel.commands import run_side_by_side

    protocol = study.protocol
    count = participants or protocol.rules.participants
    if written:
        _write_simulated(study, written, count, seed)
        return
    if not protocol.tests:
        raise ParameterError(
            f"{protocol.source}: tests = nothing: must be given to estimate power"
        )
    run = partial(_significant, protocol, count)
    found, end = run_side_by_side(
        workers, run, range(seed, seed + studies), "studies", lambda _: ""
    )
    outcomes = list(found.values())
    by_test = zip(protocol.tests, zip(*outcomes, strict=True), strict=bool(outcomes))
    powers = [power(test.name, significant) for test, significant in by_test]
    print(f"{len(outcomes)} simulated studies with {count} participants")
    title = titled(protocol, simulated=True).title
    commands.print_table(commands.ResultTable.of(POWER, powers, title=title))
    commands.save([asdict(each) for each in powers], json_file)
    if end:
        raise end


@commands.verb("haptic-accel study run my_study --participant P07")
@study_argument
@participant_option
@port_option
@open_option
def run(study: folders.Study, *, participant: str, port: int, opened: bool) -> None:
    """Run the session of a new participant, who answers on a page of their own.

    A run that is refused, or whose graph does not start, leaves no participant. At the end, the
    head of the log is printed: note it on paper, and compare it with that of verify.

    The terminal shows progress and safety alone. Space sets all forces to zero and stops; Ctrl-C
    stops after the present stimulus; the participant stops with a button or Esc. A session that
    was stopped or interrupted goes on with resume.
    """
    check_deliverable(study.protocol)
    check_blanks(study.protocol)
    _check_stopping_rule(study)
    _run_session(study, study.begin(participant), port, opened=opened)


@commands.verb("haptic-accel study resume my_study --participant P07")
@study_argument
@participant_option
@port_option
@open_option
def resume(study: folders.Study, *, participant: str, port: int, opened: bool) -> None:
    """Go on with a session at the trial at which it was stopped or interrupted.

    The version of the protocol is that with which the participant began.
    """
    _run_session(study, study.resume(participant), port, opened=opened)


@commands.verb("haptic-accel study status my_study")
@study_argument
@commands.json_option
def status(study: folders.Study, json_file: Path | None) -> None:
    """Show the participants' progress and exposure, without conditions and answers."""
    sessions = study.sessions
    rows = [_status(study, session) for session in sessions]
    complete = sum(row["state"] == COMPLETE for row in rows)
    planned = study.protocol.rules.participants
    title = titled(study.protocol, sessions).title
    commands.print_table(commands.ResultTable.of(STATUS, rows, title=title))
    print(f"{complete} of {planned} participants complete")
    unblinded = _unblinded(study)
    print(f"unblinded on {unblinded}" if unblinded else "conditions are sealed")
    _print_doubts(study)
    commands.save({"participants": rows, "planned": planned, "sealed": study.sealed}, json_file)


@commands.verb("haptic-accel study verify my_study")
@study_argument
def verify(study: folders.Study) -> None:
    """Compare all logs with the journal, and print their heads to compare with the notebook.

    A log that contradicts the journal is refused, and what one of them has alone is named. Who can
    write both files can forge both: only the heads on paper show that.
    """
    ends = study.ends
    rows = [{**asdict(each), "at": _date(each.at)} for each in ends]
    sessions = study.sessions
    title = titled(study.protocol, sessions).title
    commands.print_table(commands.ResultTable.of(ENDS, rows, title=title))
    _print_doubts(study)
    print(f"{len(sessions)} logs do not contradict the journal")


@commands.verb("haptic-accel study unblind my_study --reason 'all participants are complete'")
@study_argument
@click.option("--reason", required=True, metavar="TEXT", help="Reason, kept in the journal.")
@yes_option
def unblind(study: folders.Study, *, reason: str, yes: bool) -> None:
    """Let conditions be analysed and exported, once and for all.

    Asks before all planned participants have completed the study. The journal of the study keeps
    the time, the reason, and how many participants are complete.
    """
    if not study.sealed:
        raise ParameterError(f"{study.folder}: is unblinded already")
    included, planned = _included(study), study.protocol.rules.participants
    if included < planned and not yes:
        state = f"{included} of {planned} participants have completed the study."
        click.confirm(f"{state} Unblind for ever, before its end?", abort=True)
    study.unblind(reason)
    print(commands.next_command("study", "analyze", str(study.folder)))


@commands.verb("haptic-accel study analyze my_study")
@study_argument
def analyze(study: folders.Study) -> None:
    """Write the report of an unblinded study to its folder analysis: page, figures and tables.

    The planned tests come first; participants who are excluded are named with the rule.
    """
    sessions = _unsealed(study)
    _print_doubts(study)
    from haptic_accel.kits.study.report import analyse_study, write_report

    result = analyse_study(study.protocol, sessions)
    page = write_report(result, _emptied(study.folder / folders.ANALYSIS), _unblinded(study))
    for participant, rule in result.excluded.items():
        print(f"{participant} is excluded: {rule}")
    if result.planned:
        title = result.protocol.title
        commands.print_table(commands.ResultTable.of(PLANNED, result.planned, title=title))
    print(f"report: {page}")


@commands.verb("haptic-accel study export my_study --form bids")
@study_argument
@click.option(
    "--form",
    type=commands.one_of(FORMS),
    default="psych-ds",
    metavar="|".join(FORMS),
    help="Form.",
)
def export(study: folders.Study, form: str) -> None:
    """Write the data of an unblinded study to its folder export, without dates or names."""
    folder, sessions = study.folder / folders.EXPORT / form, _unsealed(study)
    _print_doubts(study)
    export_study(study.protocol, sessions, _emptied(folder), form, unblinded=True)
    print(f"{form}: {folder}")


@commands.verb(
    "haptic-accel study delete-participant my_study --participant P07", name="delete-participant"
)
@study_argument
@participant_option
@yes_option
def delete_participant(study: folders.Study, *, participant: str, yes: bool) -> None:
    """Delete a participant's log and bags, and all results in the study's folder.

    Lists all that is deleted, and asks. No link is followed but bags in the participant's folder;
    there, the recorder's bags alone are deleted.

    Results hold all participants; analyze and export write them again. The journal keeps that
    somebody was deleted, and when. Copies elsewhere, such as backups, are yours to delete.
    """
    deletion = study.deletion(participant)
    print("to be deleted:", *deletion.removed, sep="\n  ")
    if deletion.left:
        print("not to be deleted, as links lead there:", *deletion.left, sep="\n  ")
    if not yes:
        click.confirm(f"Delete all data of {participant} for ever?", abort=True)
    study.delete(participant)
    print(f"{participant} is deleted")


PLANNED = (
    commands.Column("", "planned test", value=lambda each: each.test.name),
    commands.Column("", "participants", value=lambda each: len(each.values)),
    commands.Column("", "mean", "", 2, value=lambda each: each.mean.value),
    commands.Column("", "from", "", 2, value=lambda each: each.mean.low),
    commands.Column("", "to", "", 2, value=lambda each: each.mean.high),
    commands.Column("", "against", "", 2, value=lambda each: each.against),
    commands.Column("", "p", value=lambda each: _two_digits(each.outcome.p)),
)
"""Planned tests of an analysis, with the interval of the test."""

POWER = (
    commands.Column("name", "test"),
    commands.Column("share", "power", "", 2),
    commands.Column("low", "95 % from", "", 2),
    commands.Column("high", "to", "", 2),
)
"""Power of the planned tests."""

STATUS = (
    commands.Column("participant", "participant"),
    commands.Column("state", "state"),
    commands.Column("progress", "done", "%", 0, factor=100.0),
    commands.Column("trials", "trials"),
    commands.Column("undelivered", "not delivered"),
    commands.Column("minutes", "min", "", 1),
    commands.Column("exposure", "A(8)", "m/s^2", 2),
)
"""Columns on a participant that an operator may see."""

ENDS = (
    commands.Column("participant", "participant"),
    commands.Column("at", "end of a sitting"),
    commands.Column("line", "line"),
    commands.Column("head", "head"),
    commands.Column(
        "in_journal", "in the journal", value=lambda row: "yes" if row["in_journal"] else "no"
    ),
)
"""Columns of the heads of logs."""


def _status(study: folders.Study, session: SessionRecord) -> commands.Row:
    plan = Plan(study.version(session.digest), session.seed, session.row)
    for record in session.records:
        plan.record(record)
    steady = sum(each.answered_steady - each.asked_steady for each in session.records)
    return {
        "participant": session.participant,
        "state": session.ended or "interrupted",
        "version": session.digest[:8],
        "begun": _date(session.begun),
        "progress": plan.progress,
        "trials": len(session.records),
        "undelivered": sum(bool(each.flaw) for each in session.records),
        "minutes": steady / NANOSECONDS / 60,
        "exposure": daily_exposure(session.exposure),
    }


def _two_digits(value: float) -> float | None:
    return float(f"{value:.2g}") if math.isfinite(value) else None


def _date(time: int) -> str:
    return f"{datetime.fromtimestamp(time / NANOSECONDS):%Y-%m-%d %H:%M}"


def _unblinded(study: folders.Study) -> str:
    """Return time and reason of the unblinding; empty while the study is sealed."""
    return "; ".join(
        f"{_date(entry['at'])}: {entry['reason']}"
        for entry in study.journal
        if entry["kind"] == folders.UNBLINDING
    )


def _unsealed(study: folders.Study) -> list[SessionRecord]:
    """Return the sessions of an unblinded study."""
    if study.sealed:
        raise ParameterError(
            f"{study.folder}: conditions are sealed; haptic-accel study unblind opens them"
        )
    sessions = study.sessions
    if not sessions:
        raise ParameterError(f"{study.folder}: has no participant yet")
    return sessions


def _check_stopping_rule(study: folders.Study) -> None:
    """Refuse a participant after the last one that the protocol plans."""
    planned = study.protocol.rules.participants
    if _included(study) >= planned:
        raise ParameterError(
            f"{study.folder}: {planned} participants have completed it, as rules.participants says"
        )


def _included(study: folders.Study) -> int:
    """Return the number of participants who are complete and not excluded."""
    sessions = study.sessions
    return len(sessions) - len(exclusions(study.protocol, sessions))


def _print_doubts(study: folders.Study) -> None:
    """Print sittings that are only in the journal or only in the logs."""
    for line in study.doubts:
        print(line)


def _emptied(folder: Path) -> Path:
    """Empty a folder of results and return it."""
    for each in (folder, folder.parent):
        if each.name in (folders.ANALYSIS, folders.EXPORT, *FORMS) and each.is_symlink():
            raise ParameterError(f"{each}: is a link: must be a folder, or nothing")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _significant(protocol: Protocol, participants: int, seed: int) -> list[bool]:
    """Return for each planned test whether it is significant in a simulated study."""
    from haptic_accel.kits.study.planned_tests import planned_tests

    found = planned_tests(protocol, simulate_study(protocol, participants, seed))
    return [each.outcome.significant for each in found]


def _write_simulated(study: folders.Study, folder: Path, participants: int, seed: int) -> None:
    """Write a simulated study, with a note of the simulation in its journal."""
    commands.make_folder(folder)
    (folder / folders.PROTOCOL).write_text(study.protocol.content, encoding="utf-8")
    simulated = folders.Study(folder)
    with commands.progress_bar() as progress:
        bar = progress.add_task("observers", total=participants)
        for _ in write_simulated(simulated, participants, seed):
            progress.advance(bar)
    simulated.unblind("simulated observers")
    print(commands.next_command("study", "analyze", str(folder)))


def _run_session(study: folders.Study, log: Log, port: int, *, opened: bool) -> None:
    """Run a session on the live graph with a participant at a page, and show why it ended."""
    with log:
        begun = log.record
        try:
            ended = _ended(study, log, begun, port, opened=opened)
        except BaseException:
            study.withdraw(log)
            raise
        head = study.note_end(log)
    print(f"{begun.participant}: {ended}")
    print(f"for the notebook: {begun.participant}, line {len(log.heads)}, {folders.noted(head)}")
    if ended != COMPLETE:
        again = ("study", "resume", str(study.folder), "--participant", begun.participant)
        print(commands.next_command(*again))
        raise commands.StoppedError(status=INTERRUPTED if ended == OPERATOR else commands.FAILED)


def _ended(
    study: folders.Study, log: Log, begun: SessionRecord, port: int, *, opened: bool
) -> str:
    """Run a session, with its progress on the terminal; return the reason of its end."""
    from haptic_accel.kits.study.live import LiveRig
    from haptic_accel.kits.study.participant_page import ParticipantPage, read_texts

    protocol = study.version(begun.digest)
    texts = read_texts(protocol.language, study.folder)
    plan = Plan(protocol, begun.seed, begun.row)
    page: ParticipantPage
    rig = LiveRig(protocol, study.participant_folder(begun.participant))

    def stop_at_once() -> None:
        rig.stop()
        page.stop(OPERATOR)

    with ExitStack() as stack:
        try:
            stack.enter_context(rig)
        except UndeliveredError as error:
            raise commands.StoppedError(str(error)) from None
        page = ParticipantPage(texts, rig, port, protocol.masking.level)
        watch = _watch(stack.enter_context(commands.progress_bar()), begun.participant)
        session = Session(protocol, plan, log, rig, page, watch)
        address = page.start()
        stack.callback(page.close)
        stack.enter_context(commands.stop_on_signal(lambda: page.stop(OPERATOR)))
        stack.enter_context(commands.on_keys({commands.STOP_KEY: stop_at_once}))
        commands.show_page(address, opened=opened)
        ended = session.run().ended
        time.sleep(LAST_SCREEN)
        return ended


def _watch(progress: Progress, participant: str) -> Callable[[Session], None]:
    """Return the display of a session's progress and safety for the operator."""
    bar = progress.add_task(participant, total=1.0)

    def show(session: Session) -> None:
        safety = f"{session.undelivered} not delivered, A(8) {session.exposure:.2f} m/s^2"
        done = session.plan.progress
        progress.update(bar, description=f"{participant}: {safety}", completed=done)

    return show
