# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command-line verbs, run in this process."""

from __future__ import annotations

import io
import re
import shlex
import subprocess
from contextlib import redirect_stderr, redirect_stdout

import click

from haptic_accel.cli.commands import command_line
from haptic_accel.cli.main import main
from haptic_accel.cli.options import Words
from haptic_accel.core.identification.fit import DEFAULT_FREE
from haptic_accel.setup.words import parse_assignments

WITHOUT_FRICTION = ("--free", ",".join(DEFAULT_FREE))
"""Words for an identification without dry friction, whose fit takes ten times as long."""


ODD_NAMES = ('a#b?c%20d, grip=hook it\'s "$x" `y` a:=b', "caf\udce9")
"""Names of folders; the last one is Latin-1, hence no UTF-8."""


def status_of(*words: object) -> int:
    """Run ``haptic-accel WORDS`` and return its exit status."""
    try:
        main([str(word) for word in words])
    except SystemExit as end:
        assert isinstance(end.code, int)
        return end.code
    raise AssertionError("the command did not exit")


def output_of(*words: object, status: int = 0) -> str:
    """Run a command that ends with a status, and return what it writes to stdout."""
    written = io.StringIO()
    with redirect_stdout(written):
        ended = status_of(*words)
    assert ended == status, written.getvalue()
    return written.getvalue()


def next_command(text: str) -> list[str]:
    """Return verb and words of the last command that a verb's output advises.

    They are parsed as the program would parse them.
    """
    line = [line for line in text.splitlines() if line.startswith("next")][-1]
    program, *words = shlex.split(line.partition(": ")[2])
    assert program == "haptic-accel"
    command: click.Command | None = command_line
    rest = words
    while isinstance(command, click.Group):
        _, command, rest = command.resolve_command(click.Context(command), rest)
    assert command
    given = command.make_context(command.name, rest).params
    for each in command.params:
        if isinstance(each, Words):
            parse_assignments(given[each.name or ""], *each.kinds)
    return words


def next_words(text: str) -> list[bytes]:
    """Return the words of the last command that a text advises, as Bash splits them."""
    line = [line for line in text.splitlines() if line.startswith("next")][-1]
    command = line.partition(": haptic-accel ")[2]
    done = subprocess.run(["bash", "-c", rf"printf '%s\0' {command}"], stdout=subprocess.PIPE)
    return done.stdout.split(b"\0")[:-1]


def refusal(*words: object, status: int = 2) -> str:
    """Run a command that is refused, or fails with a status; return its one-line message."""
    written = io.StringIO()
    with redirect_stderr(written):
        ended = status_of(*words)
    text = written.getvalue()
    assert ended == status, text
    (line,) = text.splitlines()
    command, _, message = line.partition(": ")
    assert command == "haptic-accel"
    return message


def tells(line: str, words: str) -> bool:
    """Return whether a line is the words, in which ``...`` stands for any text."""
    return bool(re.fullmatch(".*".join(map(re.escape, words.split("..."))), line))
