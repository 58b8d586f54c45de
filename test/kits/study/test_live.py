# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Presentation of conditions by a live graph."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from kits.study.protocol_maker import make_protocol
from std_msgs.msg import Bool

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import DESIRED_ACCELERATION, EMERGENCY_STOP, HANDLE_ACCELERATION
from haptic_accel.kits.study.live import LiveRig
from haptic_accel.kits.study.protocol import Condition, Value
from haptic_accel.kits.study.trials import StoppedError, UndeliveredError
from haptic_accel.nodes.emergency_stop import LATCHED
from running import nodes_of, wait_until

if TYPE_CHECKING:
    from observing import Observer

pytestmark = pytest.mark.live

SECONDS = 2.0
"""Duration of a stimulus, s: the hand is in the air for at most 1.5 s."""


MOMENT = 0.5
"""Duration of a stimulus of which nothing is measured, s."""


def condition(**settings: Value) -> Condition:
    return Condition(tuple(settings.items()))


NOTHING = condition(controller="none", gain=1.0)
WHOLE = condition(controller="inverse", gain=1.0)
HALF = condition(controller="inverse", gain=0.5)
ON_VINYL = condition(controller="adaptive", surface="vinyl", grip="hook")
CANNOT_BE_SET = (
    condition(controller="inverse", gain=5.0),
    condition(controller="inverse", surface="nowhere"),
    condition(controller="inverse", seed=-1.0),
)
SEEDS = condition(controller="none", seed=1.0), condition(controller="none", seed=2.0)


@contextmanager
def rig(folder: Path, *conditions: Condition, **graph: str) -> Iterator[LiveRig]:
    """Give a live rig of a study with the conditions, on a hand that strokes by itself."""
    given: dict[str, Any] = {"graph": {"rig": "ideal", **graph}, "source": folder / "study.yaml"}
    protocol = make_protocol("identification", conditions=conditions, pairs=(), **given)
    with LiveRig(protocol, folder / "P07") as live:
        yield live


def test_conditions_are_presented_in_turn_and_measured_until_an_emergency_stop(
    tmp_path: Path, observer: Observer, capfd: pytest.CaptureFixture[str]
) -> None:
    with rig(tmp_path, NOTHING) as live:
        with pytest.raises(ParameterError, match="has a graph already"), rig(tmp_path, WHOLE):
            pass
        presented = (live.present(each, SECONDS) for each in (NOTHING, WHOLE, HALF, ON_VINYL))
        nothing, whole, half, vinyl = presented
        assert live.exposure > 0.0
        assert not live.has_pointer
        for wrong in CANNOT_BE_SET:
            with pytest.raises(UndeliveredError, match=r"gain|nowhere|seed"):
                live.present(wrong, SECONDS)
        stop = observer.node.create_publisher(Bool, EMERGENCY_STOP.name, LATCHED)
        stop.publish(Bool(data=True))
        for _ in range(2):
            with pytest.raises(StoppedError, match="emergency stop"):
                live.present(WHOLE, 60.0)
        live.stop()
        with pytest.raises(StoppedError, match="forces are off"):
            live.present(WHOLE, SECONDS)
    assert nothing.error == pytest.approx(100.0, abs=5.0)
    assert nothing.rms < 0.2 * nothing.desired_rms
    for each in (whole, half, vinyl):
        assert each.error is not None
        assert each.error < 50.0
        assert each.rms == pytest.approx(each.desired_rms, rel=0.3)
        assert each.peak > each.rms > 0.0
        assert 0.0 <= each.clipped <= 100.0
        assert 0.0 <= each.late <= 100.0
    assert half.read_back == {"controller": "inverse", "gain": 0.5}
    expected = {"controller": "adaptive", "surface": "vinyl", "grip": "hook", "gain": 1.0}
    assert vinyl.read_back == expected
    # One graph had all of them, and none of its output was seen.
    assert {each.bag for each in (nothing, whole, half, vinyl)} == {"bags/000"}
    assert capfd.readouterr() == ("", "")
    assert "[recorder]" in (tmp_path / "P07" / "graph.log").read_text()
    bag = read_bag(tmp_path / "P07" / "bags" / "000")
    stamps = bag.signals[HANDLE_ACCELERATION.name].stamps
    assert whole.begin in stamps
    assert whole.end in stamps
    # Between two stimuli nothing was asked for.
    desired = bag.signals[DESIRED_ACCELERATION.name]
    margin = 70_000_000  # the ramp, and the time until it begins
    for before, after in ((nothing, whole), (whole, half), (half, vinyl)):
        middle = (before.end + after.begin) // 2
        near = abs(desired.stamps - middle) < (after.begin - before.end) // 2 - 2 * margin
        assert near.sum() > 100
        assert not desired.values[near].any()


@pytest.mark.slow
def test_other_arguments_start_another_graph_and_one_that_dies_twice_ends_the_session(
    tmp_path: Path, domain: int
) -> None:
    def kill() -> None:
        os.kill(nodes_of(domain)["composed"], signal.SIGKILL)

    def kill_meanwhile() -> None:
        threading.Timer(MOMENT, kill).start()

    begun: list[int] = []
    with rig(tmp_path, *SEEDS) as live:
        felt, note = (*SEEDS, SEEDS[1]), lambda: begun.append(time.time_ns())
        presented = [live.present(each, MOMENT, note) for each in felt]
        kill()
        with pytest.raises(UndeliveredError, match=r"composed.*graph.log"):
            live.present(SEEDS[1], 60.0)
        presented.append(live.present(SEEDS[1], MOMENT))
        for _ in range(2):
            with pytest.raises(UndeliveredError, match=r"composed.*graph.log"):
                live.present(SEEDS[1], 60.0, kill_meanwhile)
        with pytest.raises(StoppedError, match="twice"):
            live.present(SEEDS[1], 60.0)
    assert all(at < each.begin for at, each in zip(begun, presented, strict=False))
    bags = ["bags/000", "bags/001", "bags/001", "bags/002"]
    assert [each.bag for each in presented] == bags
    assert all(read_bag(tmp_path / "P07" / bag).signals for bag in bags[:2])


@pytest.mark.usefixtures("domain")
def test_a_page_leads_the_hand_and_sees_the_scene(tmp_path: Path) -> None:
    with rig(tmp_path, WHOLE, master="pointer", slave="virtual") as live:
        wait_until(lambda: live.has_pointer, "the hand can be led")
        assert live.scene()["outlines"]
        for x in (0.01, 0.03):
            assert live.lead(x, 0.05) == ""
            wait_until(
                lambda x=x: abs(live.windows.vectors["handle"][0] - x) < 5e-3, "it is there"
            )
        presented = live.present(WHOLE, MOMENT)
    assert presented.desired_rms < 0.2  # in the air
    assert presented.error is None


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
def test_the_network_between_the_arms_changes_while_the_graph_runs(tmp_path: Path) -> None:
    near, far = condition(network=0.0), condition(network=30.0)
    with rig(tmp_path, near, far, controller="inverse") as live:
        presented = [live.present(each, SECONDS) for each in (near, far)]
    (bag,) = (tmp_path / "P07" / "bags").glob("*[0-9]")
    delays = [
        float(each.values["one-way delay (ms)"])
        for each in read_bag(bag).diagnostics
        if each.node == "coupler" and each.values.get("one-way delay (ms)")  # empty: not known yet
    ]
    assert delays[-1] - delays[0] == pytest.approx(30.0, rel=0.5)
    assert [each.read_back["network"] for each in presented] == [0.0, 30.0]
    assert {each.bag for each in presented} == {"bags/000"}
    assert all(each.error is not None and each.error < 50.0 for each in presented)
