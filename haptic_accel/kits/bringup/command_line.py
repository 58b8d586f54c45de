# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel bringup``: five steps from unknown boards to a compensated handle.

Each step measures, checks the result, and gives advice.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from haptic_accel import ParameterError, commands
from haptic_accel.bags import AGE_OF
from haptic_accel.core.process import FULL_SCALE, UNUSABLE, WRONG_ARGUMENTS
from haptic_accel.core.topics import ARMS
from haptic_accel.devices import DeviceError
from haptic_accel.kits.bringup import bench as benches
from haptic_accel.kits.bringup import signal_checks as checks
from haptic_accel.kits.bringup.boards import calibrate_boards, connect, make_safe
from haptic_accel.setup import note_step, noted_steps, teleop_command, update_parameter_file

TRIAL = 10
"""Duration of a trial with a controller, s, as in the paper."""

TIMED = "master_device", "slave_device", "coupler", "compensator"
"""Nodes that share the latency of the graph."""

MOST_LATENCY = 4
"""Largest latency that the step `prove` sets, samples. Each sample increases the lowest possible
error (`bound`); if more are needed, the machine is too slow for the rate."""

MOST_LATE = 1.0
"""Share of late forces above which the latency is increased, %: an experiment warns above it."""


def identify(bench: benches.Bench) -> None:
    """Identify the handle; scale the force of a sound card by its mass."""
    if bench.device_name(benches.MASTER) in benches.ARMS_ALONE:
        return
    if scale := _identified(bench).get(FULL_SCALE):
        mass = bench.number("type the mass of all that moves with the handle, without m_a, kg")
        full_scale = {"audio": {"full_scale": float(f"{scale['value'] * mass:.4g}")}}
        update_parameter_file(bench.path, {"master_device": full_scale})
        bench.person.tell("force scale found: repeat the identification with forces in N")
        _identified(bench)
    bench.notes.append("the model is in this file")


def _identified(bench: benches.Bench) -> Mapping[str, Mapping[str, Any]]:
    """Identify the handle; return the events."""
    bench.goes_on("hold the handle as in use, without moving it, then press Enter")
    words = ["params_file:=" + str(bench.path), "--update", str(bench.path)]
    while True:
        out = bench.report_folder("identify")
        ran = bench.command("identify", *words, "--out", str(out))
        if ran.status == 0:
            bench.keep(out)
            return ran.events
        reason = ran.events.get(UNUSABLE, {}).get("reason", ran.last)
        if not bench.goes_on(f"{reason}; press Enter to try again", skip="stop"):
            raise benches.BringUpError(reason)


def prove(bench: benches.Bench) -> None:
    """Compare the errors without and with compensation on a surface."""
    if not {bench.device_name(side) for side in ARMS}.isdisjoint(benches.ARMS_ALONE):
        bench.settle(lambda: [checks.Check(True, "no accelerometer on both arms: not compared")])
        return
    bench.goes_on(
        f"take the handle, and stroke the surface once the arms engage, {TRIAL} s without"
        f" and {TRIAL} s with compensation; press Enter to begin"
    )
    bench.settle(lambda: _compared(bench))


def _compared(bench: benches.Bench) -> list[checks.Check]:
    """Run the graph without compensation and with `adaptive`, and compare the errors."""
    out = bench.report_folder("prove")
    results = out.with_suffix(".json")
    out.parent.mkdir(parents=True, exist_ok=True)
    ran = bench.command(
        *("experiment", "--controllers", "none,adaptive"),
        *(f"params_file:={bench.path}", "surface:=plywood", f"duration:={TRIAL}"),
        *("--out", str(out), "--json", str(results)),
    )
    if ran.status:
        return [checks.Check(False, ran.last, "haptic-accel doctor checks the machine")]
    bench.keep(out)
    conditions = json.loads(results.read_text(encoding="utf-8"))["conditions"]
    none, adaptive = sorted(conditions, key=lambda each: each["controller"], reverse=True)
    without, error = none["nrmse_percent"], adaptive["nrmse_percent"]
    if without is None or error is None:
        advice = "press the tool on the surface, and stroke along it during both trials"
        return [checks.Check(False, "the tool touched nothing", advice)]
    least = adaptive["limited_bound_percent"]
    late = max(_late_percent(each) for each in conditions)
    if late > MOST_LATE:
        told = f"{late:.1f} % of the actuator forces took effect late"
        in_time = checks.Check(False, told, _more_time(bench))
    else:
        in_time = checks.Check(True, "forces in time")
    return [in_time, checks.proof_check(without, error, least or 0.0)]


def _late_percent(condition: Mapping[str, Any]) -> float:
    """Return the share of a condition's actuator forces that took effect late, %."""
    counts = condition["missed_deadlines"].get(AGE_OF, {"due": 0, "missed": 0})
    late: float = counts["missed"] / max(1, counts["due"])
    return 100.0 * late


def _more_time(bench: benches.Bench) -> str:
    """Increase the latency by one sample if useful; return a line on the change."""
    latency = bench.parameters(benches.MASTER)[0].latency + 1
    if latency > MOST_LATENCY:
        return "close other programs, and run haptic-accel doctor"
    update_parameter_file(bench.path, {node: {"latency": latency} for node in TIMED})
    return f"forces have {latency} samples of time from now on; measure again"


_FUNCTIONS = connect, calibrate_boards, make_safe, identify, prove


class BringUp:
    """Bring-up of a rig.

    Parameters
    ----------
    arguments : BringUpArguments
    person : Person

    Raises
    ------
    ParameterError
        The rig's file cannot be read or written, or an argument contradicts it.
    """

    def __init__(self, arguments: benches.BringUpArguments, person: benches.Person) -> None:
        self._bench = benches.Bench(arguments, person)
        noted = noted_steps(self._bench.path)
        self._done = dict[str, str]()
        for step in benches.STEPS:
            if step not in noted or step == arguments.redo:
                break
            self._done[step] = noted[step]

    def run(self) -> list[str]:
        """Run the remaining steps; return the arguments of the next command.

        Raises
        ------
        BringUpError
            A step cannot be completed.
        EOFError
            The user does not answer; the same command continues at the unfinished step.
        """
        bench = self._bench
        steps = zip(benches.STEPS.items(), _FUNCTIONS, strict=True)
        for number, ((step, purpose), function) in enumerate(steps, start=1):
            bench.person.begin(number, step.replace("_", " "), purpose)
            if step in self._done:
                bench.person.tell(f"done {self._done[step]}")
                continue
            bench.notes.clear()
            try:
                function(bench)
            except DeviceError as error:
                raise benches.BringUpError(str(error)) from None
            bench.person.show(None)
            text = "; ".join(bench.notes) or "nothing to do"
            note_step(bench.path, step, f"{datetime.now():%Y-%m-%d %H:%M}: {text}")
        return teleop_command("", bench.path, "controller:=adaptive")


if TYPE_CHECKING:
    from haptic_accel.kits.bringup.guide import Guide

DISPLAY_PERIOD = 0.2
"""Interval between updates of the live signal, s: as fast as numbers can be read."""

SHOWN = 0.5
"""Duration of the displayed signal, s."""

BAR, FULL = 40, 20.0
"""Width of the bar in characters, and the acceleration of a full one, m/s^2."""


@commands.verb(
    "haptic-accel bringup ports:=/dev/ttyACM0,/dev/ttyACM1 force_constant:=2.4",
    "haptic-accel bringup file:=rig.yaml redo:=identify",
    "haptic-accel bringup --page",
)
@click.option("--page", is_flag=True, help="Ask and show on a page in the browser.")
@commands.arguments(benches.BringUpArguments)
def bringup(arguments: benches.BringUpArguments, page: bool) -> None:
    """Bring up a rig in five steps: connect, calibrate, make safe, identify, prove.

    Each step shows the live signal, measures, and says what to do where it does not pass. Writes
    one parameter file with devices, ports, calibration and handle; the same command goes on with
    the unfinished step. With --page, a page in the browser asks and shows, and the terminal has
    the same lines.
    """
    with commands.interrupted_by_signals(), _Terminal() as terminal:
        if page:
            _bring_up_on_page(arguments, terminal)
        else:
            _bring_up(BringUp(arguments, terminal), arguments.file)


def _bring_up(rig: BringUp, file: str) -> str:
    """Bring up a rig; print and return the line with the next command."""
    try:
        following = commands.next_command(*rig.run())
    except benches.BringUpError as error:
        raise commands.StoppedError(str(error)) from None
    except EOFError:
        raise commands.StoppedError(
            "the input ended; run the same command to continue from here"
        ) from None
    commands.print_line(f"parameters: {file}")
    commands.print_line(following)
    return following


def _bring_up_on_page(arguments: benches.BringUpArguments, terminal: _Terminal) -> None:
    """Bring up a rig at a page, which is served until the page or Ctrl-C ends the bring-up."""
    # Imported here, because the server is slow to import and the terminal does not need it.
    from haptic_accel.kits.bringup.guide import Guide
    from haptic_accel.scope import LOCAL_HOST, Access, ScopeServer

    guide = Guide(benches.STEPS)
    rig = BringUp(arguments, _Both(terminal, guide))
    server = ScopeServer(guide, Access(LOCAL_HOST, ""), LOCAL_HOST, 0, guide.act, "bring_up")
    commands.show_page(server.start())
    try:
        try:
            line, status = _bring_up(rig, arguments.file), commands.DONE
        except (commands.StoppedError, ParameterError) as error:
            line = str(error)
            status = error.status if isinstance(error, commands.StoppedError) else WRONG_ARGUMENTS
            terminal.show(None)
            terminal.tell(line)
        with suppress(KeyboardInterrupt):
            guide.end(line, done=status == commands.DONE)
    finally:
        server.stop()
    if status != commands.DONE:
        raise commands.StoppedError(status=status)


class _Both:
    """Person at a page, with the same lines in a terminal."""

    def __init__(self, terminal: _Terminal, guide: Guide) -> None:
        self._terminal, self._guide = terminal, guide

    def begin(self, number: int, step: str, purpose: str) -> None:
        self._terminal.begin(number, step, purpose)
        self._guide.begin(number, step, purpose)

    def tell(self, line: str) -> None:
        self._terminal.tell(line)
        self._guide.tell(line)

    def show(self, watched: benches.Watched | None) -> None:
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
        self._watched: benches.Watched | None = None
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
        self.tell(f"{number} of {len(benches.STEPS)}, {step}: {purpose}")

    def tell(self, line: str) -> None:
        with self._above():
            commands.print_line(line)

    def show(self, watched: benches.Watched | None) -> None:
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
        """Let lines be written above the live signal."""
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


def _picture(watched: benches.Watched) -> str:
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
