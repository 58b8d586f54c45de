# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processes of the graph and their parameters, from its arguments."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from haptic_accel.bags import NO_ROSBAGS
from haptic_accel.core.axes import Axes
from haptic_accel.core.control.channel import check_controller
from haptic_accel.core.control.compensation import check_axes
from haptic_accel.core.files import located
from haptic_accel.core.identification.sweep import repeat_samples
from haptic_accel.core.outside import node_module
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import WELL, WRONG_ARGUMENTS
from haptic_accel.devices.audio import AUDIO
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.registry import MASTERS, SLAVES
from haptic_accel.devices.simulated import played
from haptic_accel.setup import arguments as names
from haptic_accel.setup.arguments import GraphArguments, IdentifyArguments
from haptic_accel.setup.files import Values, parameter_text
from haptic_accel.setup.node_parameters import NODES, build_device
from haptic_accel.setup.setup import LINK, RECORDER, SCOPE, Arguments, Parameters, Setup

RESPAWN_DELAY = 1.0
"""Time before a failed process is restarted, s."""

HALF_COUPLER = "half_coupler"
"""Executable of the node `coupler` if each arm has a separate host."""

COMPOSED = "composed"
"""Executable that runs all nodes that compute forces in one process; with the side's name
appended, those of one of two hosts."""


@dataclass(frozen=True)
class Process:
    """One process of the graph.

    Attributes
    ----------
    executable : str
        Name of the executable in this package.
    parameters : dict
        ROS parameters by node, then by dotted name.
    namespace : str
        Namespace of its nodes and of the topics, with a slash before; empty for the root.
    log_level : str
        Lowest severity that is logged.
    respawn : bool
        True to restart it on failure.
    last : bool
        True to stop it after the others, so that it records their last messages.
    optional : bool
        True if the graph can run without it.
    domain : int or None
        ROS domain of the process; None for the environment's.
    """

    executable: str
    parameters: Values
    namespace: str = ""
    log_level: str = "info"
    respawn: bool = False
    last: bool = False
    optional: bool = False
    domain: int | None = None

    @property
    def name(self) -> str:
        """Name among the processes of a graph: the executable, with any separate domain."""
        return self.executable if self.domain is None else f"{self.executable}@{self.domain}"

    def comes_back(self, status: int) -> bool:
        """Return whether the process is restarted after this exit status."""
        return self.respawn and status not in (WRONG_ARGUMENTS, *WELL)

    def ros_arguments(self, folder: Path) -> list[str]:
        """Write the parameters to a file in a folder; return ROS arguments without the namespace.

        A file is needed, because command-line arguments cannot name a node in a namespace.
        """
        file = folder / f"{self.name}.yaml"
        file.write_text(parameter_text(self.parameters), encoding="utf-8")
        return ["--ros-args", "--params-file", str(file), "--log-level", self.log_level]


def graph(arguments: GraphArguments) -> list[Process]:
    """Check all arguments and files; return the processes of the graph.

    Raises
    ------
    ParameterError
        A surface, file or parameter is unusable.
    """
    setup = Setup.of(arguments)
    options = _checked_options(setup)
    _check_side(arguments)
    if arguments.slave == names.SIMULATED:  # check that the recording can be played
        slave = options["slave_device"][names.SIMULATED]
        played(slave.recording, arguments.rate, Axes.parsed(slave.tool.axes))
    _check_replay(arguments)
    _check_card(arguments)
    _check_devices(setup)
    compensation, plant = setup.node("compensator")
    check_axes(compensation, plant, compensation.rate)
    check_controller(compensation.controller, compensation.rate, plant)
    if arguments.record:
        _check_bag(arguments)
    return _processes(setup, composed=arguments.composed, respawn=arguments.respawn)


def identification_graph(arguments: IdentifyArguments) -> list[Process]:
    """Check all arguments and files; return the processes that excite and record a handle.

    Raises
    ------
    ParameterError
        A file or parameter is unusable.
    """
    setup = Setup.of(arguments)
    _checked_options(setup)
    _check_devices(setup)
    _check_bag(arguments)
    repeat_samples(arguments.sweep, arguments.rate)  # check that the rate suits the sweep
    return _processes(setup)


def _processes(
    setup: Setup[Any], *, composed: bool = False, respawn: bool = False
) -> list[Process]:
    """Return the processes of a setup."""
    arguments, nodes = setup.arguments, setup.nodes
    process = partial(Process, namespace=arguments.namespace, log_level=arguments.log_level)
    parts: dict[str, Values] = {
        name: {name: dict(setup.values[name])} for name in nodes if name not in (RECORDER, SCOPE)
    }
    if composed:
        apart = {LINK: parts.pop(LINK)} if LINK in parts else {}
        name = f"{COMPOSED}_{arguments.side}" if arguments.side else COMPOSED
        parts = {
            name: {name: own for each in parts.values() for name, own in each.items()},
            **apart,
        }
    elif LINK in parts:
        parts = {HALF_COUPLER if name == "coupler" else name: parts[name] for name in parts}
    processes = [
        # A link controls no arm: without it both arms are free, and other processes continue.
        process(name, parameters, respawn=respawn or name == LINK)
        for name, parameters in parts.items()
    ]
    if RECORDER in nodes:
        recorder = {**setup.values[RECORDER], "facts": setup.metadata()}
        # First, so that it misses few messages of the others.
        processes.insert(0, process(RECORDER, {RECORDER: recorder}, last=True))
    if SCOPE in nodes:
        # Last, as the forces need not wait for it.
        own = {SCOPE: dict(setup.values[SCOPE])}
        processes.append(process(SCOPE, own, optional=True))
    return processes


def arrangement(processes: Sequence[Process]) -> str:
    """Return a line on which nodes share a process, and on how to change this.

    The line is empty if there is no choice, as for an identification.
    """
    nodes = {process.executable: tuple(process.parameters) for process in processes}
    joint = next((own for own in nodes.values() if len(own) > 1), ())
    if joint:
        apart = [name for name, own in nodes.items() if own != joint]
        rest = f", one{' each' * (len(apart) > 1)} for {_series(apart)}" if apart else ""
        return f"one process for {_series(joint)}{rest}; composed:=false gives each node its own"
    if "identifier" in nodes:
        return ""
    return (
        "a process for each node; composed:=true joins those that make forces, but with"
        " respawn:=true, slave:=topics or an arm by CRTK"
    )


def _series(items: Sequence[str]) -> str:
    """Return names as an enumeration in a sentence."""
    return " and ".join(filter(None, (", ".join(items[:-1]), *items[-1:])))


def _checked_options(setup: Parameters) -> dict[str, dict[str, Any]]:
    """Check every parameter of every node; return their options by executable and name."""
    return {executable: setup.node(executable)[1] for executable in NODES}


def _check_side(arguments: GraphArguments) -> None:
    """Refuse, with a peer host, options for both arms, and a device of the peer's arm."""
    if not arguments.side:
        return
    side = f"side:={arguments.side}"
    if not node_module(HALF_COUPLER):
        raise ParameterError(f"{side}: needs the kit link, which is not installed")
    for arm in ("master", "slave"):
        device = getattr(arguments, arm)
        if device in (names.REPLAY, names.PLAYED_TOPICS):
            raise ParameterError(f"{arm} = {device!r}: not with {side}: a replay has one host")
        if arm != arguments.side and device != names.SIMULATED:
            raise ParameterError(f"{arm} = {device!r}: belongs to the peer, not to {side}")


def _check_replay(arguments: GraphArguments) -> None:
    """Refuse a replay without a device to play it."""
    players = {names.REPLAY, names.PLAYED_TOPICS}
    if arguments.replay and players.isdisjoint((arguments.master, arguments.slave)):
        raise ParameterError(
            f"replay = '{arguments.replay}': must come with slave:=replay or master:=replay"
        )


def _check_devices(setup: Setup[Any]) -> None:
    """Build each arm's device once, so that it refuses wrong parameters."""
    for arm, kinds in (("master", MASTERS), ("slave", SLAVES)):
        name = getattr(setup.arguments, arm, "")
        own, options = setup.node(f"{arm}_device")
        is_on_card = own.accelerometer_device == AUDIO
        if name in kinds and (is_on_card or name not in (names.SIMULATED, names.POINTER)):
            try:
                build_device(f"{arm}_device", own, options)
            except DeviceError as error:  # its library is missing
                raise ParameterError(f"{arm} = {name!r}: {error}") from None


def _check_card(arguments: GraphArguments) -> None:
    """Refuse two processes for the accelerometers of one card."""
    if arguments.accelerometers == AUDIO and not (arguments.composed or arguments.side):
        raise ParameterError(
            f"composed = false: must be true with accelerometers:={AUDIO}, as both arms share a"
            " card; that excludes respawn:=true, slave:=topics and an arm by CRTK"
        )


def _check_bag(arguments: Arguments) -> None:
    """Refuse a bag that exists already, or that cannot be written."""
    if not find_spec("rosbags"):
        raise ParameterError(f"record = true: {NO_ROSBAGS}; or record:=false")
    if arguments.bag and os.path.exists(arguments.bag):
        raise ParameterError(f"bag = '{arguments.bag}': must be a new folder")
    folder = Path(arguments.bag or "bags/new").absolute()
    there = next(each for each in folder.parents if os.path.exists(each))
    # Use a unique name: a graph that starts at the same time checks the same folder.
    location = f"bag = '{arguments.bag}'"
    with (
        located(location, unreadable="must be a folder to make: "),
        TemporaryDirectory(prefix=".", dir=there) as apart,
    ):
        Path(apart, folder.relative_to(there)).mkdir(parents=True)
