# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual rig in step with the clock: what a page that leads its hand sees and changes."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.scope.paced_rig import PacedRig
from haptic_accel.scope.server import CommandError
from haptic_accel.scope.windows import Ring
from running import wait_until


@pytest.fixture
def rig() -> Iterator[PacedRig]:
    """Run a rig in a thread."""
    made = PacedRig("plywood", "paper")
    ended = threading.Event()
    thread = threading.Thread(target=made.run, args=(ended.is_set,))
    thread.start()
    yield made
    ended.set()
    thread.join()


def count(ring: Ring, number: int) -> None:
    wait_until(lambda: ring.count >= number, f"{number} samples")


def act(rig: PacedRig, action: str, value: object) -> str:
    return asyncio.run(rig.act(action, value))


def test_its_samples_follow_the_clock(rig: PacedRig) -> None:
    count(rig.windows.handle, 500)
    _, stamps, _ = rig.windows.handle.since(0)
    assert stamps[-1] <= time.time_ns()
    steps = np.diff(stamps)
    assert np.median(steps) == NANOSECONDS / 1000
    # Ticks are left out on a machine that stands still, never doubled.
    assert steps.min() > 0
    assert not (steps % (NANOSECONDS // 1000)).any()


def test_strokes_of_its_own_are_felt_until_it_is_led(rig: PacedRig) -> None:
    wait_until(
        lambda: rig.windows.metrics().values.get("nrmse_percent", 100.0) < 40.0, "vibration felt"
    )
    wait_until(lambda: rig.state()["engaged"] is True, "the coupler reports")

    def lifted() -> bool:
        assert rig.lead(0.0, 0.06) == ""
        return rig.windows.vectors["tool"][2] > 0.05

    wait_until(lifted, "the tool is lifted")
    assert rig.windows.vectors["contact_force"] == (0.0, 0.0, 0.0)


def test_a_controller_a_surface_and_a_grip_are_changed_while_it_runs(rig: PacedRig) -> None:
    assert rig.state()["controller"] == "adaptive"
    for action, value in (("controller", "none"), ("surface", "vinyl"), ("grip", "hook")):
        assert act(rig, action, value) == f"{action}: {value}"
        assert rig.state()[action] == value
    assert list(rig.scene()["outlines"]) == ["vinyl"]


def test_the_error_is_that_of_the_new_surface_and_controller_only(rig: PacedRig) -> None:
    for action, value in (("surface", "vinyl"), ("controller", "none")):
        wait_until(lambda: "nrmse_percent" in rig.windows.metrics().values, "an error")
        act(rig, action, value)
        assert "nrmse_percent" not in rig.windows.metrics().values
    wait_until(lambda: "nrmse_percent" in rig.windows.metrics().values, "another error")
    # Without force the handle shows nothing of the vibration.
    assert rig.windows.metrics().values["nrmse_percent"] > 90.0


@pytest.mark.parametrize(
    ("action", "value", "told"),
    [
        ("estop", True, "action = 'estop': must be one of controller, surface, grip"),
        ("controller", "magic", "controller = 'magic': must be one of none, "),
        ("grip", None, "grip = None: must be one of average, "),
    ],
)
def test_what_it_does_not_know_is_refused(action: str, value: object, told: str) -> None:
    with pytest.raises(CommandError, match=f"^{told}"):
        act(PacedRig("plywood", "paper"), action, value)


def test_an_unknown_surface_or_rig_is_named() -> None:
    with pytest.raises(ParameterError, match="surface = 'ice': must be one of"):
        PacedRig("ice", "paper")
    with pytest.raises(ParameterError, match="rig = 'real': must be one of"):
        PacedRig("plywood", "real")
