# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.coupling.engagement import (
    DIFFERING,
    DISENGAGED,
    FREE_TIME,
    LATCHED_SETTLING,
    RESTING,
    STEP_PERIOD,
    STOPPED,
    WARNING_PERIOD,
    Decision,
    Engagement,
    EngagementParameters,
)
from haptic_accel.core.tick import ArmSample
from haptic_accel.core.topics import ARMS

TIMEOUT = 0.1
NOTHING = Decision()
ENGAGE = Decision(engage=True)


class Run:
    """An engagement whose time goes on as a test says."""

    def __init__(self, **parameters: float | bool) -> None:
        self.now = 100.0
        known = EngagementParameters(timeout=TIMEOUT, **parameters)  # type: ignore[arg-type]
        self.engagement = Engagement(known, self.now - LATCHED_SETTLING)
        self.listeners = 2
        for arm in ARMS:
            self.engagement.arm_stopped(arm, False)

    def step(self, seconds: float = STEP_PERIOD, arms: tuple[str, ...] = ARMS) -> Decision:
        """Let time pass, receive positions of arms, and decide."""
        self.now += seconds
        for arm in arms:
            self.position(arm)
        return self.engagement.decide(self.now, self.listeners)

    def position(self, arm: str, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> bool:
        """Receive a position; return whether it is usable."""
        sample = ArmSample(round(self.now * 1e9), (x, y, z))
        return self.engagement.watches[arm].take(self.now, sample)

    @property
    def missing(self) -> str:
        return self.engagement.missing(self.now, self.listeners)


def release(run: Run) -> None:
    """Release the stop, which has no reason."""
    assert run.engagement.stop.release(run.now, []) == ""


@pytest.fixture
def run() -> Run:
    """Return arms that nothing has happened to."""
    return Run()


def test_the_arms_engage_once_both_positions_are_there(run: Run) -> None:
    assert run.step(arms=()) == NOTHING
    assert run.missing == "waiting for the position of master and slave"
    assert run.step(arms=("slave",)) == NOTHING
    assert run.missing == "waiting for the position of master"
    assert run.step() == ENGAGE
    assert run.engagement.engaged
    assert run.step() == NOTHING


def test_engaging_waits_for_the_word_of_both_devices_that_they_are_not_stopped() -> None:
    engagement = Engagement(EngagementParameters(), 0.0)
    for arm in ARMS:
        engagement.watches[arm].take(1.0, ArmSample(10**9))
    assert engagement.decide(1.0, 1) == NOTHING
    assert engagement.missing(1.0, 1) == "waiting for master/stopped and slave/stopped"
    engagement.arm_stopped("slave", False)
    assert engagement.missing(1.0, 1) == "waiting for master/stopped"
    engagement.arm_stopped("master", False)
    assert engagement.decide(1.0, 1) == ENGAGE


def test_engaging_waits_for_the_compensator() -> None:
    run = Run(compensated=True)
    assert run.step() == NOTHING
    assert run.missing == "waiting for the compensator's force"
    run.engagement.compensated = True
    assert run.step() == ENGAGE


def test_engaging_waits_for_every_subscriber_but_does_not_end_with_one() -> None:
    run = Run(listeners=2)
    run.listeners = 1
    assert run.step() == NOTHING
    assert run.missing.endswith("there are 1 of 2")
    run.listeners = 2
    assert run.step() == ENGAGE
    run.listeners = 0
    assert run.step() == NOTHING
    assert run.engagement.engaged


@pytest.mark.parametrize("x", [-40.0, 0.06, 1e308])
def test_a_position_where_no_arm_can_be_ends_the_engagement(run: Run, x: float) -> None:
    run.step()
    run.now += 0.001
    assert run.position("slave", -0.04)
    assert not run.engagement.due(run.now)
    run.now += 0.001
    assert not run.position("slave", x)
    assert run.engagement.due(run.now)
    released = run.engagement.decide(run.now, 2)
    assert released.release
    assert released.warning.startswith(f"uncoupled: slave: position {x:.4g}, 0, 0 m: refused")
    assert run.engagement.refused == 1


@pytest.mark.parametrize("x", [math.nan, math.inf])
@pytest.mark.parametrize("axis", range(3))
def test_a_position_that_is_not_finite_is_missing_and_named(run: Run, x: float, axis: int) -> None:
    place = [x if each == axis else 0.0 for each in range(3)]
    run.step()
    for _ in range(2):
        run.now += 0.6 * TIMEOUT
        assert not run.position("slave", *place)
        assert run.position("master")
        run.engagement.decide(run.now, 2)
    assert not run.engagement.engaged
    said = ", ".join(f"{each:g}" for each in place)
    assert f"of slave: slave: position {said} m: refused, as it is {x} m from" in run.missing
    assert run.position("slave")
    assert run.engagement.refused == 2


def test_positions_that_jump_to_and_fro_never_engage_and_say_why(run: Run) -> None:
    for n in range(300):
        run.now += 0.001
        run.position("master")
        run.position("slave", -0.05 if n % 2 else -40.0)
        assert run.engagement.decide(run.now, 2).engage is (n == 0)
    assert run.missing.startswith("waiting for the position of slave: slave: position -0.05, 0, 0")
    assert run.engagement.refused == 299


@pytest.mark.parametrize("rate", [30.0, 200.0, 1000.0])
def test_an_arm_that_moves_with_a_hand_stays_coupled(run: Run, rate: float) -> None:
    for n in range(100):
        run.now += 1 / rate
        way = 1.0 * n / rate
        assert all(run.position(arm, 0.2 + way, -0.3 + way, 0.1 - way) for arm in ARMS)
        run.engagement.decide(run.now, 2)
    assert run.engagement.engaged


def test_a_refused_stamp_is_named_while_positions_are_missing(run: Run) -> None:
    run.engagement.watches["slave"].refusal = ": slave: stamps do not advance"
    run.step(arms=("master",))
    assert run.missing == "waiting for the position of slave: slave: stamps do not advance"


@pytest.mark.parametrize("arm", ARMS)
def test_the_arms_are_released_when_one_falls_silent_and_taken_again(run: Run, arm: str) -> None:
    run.step()
    (other,) = set(ARMS) - {arm}
    assert run.step(0.9 * TIMEOUT, (other,)) == NOTHING
    released = run.step(0.2 * TIMEOUT, (other,))
    assert released == Decision(
        release=True, warning=f"uncoupled: waiting for the position of {arm}"
    )
    assert not run.engagement.engaged
    assert run.step() == NOTHING
    assert run.missing == f"waiting for {arm}/stopped"
    run.engagement.arm_stopped(arm, False)
    assert run.missing == RESTING
    assert run.step(FREE_TIME) == ENGAGE


def test_arms_that_were_released_come_to_rest_before_they_are_taken_again(run: Run) -> None:
    run.step()
    run.engagement.request(False)
    run.step()
    assert run.engagement.request(True) == ""
    steps = 0
    while run.step() == NOTHING:
        assert run.missing == RESTING
        steps += 1
    assert run.engagement.engaged
    assert steps == pytest.approx(FREE_TIME / STEP_PERIOD, abs=1)


def test_a_request_releases_the_arms_until_the_next(run: Run) -> None:
    run.step()
    assert run.engagement.request(False) == ""
    assert not run.engagement.aside(run.now)
    assert run.step() == Decision(release=True, warning=f"uncoupled: {DISENGAGED}")
    assert not run.engagement.aside(run.now), "the arms have not come to rest"
    assert run.step(2 * WARNING_PERIOD) == NOTHING
    assert run.missing == DISENGAGED
    assert run.engagement.aside(run.now)
    assert run.engagement.request(True) == ""
    assert not run.engagement.aside(run.now)
    assert run.step() == ENGAGE


def test_the_emergency_stop_releases_the_arms_and_refuses_to_engage(run: Run) -> None:
    run.step()
    assert run.engagement.stop.stop()
    assert not run.engagement.stop.stop()
    assert run.step(0.0) == Decision(release=True, warning=f"uncoupled: {STOPPED}")
    assert run.engagement.request(True) == f"{STOPPED}: release it first"
    assert run.missing == STOPPED
    release(run)
    assert run.step(0.0) == NOTHING
    assert run.step(FREE_TIME) == ENGAGE


def test_a_release_of_the_stop_does_not_undo_a_request(run: Run) -> None:
    run.engagement.request(False)
    run.engagement.stop.stop()
    release(run)
    assert run.step() == NOTHING
    assert run.missing == DISENGAGED


def test_the_duration_counts_from_the_first_time_the_arms_engage() -> None:
    run = Run(duration=5.0)
    assert not run.step(20.0, arms=()).finished
    run.step()
    run.step(2.0, arms=())
    run.step()
    assert not run.step(2.9).finished
    assert run.step(0.2).finished
    assert run.step().finished


def test_no_duration_is_no_end(run: Run) -> None:
    run.step()
    assert not run.step(1e9).finished


def test_what_is_waited_for_is_said_again_and_again_but_not_too_often(run: Run) -> None:
    said = [run.step(WARNING_PERIOD / 10, ()).warning for _ in range(35)]
    assert [line for line in said if line] == ["waiting for the position of master and slave"] * 3


def test_a_stop_is_not_warned_of(run: Run) -> None:
    run.engagement.stop.stop()
    assert run.step(2 * WARNING_PERIOD).warning == ""


@pytest.mark.parametrize("arm", ARMS)
def test_a_device_that_is_stopped_alone_frees_the_arms_and_then_stops_all(arm: str) -> None:
    run = Run()
    run.step()
    run.engagement.arm_stopped(arm, True)
    assert run.step(0.0) == Decision(release=True, warning=f"uncoupled: {STOPPED}")
    assert run.step(0.9 * DIFFERING) == NOTHING
    assert not run.engagement.stop.stopped
    warning = f"emergency stop: only {arm} stopped; all are stopped again"
    assert run.step(0.2 * DIFFERING) == Decision(warning=warning)
    assert run.engagement.stop.stopped


@pytest.mark.parametrize("arm", ARMS)
def test_a_device_that_missed_the_stop_is_warned_of(run: Run, arm: str) -> None:
    run.engagement.stop.stop()
    run.engagement.arm_stopped(arm, False)
    assert run.step(0.0) == NOTHING
    warning = "emergency stop: only coupler stopped; all are stopped again"
    assert run.step(1.1 * DIFFERING) == Decision(warning=warning)
    run.engagement.arm_stopped(arm, True)
    assert run.step(2 * DIFFERING) == NOTHING


def test_a_release_that_reaches_all_within_a_while_stops_nothing(run: Run) -> None:
    run.engagement.stop.stop()
    for arm in ARMS:
        run.engagement.arm_stopped(arm, True)
    run.step()
    release(run)
    run.engagement.arm_stopped(ARMS[0], False)
    assert not run.step(0.5 * DIFFERING).engage
    run.engagement.arm_stopped(ARMS[1], False)
    assert run.step(0.6 * DIFFERING) == ENGAGE
    for _ in range(round(2 * DIFFERING / STEP_PERIOD)):
        assert run.step().warning == ""


@pytest.mark.parametrize("stopped", [True, False])
def test_what_a_device_said_that_has_gone_counts_no_longer(run: Run, stopped: bool) -> None:
    run.engagement.stop.stopped = not stopped
    run.engagement.arm_stopped(ARMS[0], stopped)
    run.engagement.arm_stopped(ARMS[1], not stopped)
    run.step()
    for _ in range(30):
        run.step(DIFFERING / 10, ARMS[1:])
    assert run.engagement.stop.stopped is not stopped


Event = Callable[[Run], object]

EVENTS: dict[str, Event] = {
    "both": lambda run: run.step(),
    "master": lambda run: run.step(arms=("master",)),
    "silence": lambda run: run.step(2 * TIMEOUT, ()),
    "force": lambda run: setattr(run.engagement, "compensated", True),
    "stop": lambda run: run.engagement.stop.stop(),
    "released": release,
    "engage": lambda run: run.engagement.request(True),
    "disengage": lambda run: run.engagement.request(False),
    "alone": lambda run: setattr(run, "listeners", 0),
    "listened to": lambda run: setattr(run, "listeners", 2),
}


@given(st.lists(st.sampled_from(sorted(EVENTS)), max_size=60))
def test_whatever_happens_the_arms_are_coupled_only_while_nothing_is_missing(
    events: list[str],
) -> None:
    run = Run(compensated=True, listeners=2)
    stopped = False
    was_engaged = False
    for name in events:
        EVENTS[name](run)
        stopped = {"stop": True, "released": False}.get(name, stopped)
        decision = run.engagement.decide(run.now, run.listeners)
        engaged = run.engagement.engaged
        assert engaged == (not run.missing)
        assert not (engaged and (stopped or not run.engagement.compensated))
        assert not (decision.engage and decision.release)
        if name not in ("both", "master", "silence"):
            assert (decision.engage, decision.release) == (
                engaged and not was_engaged,
                was_engaged and not engaged,
            )
        was_engaged = engaged
