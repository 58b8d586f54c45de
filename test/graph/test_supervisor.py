# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import itertools
import signal
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from haptic_accel.core.process import WELL
from haptic_accel.graph import supervisor
from haptic_accel.graph.supervisor import Supervisor, command
from haptic_accel.setup.processes import Process
from running import PATIENCE, wait_until


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let processes run Python scripts, which stand for nodes, by their executable's name."""
    monkeypatch.setattr(
        supervisor,
        "command",
        lambda process, _: [sys.executable, "-c", process.parameters["script"][""]],
    )


def script(name: str, text: str) -> Process:
    return Process(name, {"script": {"": text}})


WAIT = "import signal, sys; signal.signal(signal.SIGTERM, lambda *_: sys.exit(0)); {}"
WAIT += "signal.pause()"
PATIENT = WAIT.format("print('up', flush=True); ")


@pytest.mark.usefixtures("scripts")
def test_the_first_end_ends_all_with_its_status_and_last_lines() -> None:
    dying = script("dying", "for i in range(1000): print(i)\nraise SystemExit(3)")
    outcome = Supervisor([script("patient", PATIENT), dying]).run()
    assert (outcome.first, outcome.status) == ("dying", 3)
    assert outcome.last_lines["dying"] == [str(i) for i in range(980, 1000)]
    assert outcome.failed == {"dying": 3}


@pytest.mark.usefixtures("scripts")
@pytest.mark.parametrize(
    ("text", "respawn", "failed"),
    [
        *((f"raise SystemExit({status})", True, {}) for status in WELL),
        ("raise SystemExit(2)", True, {"ended": 2}),
        ("import signal; signal.raise_signal(signal.SIGALRM)", False, {"ended": -signal.SIGALRM}),
    ],
)
def test_a_node_whose_middleware_did_not_end_has_not_failed_unless_its_work_did(
    text: str, respawn: bool, failed: dict[str, int]
) -> None:
    assert Supervisor([replace(script("ended", text), respawn=respawn)]).run().failed == failed


@pytest.mark.usefixtures("scripts")
def test_the_graph_goes_on_without_what_is_optional_and_says_so() -> None:
    said: list[tuple[str, str]] = []
    told, up = threading.Event(), threading.Event()

    def hear(name: str, line: str) -> None:
        said.append((name, line))
        if "goes on" in line:
            told.set()
        elif line == "up":
            # From here on it handles signals: Python itself ends with 1 while it starts.
            up.set()

    looking = replace(script("looking", "raise SystemExit(3)"), optional=True)
    supervisor = Supervisor([script("patient", PATIENT), looking], on_line=hear)
    outcome = supervisor.run(lambda: told.is_set() and up.is_set())
    assert ("looking", "ended with status 3; the graph goes on without it") in said
    assert outcome.first == ""
    assert outcome.statuses == {"patient": 0}
    assert outcome.failed == {}


@pytest.mark.usefixtures("scripts")
def test_a_process_that_fails_is_started_again_until_it_ends_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "RESPAWN_DELAY", 0.0)
    said: list[str] = []
    tries = tmp_path / "tries"
    failing = script(
        "failing",
        f"import os; tries = open({str(tries)!r}, 'a'); tries.write('x'); tries.close()\n"
        f"raise SystemExit(3 if os.stat({str(tries)!r}).st_size < 3 else 0)",
    )
    again = [replace(failing, respawn=True)]
    outcome = Supervisor(again, on_line=lambda _, line: said.append(line)).run()
    assert said == ["ended with status 3; it is started again"] * 2
    assert (outcome.first, outcome.status, outcome.failed) == ("failing", 0, {})


@pytest.mark.usefixtures("scripts")
def test_a_process_stopped_while_it_still_imports_says_nothing() -> None:
    said: list[str] = []
    up = threading.Event()

    def hear(_: str, line: str) -> None:
        said.append(line)
        up.set()

    importing = script("importing", "print('up', flush=True); import time; time.sleep(60)")
    outcome = Supervisor([importing], on_line=hear).run(up.is_set)
    assert said == ["up"]
    assert outcome.failed == {}


@pytest.mark.usefixtures("scripts")
def test_an_emergency_stop_waits_for_a_process_that_does_not_handle_it_yet() -> None:
    late = script(
        "late",
        "import sys, signal\n"
        "print('importing', flush=True)\n"
        "while signal.SIGUSR1 not in signal.sigpending(): pass\n"
        "signal.signal(signal.SIGUSR1, lambda *_: sys.exit(0))\n"
        "signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})\n"
        "sys.exit(1)",
    )
    graph = Supervisor([late], on_line=lambda *_: graph.stop_forces())
    assert graph.run().statuses == {"late": 0}


@pytest.mark.usefixtures("scripts")
def test_a_signal_at_any_instant_leaves_it_looking(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "END_CHECK_PERIOD", 0.001)
    before = signal.signal(signal.SIGUSR1, lambda *_: None)
    looks = itertools.count()
    over = threading.Event()

    def interrupt() -> None:
        while not over.wait(0.0003):
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGUSR1)

    interrupting = threading.Thread(target=interrupt)
    interrupting.start()
    try:
        outcome = Supervisor([script("patient", PATIENT)]).run(lambda: next(looks) > 1000)
    finally:
        over.set()
        interrupting.join()
        signal.signal(signal.SIGUSR1, before)
    assert outcome.first == ""


DEAF = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True)\n"
DEAF += "while True: signal.pause()"
SLOW = (
    "import os, signal, time\n"
    "signal.signal(signal.SIGTERM, lambda *_: (time.sleep(0.5), os._exit(0)))\n"
    "print('up', flush=True); signal.pause()"
)
CUT_BAG = PATIENT.replace("sys.exit(0)", "sys.exit(1)")


@pytest.mark.usefixtures("scripts")
@pytest.mark.parametrize(
    ("late", "recorder", "failed", "said"),
    [
        (DEAF, "", {"late": -signal.SIGKILL}, "does not end, and is killed"),
        (DEAF, CUT_BAG, {"late": -signal.SIGKILL, "recorder": 1}, "does not end, and is killed"),
        (DEAF, PATIENT, {}, "does not end, and is killed"),
        (SLOW, PATIENT, {}, "has not ended yet, and is waited for"),
    ],
    ids=["no bag", "bag not whole", "bag whole", "slow"],
)
def test_who_ends_late_is_waited_for_and_said_and_has_not_failed_if_the_bag_is_whole(
    late: str, recorder: str, failed: dict[str, int], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(supervisor, "QUIET_END", 0.1)
    monkeypatch.setattr(supervisor, "LATE_END", 0.1 if late == DEAF else PATIENCE)
    processes = [script("late", late)]
    processes += [replace(script("recorder", recorder), last=True)] if recorder else []
    heard: list[tuple[str, str]] = []
    outcome = Supervisor(processes, on_line=lambda *line: heard.append(line)).run(
        lambda: [line for _, line in heard].count("up") == len(processes)
    )
    assert outcome.failed == failed
    assert heard[-1] == ("late", said), "the recorder is the last to be ended"


@given(st.text(st.characters(codec="utf-8", exclude_characters="\0")))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_text_reaches_ros_as_that_text(tmp_path: Path, text: str) -> None:
    words = command(Process("recorder", {"recorder": {"bag": text}}, "/left"), tmp_path)
    assert words[-2:] == ["-r", "__ns:=/left"]
    file = Path(words[words.index("--params-file") + 1]).read_text()
    assert yaml.safe_load(file) == {"/**/recorder": {"ros__parameters": {"bag": text}}}
    assert 'bag: "' in file, "quoted: ROS would read 1e5 as a number"


@pytest.mark.usefixtures("scripts")
def test_a_process_whose_lines_are_not_taken_goes_on_and_the_lost_are_counted(
    tmp_path: Path,
) -> None:
    taken: list[str] = []
    seen = threading.Event()
    goes_on = tmp_path / "goes_on"

    def take(name: str, line: str) -> None:
        taken.append(line)
        wait_until(goes_on.exists, "2 MB of lines written, of which a pipe takes 64 KiB")
        if "dropped" in line:
            seen.set()

    flooding = script(
        "flooding",
        "for number in range(20000): print(number, 'x' * 100)\n"
        f"open({str(goes_on)!r}, 'w').close()\n" + PATIENT,
    )
    outcome = Supervisor([flooding], on_line=take).run(seen.is_set)
    numbers = [int(line.split()[0]) for line in taken if line.endswith("x")]
    dropped = [int(line.split()[0]) for line in taken if "dropped" in line]
    assert numbers == sorted(set(numbers)), "in their order"
    assert len(numbers) + sum(dropped) in (20000, 20001), "with the last word or without"
    assert sum(dropped) > 0
    assert outcome.failed == {}


@pytest.mark.usefixtures("scripts")
@pytest.mark.parametrize("error", [BrokenPipeError(), SystemExit(1)])
def test_the_graph_is_stopped_in_order_once_nobody_takes_its_lines(error: BaseException) -> None:
    def fail(*_: str) -> None:
        raise error

    outcome = Supervisor([script("patient", PATIENT)], on_line=fail).run()
    assert (outcome.first, outcome.statuses) == ("", {"patient": 0})
    assert outcome.unread is error


@pytest.mark.usefixtures("scripts")
def test_an_end_does_not_wait_for_who_takes_no_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervisor, "OUTPUT_TIME", 0.1)
    up, over = threading.Event(), threading.Event()

    def hang(*_: str) -> None:
        up.set()
        over.wait(60)

    outcome = Supervisor([script("patient", PATIENT)], on_line=hang).run(up.is_set)
    over.set()
    assert outcome.statuses == {"patient": 0}


EVENTFUL = """
from haptic_accel.core.process import notify_supervisor
print("engaged, says a line", flush=True)
notify_supervisor("engaged", place="\u00e4 {}")
print('\\x1enot JSON', flush=True)
"""


@pytest.mark.usefixtures("scripts")
def test_events_are_told_apart_from_whatever_lines_say() -> None:
    told: list[tuple[str, dict[str, object]]] = []
    said: list[str] = []
    outcome = Supervisor(
        [script("teller", EVENTFUL)],
        on_line=lambda _, line: said.append(line),
        on_event=lambda name, event: told.append((name, event)),
    ).run()
    assert told == [("teller", {"event": "engaged", "place": "\u00e4 {}"})]
    assert said == ["engaged, says a line", "\x1enot JSON"]
    assert outcome.last_lines["teller"] == said


MANY = """
from haptic_accel.core.process import notify_supervisor
for number in range(3000):
    print(number, flush=True)
notify_supervisor("recorded", path="bag")
"""


@pytest.mark.usefixtures("scripts")
def test_no_event_is_dropped_with_lines_that_nobody_reads() -> None:
    told: list[object] = []
    stopped = threading.Event()

    def read_slowly(name: str, line: str) -> None:
        stopped.wait(0.5)  # once: meanwhile more lines come than can wait
        stopped.set()

    paths = {"on_event": lambda _, event: told.append(event["path"])}
    Supervisor([script("many", MANY)], on_line=read_slowly, **paths).run()
    assert told == ["bag"]
