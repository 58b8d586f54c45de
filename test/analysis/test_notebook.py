# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lockstep trials as a notebook sees them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.colors import to_hex

import haptic_accel
from haptic_accel import HandleParameters, Rig, read_bag, run_trial
from haptic_accel.analysis import plots
from haptic_accel.core import topics
from haptic_accel.core.parameters import ParameterError
from haptic_accel.materials.folders import preset_file
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial
from haptic_accel.setup.setup import Setup

SHORT = {"duration": 2.0}


@pytest.fixture(scope="module")
def trial() -> Any:
    return run_trial("dynamic", rig="ideal", surface="text", latency=2, **SHORT)


@pytest.fixture
def hidden() -> Iterator[None]:
    """Draw without a display, and leave no figure behind."""
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")


def test_it_is_the_trial_of_the_command_line(trial: Any) -> None:
    asked = GraphArguments(controller="dynamic", rig="ideal", surface="text", latency=2, **SHORT)
    expected = lockstep_trial(Setup.of(asked))
    assert trial.nrmse() == expected.evaluate().nrmse_percent
    assert np.array_equal(trial.handle_acceleration, expected.handle_acceleration)


def test_the_frame_has_every_signal_by_time_with_its_unit(trial: Any) -> None:
    frame = trial.frame()
    assert frame.index.name == "time_s"
    assert frame.index[-1] == pytest.approx(2.0 - 1e-3)
    assert all(name.endswith(("_m_s2", "_N")) for name in frame.columns)
    desired, actual = frame["desired_acceleration_m_s2"], frame["actual_acceleration_m_s2"]
    assert np.array_equal(desired, trial.desired_acceleration)
    # The error from the frame alone: three samples after the latency of two.
    difference = actual.shift(-3) - desired
    error = 100 * np.sqrt((difference**2).mean() / (desired[:-3] ** 2).mean())
    assert trial.nrmse() == pytest.approx(error, rel=0.02)


@pytest.mark.usefixtures("hidden")
def test_the_plot_shows_desired_and_actual_as_reports_do(trial: Any) -> None:
    axes = trial.plot()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time (s)", "acceleration (m/s²)")
    desired, actual = axes.get_lines()
    colours = to_hex(desired.get_color()), to_hex(actual.get_color())
    assert colours == (plots.BLUE, plots.DARK_ORANGE)
    shift = np.subtract(desired.get_xdata(), actual.get_xdata())
    assert shift == pytest.approx(np.full(len(shift), 3e-3))
    own = pyplot.figure().subplots()
    assert trial.plot(own) is own


def test_a_path_may_be_a_string_or_a_path(trial: Any) -> None:
    for kind in (str, Path):
        rig, surface = (
            kind(preset_file(*each)) for each in (("rig", "ideal"), ("surface", "text"))
        )
        assert run_trial("dynamic", rig, surface, latency=2, **SHORT).nrmse() == trial.nrmse()


def test_a_bag_is_written_once_and_read_by_its_path_as_a_string(tmp_path: Path) -> None:
    bag = str(tmp_path / "bag")
    trial = run_trial("none", "ideal", "text", bag=bag, **SHORT)
    signal = read_bag(bag).signals[topics.TOOL_ACCELERATION.name]
    assert np.array_equal(signal.values[:, 2], trial.tool_acceleration)
    with pytest.raises(ParameterError, match="exists"):
        run_trial("none", "ideal", "text", bag=bag, **SHORT)


def test_a_recording_replaces_the_surface_and_a_heavier_grip_moves_less() -> None:
    tone = np.sin(2 * np.pi * 150.0 * np.arange(2000) / 1000.0)
    light, heavy = ((0.0, HandleParameters(m_h=mass)) for mass in (0.1, 1.0))
    moved = [
        run_trial("constant", "ideal", recording=tone, grips=[grip], **SHORT)
        for grip in (light, heavy)
    ]
    for each in moved:  # the tone begins after the first force
        assert np.std(each.tool_acceleration) == pytest.approx(np.std(tone), rel=0.01)
    # Above its resonances, a handle is a mass.
    ratio = np.std(moved[0].actual_acceleration) / np.std(moved[1].actual_acceleration)
    assert ratio == pytest.approx(10.0, rel=0.2)


def test_a_changed_rig_is_another_plant() -> None:
    # Ten times the mass: the same force moves the handle a tenth as much.
    heavy = Rig("ideal", {"master_device": {"simulated.handle.m_h": 1.28}})
    usual, moved = (run_trial("constant", rig, "text", **SHORT) for rig in ("ideal", heavy))
    assert np.std(moved.actual_acceleration) < 0.3 * np.std(usual.actual_acceleration)
    assert np.array_equal(moved.time, usual.time)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"master": {}}, "rig: master: no such node"),
        (
            {"coupler": {"k_mm": 1.0}},
            r"rig: k_mm: no such parameter of coupler \(did you mean k_m",
        ),
        ({"coupler": {"k_m": -1.0}}, "k_m = -1.0: must be from 0 to 5000 N/m"),
    ],
)
def test_what_is_wrong_with_a_rig_is_named(changes: Any, named: str) -> None:
    with pytest.raises(ParameterError, match=named):
        run_trial(rig=Rig("ideal", changes))


def test_the_package_names_what_it_has() -> None:
    assert {"run_trial", "read_bag", "Rig"} <= set(dir(haptic_accel))
    with pytest.raises(AttributeError, match="has no attribute 'run_trail'"):
        haptic_accel.run_trail  # noqa: B018
