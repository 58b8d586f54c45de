# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A participant's page with a session behind it, without a graph."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from kits.study.studies import TEXT, write_study

from haptic_accel.kits.study.log import Log
from haptic_accel.kits.study.participant_page import ParticipantPage, read_texts
from haptic_accel.kits.study.procedures import Plan
from haptic_accel.kits.study.protocol import Condition
from haptic_accel.kits.study.session import Session, SimulatedRig
from haptic_accel.kits.study.trials import Answer, PresentedStimulus, Screen, StoppedError
from haptic_accel.scope.windows import Windows

ENGLISH = {word: word.replace("_", " ") for word in read_texts("en")} | {"language": "en"}
"""Words of the page, each its own key."""

TRIALS = 6

PARTICIPANT = "P07"


class PageRig:
    """Rig whose hand a page leads, and in which nothing vibrates."""

    def __init__(self) -> None:
        self.windows = Windows()
        self.has_pointer = False
        self.led: list[tuple[float, float]] = []
        self.stops = 0
        self.windows.vectors = {"handle": (0.0, 0.0, 0.01), "tool": (0.0, 0.0, 0.0)}

    def scene(self) -> dict[str, Any]:
        view = [[-0.1, 0.1], [-0.02, 0.08]]
        plywood = [[[-0.1, 0.0], [0.1, 0.0]]]
        return {"view": view, "outlines": {"plywood": plywood}, "nodes": {}, "offset": [0, 0]}

    def lead(self, x: float, z: float) -> str:
        self.led.append((x, z))
        return ""

    def stop(self) -> None:
        self.stops += 1


class Visit:
    """Session of trials at a page, on a thread of its own as in the command.

    Attributes
    ----------
    seconds : float
        Time for which the simulated rig presents a stimulus, s.
    over : Event
        Event without which no stimulus ends.
    ended : str
        Reason for the end; empty before.
    """

    def __init__(self, folder: Path, noise: float = -100.0, trials: int = TRIALS) -> None:
        text = TEXT.replace("repeats: 12", f"repeats: {trials}")
        text = text.replace("practice: 2, break_every: 5", "practice: 0, break_every: 0")
        self.study = write_study(folder, text)
        self.log = self.study.begin(PARTICIPANT)
        self.noise, self.seconds, self.ended = noise, 0.05, ""
        self.over = threading.Event()
        self.over.set()
        self._open(0)

    def _open(self, port: int) -> None:
        self.rig = PageRig()
        self.page = ParticipantPage(ENGLISH, self.rig, port, self.noise)
        self.address = self.page.start()
        self._thread = threading.Thread()

    @property
    def answers(self) -> list[tuple[int, Answer]]:
        """Numbers of the trials that count, and their answers, as they are logged."""
        counted = self.log.record.counted
        return [(each.trial.number, each.answer) for each in counted if each.answer]

    @property
    def undelivered(self) -> int:
        """Number of trials that were broken off."""
        return sum(bool(each.flaw) for each in self.log.record.records)

    def begin(self, script: Callable[[], object] | None = None) -> None:
        """Run the session, or a script, on a thread."""
        run = self._run_script if script else self._run_session
        self._thread = threading.Thread(target=run, args=(script,), daemon=True)
        self._thread.start()

    def restart(self) -> None:
        """End the session's process as a kill would, and go on at the same address."""
        port = int(self.address.split(":")[-1].strip("/"))
        self.log.add = _lost  # type: ignore[method-assign]
        self.close()
        self.log = Log(self.log.file)
        self.ended = ""
        self._open(port)
        self.begin()

    def close(self) -> None:
        self.page.stop("the test has ended")
        if self._thread.ident:
            self._thread.join(10.0)
        self.page.close()
        self.log.close()

    def present(
        self, condition: Condition, seconds: float, begun: Callable[[], None] = lambda: None
    ) -> PresentedStimulus:
        """Present a stimulus as the simulated rig does, but for some time."""
        begun()
        threading.Event().wait(self.seconds)
        self.over.wait()
        return SimulatedRig(self.study.protocol).present(condition, seconds)

    def _run_session(self, _: object) -> None:
        protocol, begun = self.study.protocol, self.log.record
        rig = SimulatedRig(protocol)
        rig.present = self.present  # type: ignore[method-assign]
        plan = Plan(protocol, begun.seed, begun.row)
        self.ended = Session(protocol, plan, self.log, rig, self.page).run().ended

    def _run_script(self, script: Callable[[], object]) -> None:
        try:
            script()
        except StoppedError as stopped:
            self.ended = str(stopped)
        else:
            self.ended = "complete"
            self.page.show(Screen("", "end"))


def _lost(kind: str, **content: Any) -> None:
    """Write nothing, as a killed process."""
