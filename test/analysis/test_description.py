# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags of any recorder, whose messages describe the graph, and bags that do not describe it."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters

from bag_maker import CHANGED, START, Message, change_bytes, write_messages
from haptic_accel.analysis import load, trials
from haptic_accel.analysis.description import UNKNOWN
from haptic_accel.bags.metadata import read_metadata
from haptic_accel.core.topics import DESCRIPTION
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.setup import Setup
from nightly import rest_slow
from observing import Observer
from other_recorder import OtherRecorder, converted
from reading import with_types
from running import Command

Run = Callable[..., Command]
TEXT_TYPE = 4
"""rcl_interfaces/msg/ParameterType."""

LONG_ENOUGH = 6.0
"""Recording during which an adaptive controller behaves as in a longer one, s."""


def run(folder: Path, **given: object) -> Path:
    """Record a trial in lockstep; return its bag."""
    arguments = GraphArguments(**{"duration": 2.0, "surface": "vinyl"} | given)
    setup = Setup.of(arguments)
    record_trial(folder / "bag", lockstep_trial(setup), setup, START)
    return folder / "bag"


def silent(bag: Path) -> Path:
    """Return a copy without anything that describes the graph."""
    rows = [row for row in with_types(bag) if row[0] != f"/{DESCRIPTION.name}"]
    return write_messages(bag.parent / "silent", [Message(*row) for row in rows])


def row(bag: Path, shift: str = "granted") -> pd.Series:
    """Return the only trial of a bag, without the names of files."""
    return trials(load(bag, shift=shift)).drop(columns=["trial", "bag"]).iloc[0]


@pytest.mark.parametrize("rig", rest_slow(["paper", "three_axis"]))
def test_a_converted_bag_has_the_same_digits(tmp_path: Path, rig: str) -> None:
    bag = run(tmp_path, controller="adaptive", rig=rig, latency=3)
    pd.testing.assert_series_equal(row(bag), row(converted(bag, tmp_path / "copy")))


def test_declared_parameters_describe_the_graph(tmp_path: Path) -> None:
    bag = run(tmp_path, controller="dynamic", latency=3)
    declared: list[tuple[str, str, str | int]] = [
        ("compensator", "controller", "dynamic"),
        ("compensator", "latency", 3),
        ("slave_device", "simulated.surface.name", "vinyl"),
        ("slave_device", "seed", 5),
    ]
    events = [
        Message(
            "/parameter_events", CHANGED, START, change_bytes(START, f"/{n}", k, v, declared=True)
        )
        for n, k, v in declared
    ]
    samples = [Message(*each) for each in with_types(bag) if each[0] != f"/{DESCRIPTION.name}"]
    found = row(write_messages(tmp_path / "other", [*events, *samples]))
    assert (found.controller, found.surface, found.pair) == ("dynamic", "vinyl", "seed 5")
    assert (found.latency_samples, found.nrmse_percent) == (3, row(bag).nrmse_percent)


@pytest.mark.parametrize(
    ("controller", "latency"),
    [("constant", 0), ("constant", 4), ("dynamic", 1), ("adaptive", 0), ("adaptive", 4)],
)
def test_an_unknown_latency_is_estimated_and_said(
    tmp_path: Path, controller: str, latency: int
) -> None:
    bag = run(tmp_path, controller=controller, latency=latency)
    analysis = load(silent(bag))
    (found,) = trials(analysis).to_dict("records")
    assert (found["controller"], found["surface"]) == (UNKNOWN, UNKNOWN)
    assert found["latency_samples"] == latency
    assert found["nrmse_percent"] == row(bag).nrmse_percent
    assert "its latency is not stated" in found["notes"]
    assert "estimated" in analysis.shifted_by


def test_without_any_sign_of_the_latency_there_is_no_figure_but_the_reason(tmp_path: Path) -> None:
    bag = silent(run(tmp_path, controller="none"))
    found = row(bag)
    assert math.isnan(found.nrmse_percent)
    assert "its latency is not stated, and cannot be estimated" in found.notes
    assert math.isfinite(row(bag, shift="2").nrmse_percent)


@pytest.mark.parametrize(("gain", "trial_count"), rest_slow([(2, 2), (1, 1)]))
def test_a_parameter_changed_while_recording_begins_another_trial(
    tmp_path: Path, gain: int, trial_count: int
) -> None:
    bag = run(tmp_path, controller="dynamic", duration=6.0)
    moment = START + 3 * 10**9
    data = change_bytes(moment, "/compensator", "gain", gain)
    messages = [Message(*each) for each in with_types(bag)]
    messages.append(Message("/parameter_events", CHANGED, moment, data))
    messages.sort(key=lambda each: each.received)
    found = trials(load(write_messages(tmp_path / "changed", messages)))
    assert ["gain = 2" in notes for notes in found.notes] == [False, True][:trial_count]


@pytest.mark.slow
def test_any_recorder_gets_what_the_figures_hang_on_though_it_joins_late(
    haptic_accel: Run, observer: Observer, tmp_path: Path
) -> None:
    words = "rate:=250", "controller:=dynamic", "surface:=vinyl", "bag:=own"
    graph = haptic_accel("teleop", *words)
    graph.wait_for("engaged")
    value = ParameterValue(type=TEXT_TYPE, string_value="none")
    change = SetParameters.Request(parameters=[Parameter(name="controller", value=value)])
    observer.call(SetParameters, "compensator/set_parameters", change)
    recorder = OtherRecorder(observer)
    recorder.record_until(lambda: recorder.seconds > LONG_ENOUGH, quiet=0.0)
    graph.process.send_signal(signal.SIGINT)
    recorder.record_until(lambda: graph.process.poll() is not None)
    assert graph.end() == 0, graph.text
    stated = read_metadata(tmp_path / "own").custom
    custom = {key: text.replace('"dynamic"', '"none"') for key, text in stated.items()}
    other = recorder.write(tmp_path / "other")
    messages = [Message(*each) for each in with_types(other)]
    expected = row(write_messages(tmp_path / "with_metadata", messages, custom=custom))
    found = row(other)
    assert (found.controller, found.surface) == ("none", "vinyl")
    assert expected.run.startswith(found.run)
    pd.testing.assert_series_equal(found.drop("run"), expected.drop("run"))
    ours = trials(load(tmp_path / "own"))
    assert list(ours.latency_samples.unique()) == [found.latency_samples]
    assert ours.nrmse_percent.iloc[-1] == pytest.approx(found.nrmse_percent, rel=0.2)
