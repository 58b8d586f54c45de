# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lockstep trials for notebooks, with data frames, numbers and plots."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from haptic_accel.analysis import plots
from haptic_accel.analysis.traces import EXCERPT, excerpt_of
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, suggestion
from haptic_accel.core.trial import GripChange, Trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.node_parameters import NODES, node_schema
from haptic_accel.setup.setup import Setup


@dataclass(frozen=True)
class Rig:
    """Virtual rig by name, with changed parameters.

    Parameters
    ----------
    name : str or path
        ideal, paper, or a ``.yaml`` file.
    changes : mapping
        Values by node and dotted name, as in parameter files.

    Raises
    ------
    ParameterError
        A node or parameter is unknown.

    Examples
    --------
    >>> Rig("ideal", {"coupler": {"k_m": 500.0}}).name
    'ideal'
    """

    name: str | os.PathLike[str] = "paper"
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Reject unknown names."""
        for node, values in self.changes.items():
            if node not in NODES:
                raise ParameterError(f"rig: {node}: no such node{suggestion(node, NODES)}")
            known = node_schema(node)
            for name in values:
                if name not in known:
                    hint = suggestion(name, known)
                    raise ParameterError(f"rig: {name}: no such parameter of {node}{hint}")


@dataclass(frozen=True)
class NotebookTrial(Trial):
    """Trial that displays itself in a notebook."""

    def nrmse(self) -> float:
        """Return the error of the handle's acceleration after latency and one sample, percent.

        Raises
        ------
        ValueError
            The desired acceleration is zero, or there are too few samples.
        """
        return self.evaluate().nrmse_percent

    def frame(self) -> pd.DataFrame:
        """Return the signals by time in s, under names with units."""
        columns = {
            "tool_acceleration_m_s2": self.tool_acceleration,
            "desired_acceleration_m_s2": self.desired_acceleration,
            "handle_acceleration_m_s2": self.handle_acceleration,
            "actual_acceleration_m_s2": self.actual_acceleration,
            "actuator_force_N": self.actuator_force,
        }
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time_s"))

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw desired and actual acceleration; the actual one is shifted back as for the error.

        The complete trial is drawn; the axes show the part with the largest desired acceleration.

        Parameters
        ----------
        axes : Axes, optional
            Axes to draw in; default: a new figure.
        """
        if axes is None:
            from matplotlib import pyplot  # imported late, as it selects a backend

            size = plots.TEXT, plots.COLUMN
            axes = pyplot.subplots(figsize=size, layout="constrained")[1]
        desired, actual = self.desired_acceleration, self.actual_acceleration
        axes.plot(self.time, desired, **plots.DESIRED, label="desired")
        axes.plot(
            self.time - self.after / self.rate,
            actual,
            **plots.ACTUAL,
            label="actual, shifted back",
        )
        begin = excerpt_of(desired, self.rate).start / self.rate
        axes.set(xlim=(begin, begin + EXCERPT), xlabel="time (s)", ylabel="acceleration (m/s²)")
        axes.set_title(f"{self.controller} on {self.surface}: NRMSE {self.nrmse():.1f} %")
        axes.legend(loc="upper right")
        plots.rule(axes)
        return axes


def run_trial(
    controller: str = "dynamic",
    rig: str | os.PathLike[str] | Rig = "paper",
    surface: str | os.PathLike[str] = "plywood",
    *,
    duration: float = 10.0,
    recording: FloatArray | None = None,
    grips: Sequence[GripChange] = (),
    bag: str | os.PathLike[str] | None = None,
    **arguments: Any,
) -> NotebookTrial:
    """Run one condition of the experiment in lockstep, without ROS.

    Parameters
    ----------
    controller : str
    rig : str, path or Rig
        ideal, paper, or a ``.yaml`` file; or a `Rig` for changed parameters.
    surface : str or path
        plywood, text, vinyl, or a ``.yaml`` file.
    duration : float
        Duration of the trial, s.
    recording : ndarray, optional
        Tool acceleration at the graph's rate in place of that on the surface, m/s^2.
    grips : sequence of (float, HandleParameters or MountParameters)
        Changes of grip or mount, in order of time, each with its time in s.
    bag : str or path, optional
        Folder to make for a bag of the trial.
    **arguments
        Further arguments of the graph: grip, rate, latency, seed, slave, config.

    Returns
    -------
    NotebookTrial

    Raises
    ------
    ParameterError
        A value is invalid, or the bag exists already.
    """
    rig = rig if isinstance(rig, Rig) else Rig(rig)
    named = {"controller": controller, "rig": rig.name, "surface": surface, **arguments}
    values = {k: os.fspath(v) if isinstance(v, os.PathLike) else v for k, v in named.items()}
    setup = Setup.of(GraphArguments(duration=duration, **values)).changed(rig.changes)
    trial = lockstep_trial(setup, recording=recording, grips=grips)
    if bag is not None:
        record_trial(Path(bag), trial, setup, time.time_ns())
    return NotebookTrial(**vars(trial))
