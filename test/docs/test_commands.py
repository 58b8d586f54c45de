# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands that the documentation shows: what runs as printed, and what they name exists."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from shutil import copytree

import click
import pytest
from matplotlib import pyplot

from bag_maker import of_trial, write_bag
from haptic_accel.cli.commands import LazyGroup, command_line
from haptic_accel.cli.options import Verb, Words
from haptic_accel.core.parameters import Checked, schema
from haptic_accel.core.topics import TOPICS
from haptic_accel.core.trial import run_trial
from haptic_accel.setup.files import read_parameter_file
from haptic_accel.setup.node_parameters import node_schema
from haptic_accel.setup.words import parse_assignments
from nightly import rest_slow
from verbs import status_of

SOURCE = Path(__file__).resolve().parents[2]
DATA = SOURCE / "test" / "data"
FOLDERS = (SOURCE / "docs", SOURCE / "haptic_accel")
PAGES = sorted([*SOURCE.glob("*.md"), *(page for each in FOLDERS for page in each.rglob("*.md"))])

FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`([^`]+)`")
PLACEHOLDER = re.compile(r"[A-Z]+")
"""Text that stands in a sentence for a name that the reader chooses."""

OUTSIDE = ("cd", "colcon", "pip", "rosdep", "rqt", "rviz2", "scp", "source", "sudo")
"""Other programs in blocks of commands."""

QUICK = ("analyze", "bag", "design", "replay")
"""Verbs that compute for a second or two; the others start a graph, or take long."""

MAKING_RIGS = ("bringup", "calibrate", "emulate")
GRAPH = (*MAKING_RIGS, "control", "estop", "record", "scope", "teleop", "touch")
"""Verbs that need a graph, a device or a browser."""

LOCKSTEP = ("experiment", "identify", "replay")
"""Verbs that need a graph, unless ``--lockstep`` is given."""


def name_of(page: Path) -> str:
    return str(page.relative_to(SOURCE))


def tutorials() -> list[Path]:
    """Return the pages of the index's section of tutorials."""
    index = (SOURCE / "docs" / "README.md").read_text()
    section = index.split("## Tutorials\n")[1].split("\n## ")[0]
    return [SOURCE / "docs" / name for name in re.findall(r"\]\((\w+\.md)\)", section)]


def blocks(page: Path) -> Iterator[str]:
    """Yield each line of a page's blocks of commands."""
    for language, block in FENCE.findall(page.read_text()):
        if language in ("", "bash"):
            yield from block.splitlines()


def split(line: str) -> list[list[str]]:
    """Return the words of a line's commands, which a shell runs one after the other."""
    reader = shlex.shlex(line, posix=True, punctuation_chars=True)
    reader.whitespace_split = True
    found: list[list[str]] = [[]]
    for word in reader:
        if word == "&&":
            found.append([])
        else:
            found[-1].append(word)
    return [words for words in found if words]


def in_blocks(page: Path) -> list[list[str]]:
    """Return the words of every command in a page's blocks."""
    return [words for line in blocks(page) for words in split(line)]


def in_sentences(page: Path) -> list[list[str]]:
    """Return the words of every command in a page's sentences."""
    spans = INLINE.findall(FENCE.sub("", page.read_text()))
    return [shlex.split(span) for span in spans if re.match(r"(haptic-accel|make|ros2)\s", span)]


def check(words: Sequence[str]) -> None:
    """Check a command, which must be of a kind that the documentation may show."""
    assert not any(re.fullmatch("[<>|;&()]+", word) for word in words), f"{words} is for the shell"
    program, *rest = words
    if program == "haptic-accel":
        check_verb(rest)
    elif program == "ros2":
        check_ros2(rest)
    elif program == "make":
        check_make(rest)
    elif program == "python":
        assert (SOURCE / rest[0]).is_file(), rest[0]
    elif program == ".":
        assert rest == [".venv/bin/activate"]
    else:
        assert program in OUTSIDE, words


def check_verb(words: Sequence[str]) -> None:
    """Have a verb's own parser read its command line, without running it."""
    command: click.Command = command_line
    name, rest = "haptic-accel", list(words)
    while isinstance(command, LazyGroup) and rest and re.match("[a-z]", rest[0]):
        found = command.resolve_command(click.Context(command), rest)
        assert found[0]
        assert found[1]
        name, command, rest = found[0], found[1], found[2]
    if isinstance(command, LazyGroup) or not rest:  # options of all verbs, or a verb that is named
        return
    try:
        given = command.make_context(name, rest).params
    except click.exceptions.Exit:  # of --help
        return
    for parameter in command.params:
        if isinstance(parameter, Words):
            check_words(parameter, given[str(parameter.name)])


def check_words(declared: Words, words: Sequence[str]) -> None:
    """Read the ``key:=value`` words as the verb would."""
    known = [name for name, _, _ in declared.describe()]
    read: dict[type[Checked], list[str]] = {}
    for word in words:
        key, given, value = word.partition(":=")
        if not given:
            continue
        assert key in known, word
        kind = next(kind for kind in declared.kinds if key in schema(kind))
        default, specification = schema(kind)[key]
        if key == "params_file":  # a file of the reader's, which would be read
            continue
        any_text = isinstance(default, str) and not specification.choices
        if any_text or not PLACEHOLDER.fullmatch(value):
            read.setdefault(kind, []).append(word)
    for kind, read_by_it in read.items():
        parse_assignments(read_by_it, kind)


def words_of(verb: str) -> Words:
    """Return the declaration of a verb's words."""
    command = command_line.get_command(click.Context(command_line), verb)
    assert command
    return next(each for each in command.params if isinstance(each, Words))


def check_make(words: Sequence[str]) -> None:
    targets = re.findall(r"^([a-z-]+):.*## ", (SOURCE / "Makefile").read_text(), re.MULTILINE)
    variables = re.findall(r"^([A-Z]+) \?=", (SOURCE / "Makefile").read_text(), re.MULTILINE)
    for word in words:
        assert word.partition("=")[0] in (variables if "=" in word else targets), word


def check_ros2(words: Sequence[str]) -> None:
    """Check what a command of ROS 2 names, if it is of this package."""
    match list(words):
        case ["launch", "haptic_accel", file, *rest]:
            assert (SOURCE / "launch" / file).is_file(), file
            check_words(words_of(file.partition(".")[0]), rest)
        case ["run", "haptic_accel", "haptic-accel", *rest]:
            check_verb(rest)
        case ["run", "haptic_accel", node, *rest]:
            assert (SOURCE / "haptic_accel" / "nodes" / f"{node}.py").is_file(), node
            given = [word.partition(":=")[0] for word in rest if ":=" in word]
            assert not given or set(given) <= set(node_schema(node)), given
        case ["param", "set" | "get" | "describe", node, *rest]:
            assert node_schema(node[1:]).keys() >= set(rest[:1]), (node, rest)
        case ["param", "load", node, file]:
            assert read_parameter_file(SOURCE / file)[node[1:]], (node, file)
        case ["service", "call", name, kind, *_]:
            assert services()[name[1:]] == kind.replace("/srv/", "/")
        case ["topic", "echo" | "hz", *_, name]:
            assert name.removeprefix("/") in [topic.name.removeprefix("/") for topic in TOPICS]
        case ["topic", "pub", "--once", name, kind, _]:
            assert (name[1:], kind) in [(topic.name, topic.type) for topic in TOPICS]
        case ["lifecycle", "get", node]:
            assert node in ("/master_device", "/slave_device")
        case ["lifecycle", "set", node, transition]:
            assert node in ("/master_device", "/slave_device")
            assert transition in ("configure", "cleanup", "activate", "deactivate", "shutdown")
        case ["bag" | "launch" | "run", what, _, *_]:
            assert what != "haptic_accel", words
        case [_, _, _, *_]:  # fewer only name a command
            raise AssertionError(f"no check for {words}")


def services() -> dict[str, str]:
    """Return type by name of the services in the table of the documentation."""
    page = (SOURCE / "docs" / "ros2.md").read_text()
    section = page.split("### Services\n")[1].split("\n### ")[0]
    rows = re.findall(r"^\| (.*?) \| `(.*?)` \|", section, re.MULTILINE)
    return {name: kind for names, kind in rows for name in re.findall(r"`([^`]+)`", names)}


@pytest.fixture
def rig_file(here: Path) -> None:
    """Work in a folder with the file that a command updates."""
    (here / "rig.yaml").write_text("")


@pytest.mark.usefixtures("rig_file")
@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_what_a_page_tells_to_type_is_accepted(page: Path) -> None:
    for words in [*in_blocks(page), *in_sentences(page)]:
        check(words)


def every_verb(group: LazyGroup) -> Iterator[click.Command]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command
        yield command
        if isinstance(command, LazyGroup):
            yield from every_verb(command)


VERBS = [command_line, *every_verb(command_line)]


@pytest.mark.usefixtures("rig_file")
@pytest.mark.parametrize("command", VERBS, ids=lambda command: command.name)
def test_the_examples_in_the_help_are_accepted(command: Verb | LazyGroup) -> None:
    for example in command.examples:
        check(shlex.split(example))


def test_every_verb_that_the_program_names_exists() -> None:
    patterns = ("**/*.py", "pages/**/*.j2", "pages/**/*.js")
    for path in (path for each in patterns for path in (SOURCE / "haptic_accel").glob(each)):
        named = re.findall(r"haptic-accel ([a-z]+)(?: ([a-z][a-z-]*))?", path.read_text())
        for verb, kind in named:
            assert verb in command_line.verbs, (path, verb)
            below = command_line.groups
            assert not (kind and verb in below) or kind in below[verb].verbs


def is_run(words: Sequence[str]) -> bool:
    """Return whether a command of a block is run here: quick, and without a graph."""
    program, verb, *rest = [*words, "", ""]
    quick = program == "haptic-accel" and verb in QUICK
    return quick and (verb != "replay" or "--lockstep" in rest)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the pages' commands take for there."""
    folder = tmp_path_factory.mktemp("recorded")
    made = ["--lockstep", "--controllers", "dynamic,inverse", "--out", folder / "bags"]
    assert status_of("replay", DATA / "text", *made) == 0
    for name in ("before", "after", "desk", "robot", "results/today/bags"):
        copytree(folder / "bags", folder / name)
    copytree(DATA / "text", folder / "bags" / "first")
    foreign = of_trial(run_trial(duration=3.0))
    foreign.metadata.clear()
    write_bag(folder / "foreign", foreign)
    return folder


RUN = [p for p in PAGES if p not in tutorials() and any(map(is_run, in_blocks(p)))]


@pytest.mark.parametrize("page", rest_slow(RUN), ids=name_of)
def test_what_a_page_tells_to_type_runs(page: Path, recorded: Path, here: Path) -> None:
    copytree(recorded, here, dirs_exist_ok=True)
    for words in filter(is_run, in_blocks(page)):
        found = [sorted(map(str, Path().glob(word))) or [word] for word in words[1:]]
        assert status_of(*[name for names in found for name in names]) == 0, words


def needs_a_graph(words: Sequence[str]) -> bool:
    """Return whether a command of a tutorial cannot run here."""
    program, verb, *rest = [*words, ""]
    lockstep = verb not in LOCKSTEP or "--lockstep" in rest
    return program != "haptic-accel" or verb in GRAPH or not lockstep


@pytest.mark.parametrize("page", tutorials(), ids=name_of)
@pytest.mark.slow
def test_a_tutorial_runs_from_its_first_line_to_its_last(
    page: Path, recorded: Path, here: Path
) -> None:
    """Bags stand for those that a graph would record; a file begins with its name as a comment."""
    copytree(recorded, here, dirs_exist_ok=True)
    pyplot.switch_backend("agg")
    for language, block in FENCE.findall(page.read_text()):
        if language == "python":
            exec(block, {})
        elif file := re.match(r"# (\w+\.yaml)\n", block):
            Path(file[1]).write_text(block)
        elif language in ("", "bash"):
            for words in (words for line in block.splitlines() for words in split(line)):
                assert needs_a_graph(words) or status_of(*words[1:]) == 0, words
    pyplot.close("all")


def test_the_readme_says_how_to_reach_the_command_before_it_shows_one() -> None:
    blocks = in_blocks(SOURCE / "README.md")
    first = next(i for i, words in enumerate(blocks) if words[0] == "haptic-accel")
    assert [".", ".venv/bin/activate"] in in_blocks(SOURCE / "README.md")[:first]
