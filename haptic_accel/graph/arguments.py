"""The arguments of the graph: the same ``key:=value`` words everywhere."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import POSTURES
from haptic_accel.core.parameters import parameter, schema
from haptic_accel.devices import MASTERS, SLAVES
from haptic_accel.devices.playback import loop_parameter, speed_parameter, start_parameter
from haptic_accel.graph.node_parameters import (
    rate_parameter,
    scope_control_parameter,
    scope_host_parameter,
    scope_port_parameter,
    trials_parameter,
)
from haptic_accel.graph.words import parse_words

AVERAGE_GRIP = "average"
"""That of Table I."""


REPLAY = "replay"
"""Name of the devices that play a recording."""

PLAYED_TOPICS = "topics"
"""In place of a slave device: what `ros2 bag play` publishes."""


def rig_argument() -> Any:
    """Declare the virtual rig."""
    return parameter("paper", "the virtual rig: ideal, paper, or a .yaml file")


def grip_argument() -> Any:
    """Declare how the simulated hand holds the handle."""
    return parameter(
        AVERAGE_GRIP, "how the simulated hand holds the handle", choices=tuple(POSTURES)
    )


def master_argument() -> Any:
    """Declare the master device."""
    return parameter("simulated", "master device", choices=tuple(MASTERS))


def bag_argument() -> Any:
    """Declare the bag."""
    return parameter("", "folder of the bag; empty for bags/<date and time>")


def config_argument() -> Any:
    """Declare the user's parameter file."""
    return parameter("", "ROS parameter file over config/teleop.yaml")


def seed_argument() -> Any:
    """Declare the seed."""
    return parameter(0, "of texture and noise of simulated devices", low=0, high=2**31 - 1)


@dataclass(frozen=True)
class GraphArguments(RecordingOptions):
    """What a user may say when starting the graph."""

    controller: str = parameter("dynamic", "acceleration controller", choices=tuple(CONTROLLERS))
    rig: str = rig_argument()
    grip: str = grip_argument()
    surface: str = parameter(
        "plywood",
        "what the simulated slave touches: plywood, text, vinyl, recording, or a .yaml file",
    )
    recording: str = parameter(
        "", "with surface:=recording, the CSV or WAV file of a tool acceleration in m/s^2"
    )
    recording_rate: float = parameter(
        0.0, "rate of a CSV recording; a WAV file has its own", unit="Hz", low=0.0, high=1e6
    )
    recording_column: str = parameter(
        "", "column of a CSV recording; empty for acceleration, accel, acc or a"
    )
    master: str = master_argument()
    slave: str = parameter(
        "simulated",
        "slave device, or the topics that `ros2 bag play` publishes",
        choices=(*SLAVES, PLAYED_TOPICS),
    )
    replay: str = parameter(
        "", "with slave:=replay or master:=replay, the bag, or CSV or WAV file, that is played"
    )
    replay_speed: float = speed_parameter()
    replay_loop: bool = loop_parameter()
    replay_start: float = start_parameter()
    rate: float = rate_parameter()
    duration: float = parameter(
        0.0, "time from engaging to the end; 0 = until stopped", unit="s", low=0.0, high=1e6
    )
    record: bool = parameter(True, "whether to record every topic")
    bag: str = bag_argument()
    composed: bool = parameter(
        False, "whether all nodes but the recorder share one process: quicker, less robust"
    )
    scope: bool = parameter(False, "whether to serve a page that shows the graph while it runs")
    scope_host: str = scope_host_parameter()
    scope_port: int = scope_port_parameter()
    scope_control: bool = scope_control_parameter()
    config: str = config_argument()
    seed: int = seed_argument()


@dataclass(frozen=True)
class IdentifyArguments(SweepParameters, RecordingOptions):
    """What a user may say when identifying a handle: the excitation, and the graph that runs."""

    trials: int = trials_parameter()
    rig: str = rig_argument()
    grip: str = grip_argument()
    master: str = master_argument()
    rate: float = rate_parameter()
    bag: str = bag_argument()
    config: str = config_argument()
    seed: int = seed_argument()

    @property
    def sweep(self) -> SweepParameters:
        """The excitation alone."""
        return SweepParameters(**{name: getattr(self, name) for name in schema(SweepParameters)})


def parse_arguments(words: Iterable[str]) -> GraphArguments:
    """Read the graph's arguments from ``key:=value`` words; see `parse_words`."""
    return parse_words(words, GraphArguments)
