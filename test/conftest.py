# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by all tests: reproducible properties, and a ROS graph of their own."""

from __future__ import annotations

import os
import re
import sys

# Before numpy is loaded: threads of BLAS that spin for each other on a busy machine take ten times
# as long as one thread alone.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings

from haptic_accel.core.process import module_command
from haptic_accel.core.tick import COMPILED, TICK
from running import Command, MachineStoodStillError, StallWatch, Start
from sharing import own_domain
from terminals import Terminal
from untouched_parts import CORE
from verbs import output_of, status_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from observing import Observer

if TICK != COMPILED:
    # Commands of tests do not tell about an extension that is of another version, either.
    os.environ["HAPTIC_ACCEL_PLAIN"] = "1"

SAFETY = ("core/tick/", "core/test_actuator.py", "core/coupling/")
"""Folders and files of tests of what keeps forces within limits."""

PARTS = {
    "safety or plain": re.compile(r"mark\.plain\b"),
    "live": re.compile(
        r"mark\.live\b|\b(domain|observer|LookAtOneGraph)\b|\b(ask|haptic_accel|start): "
    ),
}
"""Text in a file with tests of a part of the suite, by the marks with which the part begins."""

# The machine's speed is not what a property is about, and the same tree gives the same result.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")

CASES = {"safety": (100, 200), "usual": (40, 200)}
"""Cases of a property by profile, without and with ``--slow``, unless it has its own number."""

BEYOND_CORE = re.compile(r"(from|import) haptic_accel(?!\.core\b)")
"""Text in a test of the core that uses other parts of the package, too."""

FUZZ_CASES = {"fuzz": (100, 1000), "fuzz few": (25, 100), "fuzz fewest": (5, 10)}
"""Cases of a property of generated damage by profile, without and with ``--slow``."""

RERUN_REASONS = ("^MachineStoodStillError: ", "samples are missing")
"""Failures after which a live test is run once more: the machine was not there for the graph."""

SLOW_TIME = 1800
"""Time limit for a test marked slow, s, against a hang."""

MOST_RERUNS = 3
"""Reruns in one session above which the session fails."""

LONGEST_STALL = 0.3
"""Time for which a machine may run nothing before a live test's failure is put down to it, s."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the tests marked slow, too")
    what = "run only the properties marked fuzz, with this many other cases each"
    parser.addoption("--fuzz", type=int, metavar="CASES", help=what)
    what = "run only the smoke tests of these kits, and of the core what limits forces"
    parser.addoption("--untouched-parts", default="", metavar="PART,PART", help=what)


def pytest_configure(config: pytest.Config) -> None:
    """Set the numbers of cases, before the tests that they are for are read."""
    cases, slow = config.getoption("--fuzz"), config.getoption("--slow")
    for name, numbers in CASES.items():
        usual = settings.get_profile("project")
        settings.register_profile(name, usual, max_examples=numbers[slow])
    for name, numbers in FUZZ_CASES.items():
        settings.register_profile(
            name,
            settings.get_profile("project"),
            max_examples=cases or numbers[slow],
            derandomize=not cases,
            # One folder or server serves all cases of a property.
            suppress_health_check=[HealthCheck.function_scoped_fixture],
        )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Read only files with tests of that part in a part of the suite: a process saves 12 s."""
    if collection_path.suffix != ".py":
        return None
    if _is_untouched(collection_path, config) and "mark.smoke" not in collection_path.read_text():
        return True
    asked = config.getoption("-m").removeprefix("(")
    part = next((part for part in PARTS if asked.startswith(part)), "")
    if not part:
        return None
    safety = part != "live" and _is_safety(collection_path)
    return None if safety or _has_part(collection_path, part) else True


def _is_untouched(path: Path, config: pytest.Config) -> bool:
    place, kit, *_ = (*path.relative_to(Path(__file__).parent).parts, "")
    parts = config.getoption("--untouched-parts").split(",")
    if place != CORE:
        return place == "kits" and kit in parts
    outside = _is_safety(path) or _has_part(path, "live") or BEYOND_CORE.search(path.read_text())
    return CORE in parts and path.suffix == ".py" and not outside


def _has_part(path: Path, part: str) -> bool:
    return bool(PARTS[part].search(path.read_text(encoding="utf-8")))


def pytest_collectstart(collector: pytest.Collector) -> None:
    """Choose the number of cases of the properties in a file, which each takes as it is read."""
    if isinstance(collector, pytest.Module):
        settings.load_profile("safety" if _is_safety(collector.path) else "usual")


def _is_safety(path: Path) -> bool:
    return path.relative_to(Path(__file__).parent).as_posix().startswith(SAFETY)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what has a ROS domain of its own as live; leave out what is slow unless asked for."""
    for item in items:
        if _is_safety(item.path):
            item.add_marker("safety")
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_TIME))
        if "domain" in getattr(item, "fixturenames", ()) and not item.get_closest_marker("quiet"):
            item.add_marker("live")
        for mark, part in zip(("plain", "live"), PARTS, strict=True):
            if item.get_closest_marker(mark) and not _has_part(item.path, part):
                raise pytest.UsageError(f"{item.nodeid}: is {mark}, which PARTS does not find")
        if item.get_closest_marker("live") and config.pluginmanager.hasplugin("rerunfailures"):
            item.add_marker(pytest.mark.flaky(reruns=1, only_rerun=list(RERUN_REASONS)))
    alone = [item for item in items if not item.get_closest_marker("smoke")]
    _leave_out(config, items, [item for item in alone if _is_untouched(item.path, config)])
    if TICK == COMPILED:
        _leave_out(config, items, [item for item in items if item.get_closest_marker("plain")])
    if config.getoption("--fuzz"):
        _leave_out(config, items, [item for item in items if not item.get_closest_marker("fuzz")])
        for item in items:
            item.add_marker(pytest.mark.timeout(0))
    elif not config.getoption("--slow"):
        slow = [item for item in items if item.get_closest_marker("slow")]
        _leave_out(config, items, slow if len(slow) < len(items) else [])


def _leave_out(
    config: pytest.Config, items: list[pytest.Item], unwanted: list[pytest.Item]
) -> None:
    if unwanted:
        config.hook.pytest_deselected(items=unwanted)
        left_out = set(unwanted)
        items[:] = [item for item in items if item not in left_out]


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    yield from _with_stalls_named(item)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    yield from _with_stalls_named(item)


def _with_stalls_named(item: pytest.Item) -> Iterator[None]:
    """Blame a live test's failure on the machine where that stood still meanwhile."""
    if not item.get_closest_marker("live"):
        yield
        return
    with StallWatch() as watch:
        outcome: Any = yield
    failed = outcome.excinfo and issubclass(outcome.excinfo[0], (Exception, pytest.fail.Exception))
    if failed and watch.longest > LONGEST_STALL:
        failure = outcome.excinfo[1]
        reason = str(failure).partition("\n")[0]
        error = MachineStoodStillError(f"for {watch.longest:.2f} s, beside: {reason}")
        error.__cause__ = failure
        outcome.force_exception(error)


def _reruns(config: pytest.Config) -> list[Any]:
    reporter: Any = config.pluginmanager.getplugin("terminalreporter")
    return list(reporter.stats.get("rerun", [])) if reporter else []


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    if session.exitstatus == pytest.ExitCode.OK and len(_reruns(session.config)) > MOST_RERUNS:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    reruns = _reruns(config)
    if not reruns:
        return
    terminalreporter.section(f"{len(reruns)} run again, {MOST_RERUNS} are allowed")
    for report in reruns:
        crash = getattr(report.longrepr, "reprcrash", None)
        terminalreporter.write_line(f"{report.nodeid}: {crash.message if crash else ''}")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an empty folder the working directory, and return it."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def ran(here: Path) -> Callable[..., str]:
    """Run a verb without a graph in this process and an empty folder: `verbs.output_of`."""
    return output_of


@pytest.fixture
def domain() -> Iterator[int]:
    """Give a test, and every process it starts, a ROS domain of its own on this machine."""
    with own_domain() as number:
        yield number


@pytest.fixture
def start(tmp_path: Path, domain: int) -> Iterator[Start]:
    """Start ``python WORDS`` in an empty folder; ended with the test, and with it its nodes."""
    commands: list[Command] = []

    def started(*words: str) -> Command:
        commands.append(Command([str(word) for word in words], tmp_path))
        return commands[-1]

    yield started
    for command in commands:
        if command.process.poll() is None:
            command.process.kill()
        command.end()


@pytest.fixture
def haptic_accel(start: Start) -> Start:
    """Start ``haptic-accel WORDS`` as the console script does."""
    _, *main = module_command("haptic_accel.cli.main")
    return lambda *words: start(*main, *words)


@pytest.fixture
def observer(domain: int) -> Iterator[Observer]:
    """Give a test a node of its own in its ROS domain."""
    # ROS takes a while to import: only who talks to it waits for that.
    from observing import Observer

    observer = Observer(domain)
    yield observer
    observer.close()


@pytest.fixture
def ask(domain: int, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run a verb in this process, quicker than a command: ``ask(VERB, *WORDS)``.

    Gives its exit status and what it wrote.
    """

    def asked(*words: str) -> tuple[int, str]:
        capsys.readouterr()
        status = status_of(*words)
        captured = capsys.readouterr()
        return status, (captured.out + captured.err).strip()

    return asked


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """Give the tests of a module one browser."""
    from browsing import chromium

    with chromium() as opened:
        yield opened


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    """Open terminals, each with a Python that runs the given words in the foreground."""
    opened: list[Terminal] = []

    def opening(*words: str) -> Terminal:
        opened.append(Terminal(list(words), tmp_path))
        return opened[-1]

    yield opening
    for terminal in opened:
        terminal.close()


@pytest.fixture(scope="module", autouse=True)
def quick_pdf() -> Iterator[None]:
    """Embed only drawn glyphs into PDFs: making fonts smaller takes half an analysis' time.

    Commands embed fonts as for a user. Whoever draws has loaded plots.
    """
    with pytest.MonkeyPatch.context() as settings:
        if plots := sys.modules.get("haptic_accel.analysis.plots"):
            settings.setitem(plots.EMBEDDED, "pdf.fonttype", 3)
        yield


@pytest.fixture(autouse=True)
def normal_priority() -> Iterator[None]:
    """Fail a test that leaves its process with real-time priority: a browser would inherit it."""
    yield
    if hasattr(os, "sched_getscheduler"):
        assert os.sched_getscheduler(0) == os.SCHED_OTHER
