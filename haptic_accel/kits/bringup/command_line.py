# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""``haptic-accel bringup``: five steps from unknown boards to a compensated handle."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import click
import numpy as np

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.output import StoppedError, next_command
from haptic_accel.cli.running import HOST, interrupted_by_signals, print_line, show_page
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import DONE, WRONG_ARGUMENTS
from haptic_accel.kits.bringup.bench import STEPS, BringUpArguments, BringUpError, Watched
from haptic_accel.kits.bringup.steps import BringUp

if TYPE_CHECKING:
    from haptic_accel.kits.bringup.guide import Guide

DISPLAY_PERIOD = 0.2
"""Interval between two pictures of the live signal, s: as fast as numbers can be read."""

SHOWN = 0.5
"""Duration of the signal in a picture, s."""

BAR, FULL = 40, 20.0
"""Width of the bar in characters, and the acceleration of a full one, m/s^2."""


@verb(
    "haptic-accel bringup ports:=/dev/ttyACM0,/dev/ttyACM1 force_constant:=2.4",
    "haptic-accel bringup file:=rig.yaml redo:=identify",
    "haptic-accel bringup --page",
)
@click.option("--page", is_flag=True, help="Ask and show on a page in the browser.")
@arguments(BringUpArguments)
def bringup(arguments: BringUpArguments, page: bool) -> None:
    """Bring up a rig in five steps: connect, calibrate, make safe, identify, prove.

    Each step shows the live signal, measures, and says what to do where it does not pass. Writes
    one parameter file with devices, ports, calibration and handle; the same command goes on with
    the unfinished step. With --page, a page in the browser asks and shows, and the terminal has
    the same lines.
    """
    with interrupted_by_signals(), _Terminal() as terminal:
        if page:
            _bring_up_on_page(arguments, terminal)
        else:
            _bring_up(BringUp(arguments, terminal), arguments.file)


def _bring_up(rig: BringUp, file: str) -> str:
    """Bring up a rig; print and return the line with the next command."""
    try:
        following = next_command(*rig.run())
    except BringUpError as error:
        raise StoppedError(str(error)) from None
    except EOFError:
        raise StoppedError("the input ended; run the same command to continue from here") from None
    print_line(f"parameters: {file}")
    print_line(following)
    return following


def _bring_up_on_page(arguments: BringUpArguments, terminal: _Terminal) -> None:
    """Bring up a rig at a page, which is served until it or Ctrl-C closes the bring-up."""
    # The server takes longer to import than a bring-up at the terminal takes to begin.
    from haptic_accel.kits.bringup.guide import Guide
    from haptic_accel.scope.access import Access
    from haptic_accel.scope.server import ScopeServer

    guide = Guide(STEPS)
    rig = BringUp(arguments, _Both(terminal, guide))
    server = ScopeServer(guide, Access(HOST, ""), HOST, 0, guide.act, "bring_up")
    show_page(server.start())
    try:
        try:
            line, status = _bring_up(rig, arguments.file), DONE
        except (StoppedError, ParameterError) as error:
            line = str(error)
            status = error.status if isinstance(error, StoppedError) else WRONG_ARGUMENTS
            terminal.show(None)
            terminal.tell(line)
        with suppress(KeyboardInterrupt):
            guide.end(line, done=status == DONE)
    finally:
        server.stop()
    if status != DONE:
        raise StoppedError(status=status)


class _Both:
    """Person at a page; a terminal shows the same lines."""

    def __init__(self, terminal: _Terminal, guide: Guide) -> None:
        self._terminal, self._guide = terminal, guide

    def begin(self, number: int, step: str, purpose: str) -> None:
        self._terminal.begin(number, step, purpose)
        self._guide.begin(number, step, purpose)

    def tell(self, line: str) -> None:
        self._terminal.tell(line)
        self._guide.tell(line)

    def show(self, watched: Watched | None) -> None:
        self._terminal.show(watched)
        self._guide.show(watched)

    def ask(self, request: str, skip: str = "") -> str:
        self._terminal.request(request)
        return self._guide.ask(request, skip)

    def request(self, line: str) -> None:
        self._terminal.request(line)
        self._guide.request(line)


class _Terminal:
    """Person at a terminal."""

    def __init__(self) -> None:
        self._watched: Watched | None = None
        self._over = threading.Event()
        self._writing = threading.Lock()
        self._is_drawn = False
        self._thread = threading.Thread(target=self._draw, name="live signal", daemon=True)

    def __enter__(self) -> _Terminal:
        if sys.stdout.isatty():
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    def begin(self, number: int, step: str, purpose: str) -> None:
        self.tell("")
        self.tell(f"{number} of {len(STEPS)}, {step}: {purpose}")

    def tell(self, line: str) -> None:
        with self._above():
            print_line(line)

    def show(self, watched: Watched | None) -> None:
        with self._above():
            self._watched = watched

    def ask(self, request: str, skip: str = "") -> str:
        self.tell(f"> {request}")
        line = sys.stdin.readline()
        if not line:
            raise EOFError
        return line

    def request(self, line: str) -> None:
        self.tell(f"> {line}")

    @contextmanager
    def _above(self) -> Iterator[None]:
        """Write lines above the live signal."""
        with self._writing:
            if self._is_drawn:
                sys.stdout.write("\r\x1b[K")
                self._is_drawn = False
            yield

    def _draw(self) -> None:
        while not self._over.wait(DISPLAY_PERIOD):
            with self._writing:
                if self._watched:
                    sys.stdout.write(f"\r{_picture(self._watched)}\x1b[K")
                    sys.stdout.flush()
                    self._is_drawn = True


def _picture(watched: Watched) -> str:
    """Return the last samples of a signal as a bar with numbers."""
    signal = watched.last(SHOWN).acceleration
    there = signal[~np.isnan(signal)]
    if not len(there):
        return "  no samples"
    mean, peak = float(there.mean()), float(np.ptp(there)) / 2
    bar = "#" * min(BAR, round(BAR * peak / FULL))
    return (
        f"  |{bar:{BAR}}| vibration {peak:6.2f} m/s^2, mean {mean:7.2f} m/s^2,"
        f" {len(signal) - len(there)} of {len(signal)} missing"
    )
