# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Launch descriptions with declared arguments and with processes as launch_ros nodes."""

from __future__ import annotations

import atexit
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnShutdown
from launch.events.process import ProcessExited
from launch.logging import get_logger
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from haptic_accel.core.parameters import suggestion
from haptic_accel.core.process import EMERGENCY, WELL
from haptic_accel.core.topics import JOINT_STATE_RATE
from haptic_accel.graph.domain import sole_graph
from haptic_accel.graph.frames import Frame, description, frames_at_rest
from haptic_accel.graph.supervisor import KILLING, LAST_END, LATE_END, QUIET_END
from haptic_accel.setup.processes import RESPAWN_DELAY, Process, arrangement
from haptic_accel.setup.words import MOVED, NamespaceArguments, assigned_keys, unknown_key

BLOCKED = (signal.SIGINT, EMERGENCY)
"""Signals blocked until a node handles them. Before, Ctrl-C would interrupt the start of Python
with a traceback, and an emergency stop would end the process."""

PREFIX = "launch-prefix"
"""Launch configuration with a prefix of each command line, such as a debugger."""

PUSHED = "ros_namespace"
"""Launch configuration with the namespace that `PushRosNamespace` has pushed."""


def launched(
    arguments: Sequence[tuple[str, str, str]],
    processes: Callable[[Sequence[str]], Sequence[Process]],
) -> LaunchDescription:
    """Declare arguments and start the requested processes.

    The end of any process that is not optional ends the graph.

    Parameters
    ----------
    arguments : sequence
        Name, default and description of each argument.
    processes : callable
        Returns the graph's processes for ``key:=value`` arguments.
    """

    def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        typed = assigned_keys(sys.argv) if _is_started(context) else ()
        _check_spelling([name for name, _, _ in arguments], typed)
        defaults = {name: default for name, default, _ in arguments}
        values = {name: LaunchConfiguration(name).perform(context) for name in defaults}
        NamespaceArguments(values["namespace"])  # check the namespace as it was typed
        values["namespace"] = _pushed(values["namespace"], context)
        given = [name for name in values if name in typed or values[name] != defaults[name]]
        found = processes([f"{name}:={values[name]}" for name in given])
        lock = ExitStack()
        lock.enter_context(sole_graph(found[0].namespace))
        leave = RegisterEventHandler(OnShutdown(on_shutdown=lambda *_: lock.close()))
        if line := arrangement(found):
            get_logger("haptic_accel").info(line)
        # Removed at exit only, because restarted nodes read their parameters again.
        folder = TemporaryDirectory(prefix="haptic_accel-")
        atexit.register(folder.cleanup)
        prefix = " ".join([context.launch_configurations.get(PREFIX, ""), *blocking_prefix()])
        nodes = [_node(process, Path(folder.name), prefix) for process in found]
        return [leave, *nodes, *_frame_publishers(found[0].namespace or "/")]

    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def _check_spelling(names: Sequence[str], typed: Iterable[str]) -> None:
    """Refuse a misspelt argument, since ``ros2 launch`` accepts any name silently."""
    for key in typed:
        if key not in names and (key in MOVED or suggestion(key, names)):
            raise unknown_key(key, names)


def _is_started(context: LaunchContext) -> bool:
    """Return whether the user started this launch file directly, not through another one."""
    file = Path(context.locals.current_launch_file_path).name
    return file in {Path(word).name for word in sys.argv}


def _pushed(namespace: str, context: LaunchContext) -> str:
    """Return a namespace, relative to the pushed one unless absolute, as in launch_ros."""
    if namespace.startswith("/"):
        return namespace
    return f"{context.launch_configurations.get(PUSHED, '')}/{namespace}"


def blocking_prefix() -> Sequence[str]:
    """Return the command-line prefix that blocks `BLOCKED`; empty if impossible."""
    names = ",".join(each.name.removeprefix("SIG") for each in BLOCKED)
    prefix = "env", f"--block-signal={names}"
    try:
        known = subprocess.run([*prefix, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        known = False
    return prefix if known else ()


def _node(process: Process, folder: Path, prefix: str) -> Node:
    """Return the action that starts a process with parameters from a folder."""
    return Node(
        package="haptic_accel",
        executable=process.executable,
        namespace=process.namespace or "/",
        arguments=process.ros_arguments(folder),
        output="screen",
        prefix=prefix,
        exec_name=process.executable,  # not the name of the prefix's program
        on_exit=None if process.optional else partial(_end, process),
        respawn=process.respawn,
        respawn_delay=RESPAWN_DELAY,
        sigterm_timeout=str(QUIET_END + (LAST_END if process.last else LATE_END)),
        sigkill_timeout=str(KILLING),
    )


def _frame_publishers(namespace: str) -> list[LaunchDescriptionEntity]:
    """Return the nodes that publish frames, moving or static, depending on installed packages."""
    # Graphs in other namespaces have equal frame names, so topics must be separate.
    own = {"namespace": namespace, "remappings": [("/tf", "tf"), ("/tf_static", "tf_static")]}
    if _installed("robot_state_publisher"):
        parameters = {
            "robot_description": ParameterValue(description(), value_type=str),
            "publish_frequency": 2 * JOINT_STATE_RATE,
        }
        name = "robot_state_publisher"
        return [Node(package=name, executable=name, parameters=[parameters], **own)]
    if _installed("tf2_ros"):
        return [_static_transform(frame, own) for frame in frames_at_rest(description())]
    get_logger("haptic_accel").info(
        "no frames are published: neither robot_state_publisher nor tf2_ros is installed"
    )
    return []


def _static_transform(frame: Frame, own: Mapping[str, Any]) -> Node:
    """Return the node that publishes a static frame."""
    axes = ("x", "y", "z", "roll", "pitch", "yaw")
    pose = zip(axes, frame.position + frame.rotation, strict=True)
    return Node(
        package="tf2_ros",
        executable="static_transform_publisher",
        name=f"{frame.name}_frame",
        arguments=[
            *(word for axis, value in pose for word in (f"--{axis}", value)),
            *("--frame-id", frame.parent, "--child-frame-id", frame.name),
        ],
        **own,
    )


def _installed(package: str) -> bool:
    """Return whether a ROS package is installed."""
    try:
        get_package_prefix(package)
    except PackageNotFoundError:
        return False
    return True


def _end(
    process: Process, event: ProcessExited, context: LaunchContext
) -> list[LaunchDescriptionEntity]:
    """End the graph after a node's end; a failure becomes launch's exit status."""
    if context.is_shutdown or process.comes_back(event.returncode):
        return []
    if event.returncode not in WELL:
        raise RuntimeError(f"{event.process_name} ended with status {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} ended")]
