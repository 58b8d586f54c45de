"""Launch descriptions: arguments declared, processes as nodes of launch_ros."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from haptic_accel.graph.processes import Process


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
    names = [name for name, _, _ in arguments]

    def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        words = [f"{name}:={LaunchConfiguration(name).perform(context)}" for name in names]
        return [
            Node(
                package="haptic_accel",
                executable=process.executable,
                arguments=process.ros_arguments,
                output="screen",
                on_exit=None if process.optional else _end,
            )
            for process in processes(words)
        ]

    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in arguments
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def _end(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """End the graph with one of its nodes; a failure becomes launch's own exit status."""
    if context.is_shutdown:
        return []
    if event.returncode != 0:
        raise RuntimeError(f"{event.process_name} ended with status {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} ended")]
