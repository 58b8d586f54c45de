# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controllers that fail, above all of other packages: none takes over, and one line says why."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.control.controllers import CONTROLLERS, OWN_CONTROLLERS, Controller

RATE, BEGIN = 1000.0, 200
"""Samples per second, and number of samples of a controller before it fails."""


class Half(Controller):
    """Half a newton."""

    def __init__(self, *_: object) -> None:
        self.samples = 0

    def force(self, *_: float) -> float:
        self.samples += 1
        return 0.5


def failing(act: Callable[[], Any], place: str = "force", **given: Any) -> Compensation:
    """Return a compensation whose controller, in a method, acts after `BEGIN` samples."""

    def method(self: Half, *values: Any) -> Any:
        usual = getattr(Half, place)(self, *values)
        return act() if self.samples > BEGIN else usual

    with patch.dict(CONTROLLERS, failing=type("Failing", (Half,), {place: method})):
        axes = given.pop("axes", "z")
        made = Compensation(CompensationParameters("none", axes=axes), RATE, **given)
        made.select("failing")
    return made


def run(made: Compensation, samples: int) -> list[float]:
    """Return the forces of the coil along z while tool and handle move."""
    forces = []
    for index in range(samples):
        shaken = 0.0, 0.0, 0.1 * (index % 2)
        forces.append(made.process(shaken, shaken)[1][2])
        made.adapt()
    return forces


def fail() -> None:
    raise ValueError("no\nsuch thing")


RAISED = "raised ValueError: no such thing"


@pytest.mark.parametrize(
    ("place", "act", "reason"),
    [
        *(
            (place, fail, RAISED)
            for place in ("force", "applied", "adapt", "freeze", "diagnostics")
        ),
        ("force", lambda: sys.exit(3), "raised SystemExit: 3"),
        ("force", lambda: float("nan"), "returned nan, which is not a finite number"),
        ("force", lambda: np.float64("inf"), "returned inf, which is not a finite number"),
        ("force", lambda: None, "returned NoneType, which is not a finite number"),
        ("force", lambda: "0.5", "returned str, which is not a finite number"),
    ],
)
def test_none_takes_over_from_a_controller_that_fails(
    place: str, act: Callable[[], Any], reason: str
) -> None:
    made = failing(act, place)
    assert run(made, BEGIN + 2)[1:BEGIN] == [0.5] * (BEGIN - 1)
    made.freeze(True)
    made.diagnostics()
    forces = run(made, 50)
    assert np.abs(np.diff(forces)).max() == pytest.approx(0.1)  # of the crossfade
    assert forces[-1] == 0.0
    line, values = made.diagnostics()
    assert line == made.failure == f"controller failing: {reason}; none took over"
    assert made.controller == values["controller"] == "none"
    made.select("failing")  # once more
    assert made.diagnostics()[0] == ""


@pytest.mark.parametrize("axes", ["z", "x, y, z"])
@pytest.mark.parametrize(
    ("place", "act", "reason"),
    [
        ("adapt", fail, RAISED),
        ("force", lambda: float("nan"), "returned nan, which is not a finite number"),
    ],
)
def test_none_takes_over_from_one_of_this_package_too(
    monkeypatch: pytest.MonkeyPatch, axes: str, place: str, act: Callable[[], Any], reason: str
) -> None:
    for known in (CONTROLLERS, OWN_CONTROLLERS):
        monkeypatch.setitem(known, "failing", Half)
    made = failing(act, place, axes=axes)
    forces = run(made, BEGIN + 1000)
    assert (forces[1], forces[-1]) == (0.5, 0.0)
    line, values = made.diagnostics()
    assert line == made.failure == f"controller failing: {reason}; none took over"
    assert made.controller == "none" in values.values()
    made.select("failing")
    assert made.diagnostics()[0] == ""
    made.reset()
    assert made.controller == "failing"


def test_no_coil_goes_on_without_the_others() -> None:
    left = iter([0.5] * 100)
    run(made := failing(lambda: next(left), axes="x, y, z"), BEGIN + 100)
    assert [channel.controller for channel in made.channels] == ["none"] * 3


STALL = [0.3, *[0.0] * 299]
"""Times of a controller's samples on a machine that stalls, s."""


@pytest.mark.parametrize(
    ("times", "told"), [([4e-4], ""), ([6e-4], " 600 us"), ([0.04], " 40000 us"), (STALL, "")]
)
def test_a_controller_that_is_too_slow_is_replaced(times: list[float], told: str) -> None:
    spent, each = [0.0], itertools.cycle(times)

    def work() -> float:
        spent.append(spent[-1] + next(each))
        return 0.5

    live, lockstep = failing(work, clock=lambda: spent[-1]), failing(work)
    run(live, BEGIN + 800)
    reason = f"controller failing: took{told} of the 1000 us of a sample; none took over"
    assert live.failure == (reason if told else "")
    assert spent[-1] < 2.0, "it is replaced within a second or so"
    run(lockstep, BEGIN + 800)
    assert lockstep.failure == ""
