"""The teleoperation graph: ``ros2 launch haptic_accel teleop.launch.py controller:=dynamic``."""

from __future__ import annotations

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from haptic_accel.startup.arguments import described, parse_arguments
from haptic_accel.startup.graph import graph


def generate_launch_description() -> LaunchDescription:
    """Declare the graph's arguments and start its nodes, each of whose ends ends all."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, default, text in described()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_start)])


def _start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    words = [f"{name}:={LaunchConfiguration(name).perform(context)}" for name, _, _ in described()]
    return [
        Node(
            package="haptic_accel",
            executable=process.executable,
            arguments=process.ros_arguments,
            output="screen",
            on_exit=_end,
        )
        for process in graph(parse_arguments(words))
    ]


def _end(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """End the graph with one of its nodes; a failure becomes launch's own exit status."""
    if context.is_shutdown:
        return []
    if event.returncode != 0:
        raise RuntimeError(f"{event.process_name} ended with status {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} ended")]
