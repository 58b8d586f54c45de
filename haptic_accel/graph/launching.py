"""Launch descriptions: arguments declared, processes as nodes of launch_ros."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnShutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from haptic_accel.graph.claims import sole_graph
from haptic_accel.graph.processes import Process

PUSHED = "ros_namespace"
"""Launch configuration in which launch_ros keeps what `PushRosNamespace` pushed."""


def launched(
    arguments: Sequence[tuple[str, str, str]],
    processes: Callable[[Sequence[str]], Sequence[Process]],
) -> LaunchDescription:
    """Declare arguments and start the processes they ask for.

    The end of any of them ends all, but of one that is optional.

    Parameters
    ----------
    arguments : sequence
        Name, default and description of each argument.
    processes : callable
        From ``key:=value`` words to the processes of the graph.
    """

    def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in arguments}
        given["namespace"] = _pushed(given["namespace"], context)
        found = processes([f"{name}:={value}" for name, value in given.items()])
        with ExitStack() as entered:
            entered.enter_context(sole_graph(found[0].namespace))
            folder = Path(entered.enter_context(TemporaryDirectory(prefix="haptic_accel-")))
            nodes = [_node(process, folder) for process in found]
            held = entered.pop_all()
        # Until then: a process that comes back reads its parameters again.
        leave = OnShutdown(on_shutdown=lambda *_: held.close())
        return [RegisterEventHandler(leave), *nodes]

    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def _pushed(namespace: str, context: LaunchContext) -> str:
    """Return a namespace below the pushed one, as launch_ros does unless it has a slash."""
    if namespace.startswith("/"):
        return namespace
    return f"{context.launch_configurations.get(PUSHED, '')}/{namespace}"


def _node(process: Process, folder: Path) -> Node:
    """Return the action that starts a process, whose parameters are in a folder."""
    return Node(
        package="haptic_accel",
        executable=process.executable,
        namespace=process.namespace or "/",
        arguments=process.ros_arguments(folder),
        output="screen",
        on_exit=None if process.optional else _end,
    )


def _end(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """End the graph with one of its nodes; a failure becomes launch's own exit status."""
    if context.is_shutdown:
        return []
    if event.returncode != 0:
        raise RuntimeError(f"{event.process_name} ended with status {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} ended")]
