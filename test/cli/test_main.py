# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import ast
import io
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from importlib import metadata
from pathlib import Path
from typing import Any

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

import haptic_accel
from fuzzing import ODD_TEXTS, fuzz
from haptic_accel import __version__
from haptic_accel.analysis.metrics import Shift
from haptic_accel.cli.commands import LazyGroup, command_line
from haptic_accel.cli.options import Verb, Words
from haptic_accel.cli.output import StoppedError
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import module_command
from haptic_accel.setup.arguments import parse_arguments
from haptic_accel.setup.processes import graph, identification_graph
from haptic_accel.setup.replay import replay_arguments
from nightly import rest_slow
from running import python, reserved_domain, use_domain
from verbs import output_of, status_of

DATA = Path(__file__).parents[1] / "data"


def texts() -> Iterator[str]:
    """Yield the texts of the package: of its modules without docstrings, of pages and scripts."""
    for file in Path(haptic_accel.__file__).parent.rglob("*"):
        if file.suffix in (".j2", ".js"):
            yield file.read_text()
        elif file.suffix == ".py":
            nodes = list(ast.walk(ast.parse(file.read_text())))
            alone = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
            found = (n for n in nodes if isinstance(n, ast.Constant) and id(n) not in alone)
            yield from (str(node.value) for node in found)


def test_every_extra_that_is_advised_exists_and_no_command_of_ros_is() -> None:
    advised = "\n".join(texts())
    named = re.findall(r"haptic[-_]accel\[(.*?)\]", advised)
    extras = {word for words in named for word in words.split(",")}
    assert extras
    assert extras <= set(metadata.metadata("haptic_accel").get_all("Provides-Extra", []))
    # Wheels have no such command; that which plays a bag's topics is for those who have it.
    assert "ros2 " not in advised.replace("ros2 bag", "")


def every_verb() -> Iterator[tuple[str, ...]]:
    """Yield the words that call each verb, those of groups too."""
    for verb in command_line.verbs:
        yield (verb,)
        below = command_line.groups.get(verb)
        if below:
            yield from ((verb, kind) for kind in below.list_commands(click.Context(below)))


@pytest.mark.parametrize("verb", ["teleop", "experiment"])
def test_help_lists_every_argument_with_default_and_unit(verb: str) -> None:
    # A description may go on in the next line.
    text = re.sub(r"\n {6,}", " ", output_of(verb, "--help"))
    names = ["controller", "surface", "master", "slave", "rate", "duration", "record"]
    for name in [*names, "bag", "params_file", "seed"]:
        assert re.search(rf"^    {name} .*\(default: ", text, re.MULTILINE), text
    assert "[Hz] (default: 1000.0)" in text


@pytest.mark.parametrize(
    ("verb", "groups"),
    [
        (
            "teleop",
            {
                "Controller and simulated rig": ["controller", "surface", "seed"],
                "Devices, and the recording that they play": ["master", "slave", "replay"],
                "Live page": ["scope", "scope_port"],
                "Recording": ["record", "bag"],
            },
        ),
        (
            "replay",
            {
                "Replay: source and playback": ["bag", "rate", "output"],
                "Recording": ["record", "topics"],
            },
        ),
        ("scope", {"Namespace": ["namespace"]}),
    ],
)
def test_help_has_the_arguments_in_groups(verb: str, groups: dict[str, list[str]]) -> None:
    _, arguments = output_of(verb, "--help").split("Arguments, each as key:=value:\n")
    sections = re.split(r"^  (\S.*):$", arguments, flags=re.MULTILINE)
    found = dict(zip(sections[1::2], sections[2::2], strict=True))
    for heading, names in groups.items():
        assert set(re.findall(r"^    (\w+)", found[heading], re.MULTILINE)) >= set(names)


@pytest.mark.parametrize("group", [[], ["bag"], ["texture"]])
def test_help_is_shown_where_the_verb_is_missing(
    group: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(*group) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.rstrip() == output_of(*group, "--help").rstrip()


def test_options_for_one_purpose_have_a_heading() -> None:
    sections = re.split(r"^(\S.*):$", output_of("experiment", "--help"), flags=re.MULTILINE)
    found = dict(zip(sections[1::2], sections[2::2], strict=True))
    assert "--delay" in found["Network between two hosts, in lockstep"]
    assert "--executor" in found["Trials in parallel"]
    assert not re.search("--(delay|executor|rig) ", found["Options"])
    words = found["Arguments, each as key:=value"]
    assert "  Also as --key VALUE: rig, rate, grip, recording_rate.\n" in words


@pytest.mark.parametrize("width", [60, 90])
def test_help_is_as_wide_as_the_terminal(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    text, _ = output_of("teleop", "--help").split("Examples:")
    assert width - 10 < max(map(len, text.splitlines())) <= width


def command_of(words: Sequence[str]) -> click.Command:
    """Return the command that words call."""
    found: click.Command = command_line
    for word in words:
        assert isinstance(found, LazyGroup)
        below = found.get_command(click.Context(found), word)
        assert below, word
        found = below
    return found


@pytest.mark.parametrize("verb", list(every_verb()), ids=" ".join)
def test_every_verb_explains_itself_and_its_options(verb: tuple[str, ...]) -> None:
    shown = output_of(*verb, "--help")
    assert f"Usage: haptic-accel {' '.join(verb)} " in shown
    _, options = shown.split("\nOptions:\n")
    first = re.findall(r"^  -", options.partition("\n\n")[0], re.MULTILINE)
    for group in shown.split("Arguments, each as key:=value:\n")[1:]:
        own, *_ = re.split(r"\n\n(?=  \S|\S)", group.partition(":\n")[2] or group)
        first += re.findall(r"^    ?\w+ ", own, re.MULTILINE)
    assert 0 < len(first) <= 20, "no more words at once"
    command = command_of(verb)
    if isinstance(command, Verb) and any(isinstance(each, Words) for each in command.params):
        assert len(command.examples) == 3
    texts = [option.help for option in command.params if isinstance(option, click.Option)]
    for text in [command.help, *texts]:
        assert text
        assert text.strip().endswith(".")
        assert re.match(r"(?!Of|What|How|Whether|Who|Where|By how)[A-Z]", text), text


CHECKS: dict[str, Callable[..., object]] = {
    "teleop": lambda arguments, **_: graph(arguments),
    "identify": lambda arguments, **_: identification_graph(arguments),
    "experiment": lambda words, **_: graph(parse_arguments(words)),
    "design": lambda words, **_: graph(parse_arguments(words)),
    "bench latency": lambda words, **_: graph(parse_arguments(words)),
    "replay": lambda words, **_: replay_arguments(words),
    "analyze": lambda shift, **_: Shift.read(shift),
}
"""Checks that verbs make of their arguments before anything is started."""

argument_values = st.sampled_from(
    [
        *(text for text in ODD_TEXTS if "\0" not in text),  # which no argument can have
        *("1", "0", "-1", "2.5", "1e5", "1e999", "9" * 400),
        *("true", "False", "stop@1e3", "stop@nan"),
        *("paper", "text", "dynamic", "recording", "replay", "simulated", "auto", "1,2", "a:=b"),
        *(".", "..", "/dev/null", "/", "no.yaml", "a\nb", "\udcff"),
        *("x" * 300 + ".yaml", "x" * 5000),
        *("mine.yaml", "mine.csv", "mine.yaml/x.yaml"),
    ]
)


@st.composite
def command_lines(draw: st.DrawFn) -> tuple[str, ...]:
    """Draw words of the right form, with any value, and others."""
    verb = draw(st.sampled_from(VERBS))
    command = command_of(verb)
    keys = [key for each in command.params if isinstance(each, Words) for key in names(each)]
    flags = [flag for each in command.params for flag in each.opts if flag.startswith("-")]
    forms = [st.builds("{}={}".format, st.sampled_from(flags), argument_values)] if flags else []
    keyed = [st.builds("{}:={}".format, st.sampled_from(keys), argument_values)] if keys else []
    forms += keyed * 5
    forms += [argument_values, st.sampled_from([*flags, "--", "-", ":=", "status"])]
    return *verb, *draw(st.lists(st.one_of(forms), max_size=4))


def names(words: Words) -> list[str]:
    return [name for name, _, _ in words.describe()]


VERBS = [verb for verb in every_verb() if not isinstance(command_of(verb), LazyGroup)]


@pytest.fixture
def nobodys_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Use a ROS domain without nodes, as a stop acts before the command line is checked."""
    with reserved_domain() as number:
        use_domain(monkeypatch, number)
        yield


@pytest.mark.usefixtures("nobodys_domain")
@fuzz
@given(command_lines())
def test_any_arguments_are_taken_or_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch, here: Path, line: tuple[str, ...]
) -> None:
    (here / "mine.yaml").write_text("coupler: {ros__parameters: {k_m: 1}}")
    (here / "mine.csv").write_text("a\n1\n")
    for verb in VERBS:
        check = CHECKS.get(" ".join(verb), lambda **_: None)
        own = command_of(verb)
        monkeypatch.setattr(own, "callback", lambda check=check, **given: check(**given) and 0)
    written, shown = io.StringIO(), io.StringIO()
    with redirect_stderr(written), redirect_stdout(shown):
        status = status_of(*line)
    assert status == (2 if written.getvalue() else 0)
    assert len(written.getvalue().splitlines()) <= 1, written.getvalue()


def test_an_option_may_stand_for_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Any] = []
    command = command_of(["experiment"])
    monkeypatch.setattr(command, "callback", lambda words, **_: given.extend(words) or 0)
    assert status_of("experiment", "--recording-rate", "500", "seed:=1", "--rig", "ideal") == 0
    assert given == ["seed:=1", "rig:=ideal", "recording_rate:=500"]


@pytest.mark.parametrize(
    ("end", "status", "written"),
    [
        (KeyboardInterrupt(), 130, ""),
        (StoppedError("no such bag"), 1, "haptic-accel: no such bag"),
        (StoppedError(status=130), 130, ""),
        (ParameterError("rate = 0: must be 1"), 2, "haptic-accel: rate = 0: must be 1"),
    ],
)
def test_an_early_end_has_its_status_and_its_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    end: BaseException,
    status: int,
    written: str,
) -> None:
    def run(**_: Any) -> int:
        raise end

    monkeypatch.setattr(command_of(["bag", "info"]), "callback", run)
    assert status_of("bag", "info", "there") == status
    assert capsys.readouterr().err.strip() == written


def test_the_version_is_the_package_s() -> None:
    assert output_of("--version") == f"haptic-accel {__version__}\n"


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        ("tel", "teleop"),
        ("bench lat", "latency"),
        ("experiment --lock", "--lockstep"),
        ("teleop contr", "controller:="),
        ("teleop --json x controller:=inv", "controller:=inverse"),
        ("replay samp", "sampling_rate:="),
    ],
)
def test_shells_complete_verbs_options_and_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], typed: str, found: str
) -> None:
    monkeypatch.setenv("_HAPTIC_ACCEL_COMPLETE", "zsh_complete")
    monkeypatch.setenv("COMP_WORDS", f"haptic-accel {typed}")
    monkeypatch.setenv("COMP_CWORD", str(len(typed.split())))
    assert status_of() == 0
    assert capsys.readouterr().out.splitlines()[1::3] == [found]


@pytest.mark.parametrize("words", ["--help", "estop --help", "--version", "analyze nowhere"])
def test_it_starts_without_what_computes_and_draws(words: str) -> None:
    code = (
        "import sys; from haptic_accel.cli.main import main\n"
        f"try: main({words.split()})\n"
        "except SystemExit: pass\n"
        "print(*{'numpy', 'scipy', 'rich', 'yaml', 'rclpy'} & {*sys.modules})"
    )
    assert python("-c", code, check=True).stdout.splitlines()[-1] == ""


def limited(limit: str, *words: object, output: str = "/dev/null") -> tuple[int, str]:
    """Run ``haptic-accel WORDS`` in a shell after a command that takes something from it.

    Returns its exit status and what it wrote to stderr.
    """
    command = shlex.join([*module_command("haptic_accel.cli.main"), *map(str, words)])
    words = ["bash", "-c", f"{limit}; exec {command} > {output}"]
    done = subprocess.run(words, stderr=subprocess.PIPE, text=True)
    return done.returncode, done.stderr


INTERRUPTING = """
import os, signal, sys
class Interrupting:
    def find_spec(self, name, *_):
        if name == MODULE:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting())
from haptic_accel.cli.start import main
sys.argv += "analyze nowhere".split()
main()
"""


OWN = [f"haptic_accel.{name}" for name in ("cli.main", "cli.commands", "bags")]


@pytest.mark.parametrize("module", [*OWN, "click"])
@pytest.mark.parametrize(("ignored", "status"), [(False, 130), (True, 2)])
def test_an_interrupt_during_an_import_is_quiet_unless_a_script_ignores_it(
    module: str, ignored: bool, status: int
) -> None:
    code = INTERRUPTING.replace("MODULE", repr(module))
    handling = signal.SIG_IGN if ignored else signal.SIG_DFL
    done = subprocess.run(
        [sys.executable, "-c", code],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, handling),
    )
    assert done.returncode == status, done.stderr
    # Below the terminal's ^C a verb begins a new line.
    assert len(done.stderr.split()) > 0 if ignored else done.stderr in ("", "\n")
    assert "Traceback" not in done.stderr


SHORT = ("surface:=text", "duration:=1", "--controllers", "none", "--out", "results")
SOME_VERBS = [["bag", "info", DATA / "text"], ["experiment", "--lockstep", *SHORT]]


@pytest.mark.parametrize("words", [["--help"], SOME_VERBS[0]], ids=lambda words: words[0])
def test_output_that_cannot_be_written_is_named_in_one_line(
    here: Path, words: list[object]
) -> None:
    said = "haptic-accel: output: No space left on device\n"
    assert limited("true", *words, output="/dev/full") == (1, said)


# An experiment analyses its bags and writes the report as `analyze` does.
@pytest.mark.parametrize("words", rest_slow(SOME_VERBS), ids=lambda words: words[0])
# With less memory, pyarrow, which pandas imports if it is installed, waits for ever.
@pytest.mark.parametrize("limit", ["unset HOME", "ulimit -n 10", "ulimit -v 500000"])
def test_a_machine_short_of_something_is_answered_in_one_line(
    here: Path, limit: str, words: list[object]
) -> None:
    status, said = limited(limit, *words)
    assert (status, said) == (0, "") or (
        (status, said.count("\n")) == (1, 1) and said.startswith("haptic-accel: too ")
    )
    if limit == "unset HOME":
        assert status == 0


@pytest.mark.parametrize("setting", rest_slow(["LC_ALL=C PYTHONUTF8=0", "PYTHONIOENCODING=ascii"]))
def test_what_the_terminal_cannot_show_is_replaced(here: Path, setting: str) -> None:
    words = ["analyze", DATA / "text", "--out", "report"]
    assert limited(f"export PYTHONCOERCECLOCALE=0 {setting}", *words, output="shown") == (0, "")
    shown = (here / "shown").read_bytes()
    assert rb"R\xb2" in shown, "the square of the correlation"
    assert shown.isascii()


@pytest.mark.slow
def test_a_report_is_complete_without_a_reader(here: Path) -> None:
    words = ["analyze", DATA / "text", "--json", "found.json", "--out"]
    assert status_of(*words, "read") == 0
    before = (here / "found.json").read_text()
    files = {each.name for each in (here / "read").iterdir()}
    ends = {">(head -1 > /dev/null)": (0, ""), "/dev/full": (1, "No space left on device")}
    for number, (output, end) in enumerate(ends.items()):
        status, said = limited("true", *words, f"unread{number}", output=output)
        assert (status, said.strip().rpartition(": ")[2]) == end
        assert (here / "found.json").read_text() == before
        assert {each.name for each in (here / f"unread{number}").iterdir()} == files


def test_a_reader_that_has_gone_is_no_error_to_tell(here: Path) -> None:
    status, said = limited("true", "teleop", "--help", output=">(true)")
    assert said == ""
    assert status in (0, 1), "as quick as the reader, or not"
