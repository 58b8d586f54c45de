# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lines for a terminal: what it would obey is escaped, wherever it comes from."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stdout

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from fuzzing import fuzz
from haptic_accel.cli.output import printable_output
from haptic_accel.cli.tables import print_table
from haptic_accel.core.parameters import ParameterError, printable
from haptic_accel.core.tables import ResultTable

HOSTILE = "\x1b]0;title\x07\x1b[2J\x9b31m\u202egnp.exe\u2066\r\udcff"
ESCAPED = r"\x1b]0;title\x07\x1b[2J\x9b31m\u202egnp.exe\u2066\r\udcff"


def test_what_a_terminal_would_obey_is_escaped() -> None:
    assert printable(HOSTILE) == ESCAPED
    assert printable("m/s² ± 1 µs, 日本 \\n") == "m/s² ± 1 µs, 日本 \\n"
    assert printable("a\nb\tc") == r"a\nb\tc"
    assert printable("a\nb\tc", "\n") == "a\nb\\tc"
    assert str(ParameterError(f"{HOSTILE}\n: must be text")) == rf"{ESCAPED}\n: must be text"


@fuzz
@given(st.text())
def test_any_text_becomes_printable_and_stays_what_it_is(text: str) -> None:
    assert printable(text).isprintable()
    assert printable(printable(text)) == printable(text)


def test_prints_are_escaped_until_the_end_of_a_command() -> None:
    written = io.StringIO()
    with redirect_stdout(written):
        before = sys.stdout
        with printable_output(), printable_output():
            assert sys.stdout is before
            print(HOSTILE, "µ", end="\n\tindented\n", flush=True)
        print("\x1b[0m", end="")
    assert written.getvalue() == f"{ESCAPED} µ\n\tindented\n\x1b[0m"


@pytest.mark.parametrize("width", [20, 30, 45, 60, 80, 200])
def test_no_terminal_is_too_narrow_for_the_numbers_of_a_table(
    width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    cells = ["66.7 [65.1, 68.2] (69.8)", "77.2 (80.6)", "\N{MINUS SIGN}10.42", "1234567"]
    headings = ["controller", "plywood", "text", "slope, desired on actual", "messages"]
    written = io.StringIO()
    with redirect_stdout(written):
        print_table(ResultTable(headings, [["constant", *cells], ["/a/long/name", *cells]], "II"))
    lines = written.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    for cell in cells:
        for number in cell.split():
            assert sum(line.split().count(number) for line in lines) == 2, number


def test_a_table_has_colours_of_its_own_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("NO_COLOR", raising=False)
    written = io.StringIO()
    with redirect_stdout(written), printable_output():
        print_table(ResultTable(["name"], [[HOSTILE], ["[bold]/a[/]"], ["[/]"]]))
        Console(force_terminal=True).print("[bold]red[/bold]")
    text = written.getvalue()
    assert ESCAPED in text
    assert "[bold]/a[/]" in text
    assert "\x1b[1mred" in text
    assert HOSTILE not in text
