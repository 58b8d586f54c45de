# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Graph that recorded a bag, from metadata and changes of parameters; provenance of a page."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import haptic_accel
from haptic_accel.bags.reading import Bag, Change
from haptic_accel.bags.trial_metadata import LOCKSTEP, RUN, host
from haptic_accel.core import topics
from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.compensation import PLANT, matrix_plant
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.handle.plant import MatrixPlant, Plant
from haptic_accel.core.model import ACTUATOR, POSTURES, held
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.materials.folders import is_recording
from haptic_accel.setup.arguments import PLAYED_TOPICS, POINTER, REPLAY, SCENE, SIMULATED, VIRTUAL
from haptic_accel.setup.setup import Parameters, argument_of, known_arguments

OPERATOR, ROBOT = "master", "slave"
"""Values of the argument ``side`` for a bag of one of two hosts."""

UNKNOWN = "unknown"
"""Name of a controller, surface or grip that is missing in a bag."""

_SURFACE = "simulated.surface."
_CONDITIONS = {
    ("compensator", "controller"): "controller",
    ("master_device", "simulated.grip.posture"): "grip",
    ("slave_device", f"{_SURFACE}name"): "surface",
    ("slave_device", SCENE): "surface",
}
"""Fields of `Condition` by node and parameter."""


_FIGURES = ("compensator", "coupler", "master_device", "slave_device")
"""Nodes whose parameters affect a metric or a bound."""


ALTERED = " (altered)"
"""Suffix of a surface with some parameters changed during contact."""


@dataclass(frozen=True)
class Condition:
    """Controller, surface and grip: constant within a segment."""

    controller: str = UNKNOWN
    surface: str = UNKNOWN
    grip: str = UNKNOWN


@dataclass(frozen=True)
class Description:
    """Graph of a bag in one section, with defaults for items that the bag does not state.

    Attributes
    ----------
    condition : Condition
    arguments : mapping
        Arguments of the graph in this section.
    parameters : Parameters
        Parameters of the nodes that the bag states.
    controllers : dict
        Parameters of the controllers by name.
    rig : RigParameters or None
        Virtual rig of the run, or the rig specified for the handle.
    seed : int
        Seed of the user's grip.
    rate, high_pass_frequency, actuator, pair, latency
        See `Segment`.
    notes : tuple of str
        Parameters that have changed since the start.
    problems : tuple of str
        Items that are missing or invalid, one line each.
    """

    condition: Condition
    arguments: Mapping[str, Any]
    parameters: Parameters
    controllers: dict[str, Any]
    rig: RigParameters | None
    seed: int
    rate: float
    high_pass_frequency: float
    actuator: ActuatorParameters
    pair: tuple[str, ...]
    latency: int | None
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def plant_model(self) -> Plant | None:
        """Plant model of the compensator."""
        found = self.controllers.get(PLANT)
        return found.coupled() if found else None

    @property
    def is_simulated(self) -> bool:
        """True if the handle was simulated."""
        return self.arguments.get("master") in (SIMULATED, POINTER)

    @property
    def waits(self) -> bool:
        """True if the simulation of the handle stops while its node's process is paused.

        With frames, a simulated handle receives forces ahead of time, so a late force acts late.
        """
        return self.is_simulated and self.arguments.get("frame", 1) == 1

    def plant(self) -> Plant | None:
        """Return the plant of the condition: the simulated one, or the compensator's model."""
        if self.rig is None:
            return self.plant_model
        grip = self.rig.master.grip
        if self.condition.grip in POSTURES:
            grip = replace(grip, posture=self.condition.grip)
        return self.rig.plant(held(self.rig.master.handle, grip, self.seed))

    def matrix_plant(self) -> MatrixPlant | None:
        """Return the compensator's model of three axes.

        Raises
        ------
        ParameterError
            The model cannot be read.
        """
        if not self.plant_model or not self.plant_model.model:
            return None
        return matrix_plant(self.controllers, self.rate).coupled()


def described(
    recorded: Bag, parameters: Parameters, rate: float, rig: RigParameters | None = None
) -> Description:
    """Return a graph's description from its bag's metadata, and the parameters of its nodes.

    Parameters
    ----------
    recorded : Bag
    parameters : Parameters
    rate : float
        Samples per second.
    rig : RigParameters, optional
        Rig with the handle, for a bag that does not describe its handle.

    Raises
    ------
    ParameterError
        The bag describes its handle, and a rig is specified too.
    """
    problems: list[str] = []
    arguments, nodes = known_arguments(recorded.metadata), parameters.values
    if not nodes.get("compensator"):
        problems.append(
            "does not state how it was made: the latency is estimated where the signals show it,"
            f" and defaults are used for the high-pass ({HIGH_PASS_FREQUENCY:g} Hz) and the"
            f" actuator; record {topics.DESCRIPTION.name}, or analyse the original bag"
        )
    corner, actuator = HIGH_PASS_FREQUENCY, ActuatorParameters()
    options: dict[str, Any] = {}
    if rig and nodes:
        raise ParameterError(f"rig: {recorded.path} describes its own handle")
    try:
        if nodes.get("compensator"):
            compensation, options = parameters.node("compensator")
            corner, actuator = compensation.high_pass_frequency, options[ACTUATOR]
        if arguments.get("master") in (SIMULATED, POINTER):
            rig = parameters.rig()
    except ParameterError as error:
        problems.append(f"its parameters are invalid ({error}): defaults are used")
    stated = {
        field: str(nodes.get(node, {}).get(name) or arguments.get(field, UNKNOWN))
        for (node, name), field in _CONDITIONS.items()
    }
    condition = Condition(**stated | {"surface": surface_of(recorded)})
    pair: tuple[str, ...] = (recorded.path.name,)
    if arguments:
        seed = arguments.get("seed", nodes.get("slave_device", {}).get("seed", ""))
        surface = str(arguments.get("surface", ""))
        source = str(arguments.get("replay") or (surface if is_recording(surface) else ""))
        pair = (f"seed {seed}", *([Path(source).name] if source else []))
    seed = arguments.get("seed")
    user = seed if isinstance(seed, int) and seed >= 0 else 0
    return Description(
        condition=condition,
        arguments=arguments,
        parameters=parameters,
        controllers=options,
        rig=rig,
        seed=user,
        rate=rate,
        high_pass_frequency=corner,
        actuator=actuator,
        pair=pair,
        latency=recorded.latency,
        problems=tuple(problems),
    )


def surface_of(recorded: Bag) -> str:
    """Return the name of the surface, or of the played recording, from a bag.

    An operator's host does not know the surface at the robot. The surface under a real tool is
    known if the user named it.
    """
    arguments = known_arguments(recorded.metadata)
    slave = Parameters.from_metadata(recorded.metadata).values.get("slave_device", {})
    if arguments.get("side") == OPERATOR:
        return UNKNOWN
    surface = str(arguments.get("surface", ""))
    if arguments.get("slave") == REPLAY:
        return f"replay of {Path(str(arguments.get('replay', ''))).stem}"
    if arguments.get("slave") == PLAYED_TOPICS:
        return "played topics"
    if arguments.get("slave") == VIRTUAL:
        return Path(str(slave.get(SCENE, surface or UNKNOWN))).stem
    if is_recording(surface):
        return "recording"
    # Before 0.4, devices of real rigs also declare the parameters of the simulated surface.
    named = slave.get(f"{_SURFACE}name") if arguments.get("slave", SIMULATED) == SIMULATED else ""
    return str(named or Path(surface).stem or UNKNOWN)


def run_of(recorded: Bag) -> str:
    """Return a description of the run of a bag's trials; empty if the bag does not state it.

    Live nodes report diagnostics. A bag with arguments but without any report may be live or
    lockstep.
    """
    if recorded.metadata.get(RUN) == LOCKSTEP:
        return "in lockstep, without ROS"
    arguments = known_arguments(recorded.metadata)
    if not arguments or not recorded.diagnostics:
        return ""
    found = "live on ROS 2"
    if recorded.metadata.get("arguments"):
        composed = "its nodes composed into one process"
        apart = "each node in a process of its own"
        found += f", {composed if arguments.get('composed') else apart}"
    if arguments.get("side") in (OPERATOR, ROBOT):
        found += ", the other arm on another host"
    return found


def sections(recorded: Bag, start: Description) -> list[tuple[int, Description]]:
    """Return the start time, ns, and description of each section of a bag; the first time is 0."""
    found = [(0, start)]
    # Before 0.4, nodes declare the parameters of all devices, and the recorder receives them.
    unused = _SURFACE if start.arguments.get("slave") == VIRTUAL else SCENE
    changes = (each for each in recorded.changes if not each.parameter.startswith(unused))
    parameters = start.parameters
    for change in sorted(changes, key=lambda change: change.received):
        moment, before = found[-1]
        value = parameters.values.get(change.node, {}).get(change.parameter)
        if value == change.value:
            continue
        after = replace(before, condition=_changed(before.condition, change, start))
        parameters = parameters.changed({change.node: {change.parameter: change.value}})
        if value is not None and after.condition == before.condition and change.node in _FIGURES:
            after = _set(recorded, parameters, after, change)
        changed = dict(vars(after.condition).items() - vars(before.condition).items())
        if value is not None and (name := argument_of(change.node, change.parameter)):
            changed[name] = change.value
        after = replace(after, arguments={**before.arguments, **changed})
        if after != before:
            kept = found[:-1] if moment == change.received else found
            found = [*kept, (change.received, after)]
    return found


def _set(
    recorded: Bag, parameters: Parameters, before: Description, change: Change
) -> Description:
    """Return the description after a change of a parameter that is not part of the condition."""
    after = described(recorded, parameters, before.rate)
    name = f"{change.node}: {change.parameter} = "
    others = (note for note in before.notes if not note.startswith(name))
    notes = (*others, f"{name}{change.value} since a change during the recording")
    return replace(after, condition=before.condition, notes=notes, problems=before.problems)


def _changed(before: Condition, change: Change, start: Description) -> Condition:
    """Return the condition after the change of a parameter."""
    if field := _CONDITIONS.get((change.node, change.parameter)):
        value = str(change.value)
        return replace(before, **{field: Path(value).stem if change.parameter == SCENE else value})
    slave = start.parameters.values.get("slave_device", {})
    value = slave.get(change.parameter, change.value)
    is_other = change.node == "slave_device" and change.parameter.startswith(_SURFACE)
    # If a surface is replaced completely, its name is known and other fields are redundant.
    if is_other and change.value != value and before.surface == start.condition.surface:
        return replace(before, surface=before.surface + ALTERED)
    return before


_PACKAGE = Path(haptic_accel.__file__).parent


def page_provenance() -> dict[str, str]:
    """Return version, commit, machine and command line of this process, for a page's settings.

    The commit exists only if the package runs from its own clone.
    """
    machine = host()
    found = {
        "version": haptic_accel.__version__,
        "commit": _commit(),
        "machine": f"{machine['name']}, {machine['cores']} cores, {machine['system']},"
        f" Python {machine['python']}",
        "command line": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
    }
    return {name: value for name, value in found.items() if value}


def version() -> str:
    """Return the version of the package, and the commit if it runs from its own clone."""
    return " ".join(filter(None, (haptic_accel.__version__, _commit())))


@cache
def _commit() -> str:
    """Return the commit of the clone, marked if files differ from it; empty without a clone."""
    clone = _PACKAGE.parent
    if not (clone / ".git").exists():
        return ""
    command = ["git", "-C", str(clone), "describe", "--always", "--dirty", "--exclude=*"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:  # git is not installed
        return ""
    return done.stdout.strip()
