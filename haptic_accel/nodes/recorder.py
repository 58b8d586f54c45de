"""Executable `recorder`: every topic of the graph into a bag."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from std_srvs.srv import Trigger

from haptic_accel.bags.definitions import UndefinedTypeError
from haptic_accel.bags.facts import custom_data
from haptic_accel.bags.session import Answer, RecordingSession
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import SIGNALS, TOPICS, Topic
from haptic_accel.nodes.interface import GraphNode, message_type, quality
from haptic_accel.nodes.scheduling import run

DEPTH = 1000
"""Messages of one topic that the middleware keeps while Python is busy."""

NICENESS = 10
"""How much less the recorder asks for a core than the nodes that make the force."""

DISCOVERY_PERIOD = 1.0
"""How often topics asked for by name or expression are looked for, s."""

MUCH_WAITING = 0.5
"""Share of the queue from which on it is a warning that messages wait."""

LITTLE_SPACE = 1 << 30
"""Bytes left on the disk, below which it is a warning: ten minutes of the graph at 1 kHz."""

PARAMETER_EVENTS = Topic(
    "/parameter_events", "rcl_interfaces/msg/ParameterEvent", "", "", reliable=True
)
"""Of all nodes: a controller, surface or grip that was changed while recording is in the bag."""

MICROSECONDS = 1e6
_UNSPECIFIED = QosTime(0, 0)


class Recorder(GraphNode):
    """Takes messages as they are serialised and hands them to the writer."""

    def __init__(self) -> None:
        super().__init__("recorder")
        self._session = RecordingSession(
            self.parameters.bag,
            self.parameters.queue,
            self.parameters,
            custom_data(self.parameters.facts),
        )
        self._reported = ""
        self._settled: set[str] = set()
        for topic in (*TOPICS, PARAMETER_EVENTS):
            self._record_own(topic)
        session = self._session
        for action in (session.start, session.pause, session.split, session.stop):
            self._serve(action.__name__, action)
        self._serve("status", self._tell)
        if self.parameters.topics or self.parameters.regex:
            self.create_timer(DISCOVERY_PERIOD, self._look_for_topics)
        self.get_logger().info(f"{self._session.state} to {self._session.path}")

    def close(self) -> None:
        """Finish the bag and say what is in it."""
        done, line = self._session.stop()
        if done:
            print(line, flush=True)
        if self._session.failures:
            raise OSError("; ".join(self._session.failures))

    def status(self) -> tuple[str, dict[str, str]]:
        """Return how many messages are written, waiting and lost, and how the disk does."""
        writer = self._session.writer
        files, load = writer.files, writer.take_load()
        warnings = []
        if writer.dropped:
            warnings.append(f"{writer.dropped} messages dropped")
        if files.failure or files.trouble:
            warnings.append(files.failure or files.trouble)
        if load.highest > MUCH_WAITING * self.parameters.queue:
            warnings.append(f"{load.highest} messages wait for the disk")
        if load.free_space < LITTLE_SPACE:
            warnings.append(f"{load.free_space / 1e6:.0f} MB are left on the disk")
        warning = "; ".join(warnings)
        if warning and warning != self._reported:
            self.get_logger().warning(warning)
        self._reported = warning
        return warning, {
            "bag": str(self._session.path),
            "state": self._session.state,
            "files": str(len(files.file_names)),
            "written": str(files.written),
            "written (bytes)": str(files.bytes),
            "waiting": str(load.waiting),
            "highest waiting": str(load.highest),
            "dropped": str(writer.dropped),
            "missing by stamps": str(writer.missing),
            "flush max (us)": f"{load.flush_time * MICROSECONDS:.0f}",
            "free space (bytes)": str(load.free_space),
        }

    def _record_own(self, topic: Topic) -> None:
        """Subscribe to one of the graph's topics, whose type and quality are known."""
        name = self.resolve_topic_name(topic.name)
        self._settled.add(name)
        put = self._session.connect(name, topic.type, [_own(topic)], sampled=topic in SIGNALS)
        self._subscribe(message_type(topic), name, put, quality(topic, DEPTH))

    def _subscribe(
        self, kind: Any, name: str, put: Callable[[bytes], None], profile: QoSProfile
    ) -> None:
        # What is lost on the way shows in the stamps. The middleware's own event of it (message
        # lost) is no help: of 5000 messages of which 95 came, Fast DDS told of 5, and with the
        # events executor of the wheels taking the event can hang for ever.
        self.create_subscription(kind, name, put, profile, raw=True)

    def _look_for_topics(self) -> None:
        """Record what exists by now of that which was asked for by name or expression."""
        named = {self.resolve_topic_name(name) for name in self.parameters.named_topics}
        for name, kinds in self.get_topic_names_and_types():
            if name in self._settled or not (name in named or self._is_found(name)):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if not publishers:
                continue  # whose quality is not known yet
            self._settled.add(name)
            problem = self._record_found(name, kinds, [p.qos_profile for p in publishers])
            if problem:
                self.get_logger().warning(f"{name}: is not recorded: {problem}")

    def _is_found(self, name: str) -> bool:
        """Whether the expressions ask for a topic; hidden ones are left out as ROS does it."""
        hidden = any(word.startswith("_") for word in name.split("/"))
        return not hidden and bool(self.parameters.finds(name))

    def _record_found(self, name: str, kinds: Sequence[str], offered: Sequence[QoSProfile]) -> str:
        """Subscribe to a topic as it is offered; return why not, empty if so."""
        if len(kinds) > 1:
            return f"it has {len(kinds)} types: {', '.join(kinds)}"
        (kind,) = kinds
        try:
            message = message_type(Topic(name, kind, "", ""))
            put = self._session.connect(name, kind, [_stored(profile) for profile in offered])
        except (ImportError, AttributeError) as error:
            return f"{kind} is not installed: {error}"
        except UndefinedTypeError as error:
            return str(error)
        self._subscribe(message, name, put, _requested(offered))
        self.get_logger().info(f"{name}: recorded too")
        return ""

    def _serve(self, verb: str, action: Callable[[], Answer]) -> None:
        """Offer as a service what a user does to a recording."""

        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = action()
            if action != self._tell:
                self.get_logger().info(response.message)
                self.report()
            return response

        self.create_service(Trigger, f"~/{verb}", answer)

    def _tell(self) -> Answer:
        """Say how the recording stands."""
        files, session = self._session.writer.files, self._session
        return not files.failure, (
            f"{session.path}: {session.state}, {files.written} messages in"
            f" {len(files.file_names)} file(s), {session.writer.dropped} dropped"
        )


def _own(topic: Topic) -> Qos:
    """Return a topic's quality of service as rosbag2 stores it."""
    return _stored(quality(topic, DEPTH))._replace(liveliness=QosLiveliness.AUTOMATIC)


def _stored(profile: QoSProfile) -> Qos:
    """Return a quality of service as rosbag2 stores it."""
    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        _time(profile.deadline.nanoseconds),
        _time(profile.lifespan.nanoseconds),
        QosLiveliness(int(profile.liveliness)),
        _time(profile.liveliness_lease_duration.nanoseconds),
        bool(profile.avoid_ros_namespace_conventions),
    )


def _time(nanoseconds: int) -> QosTime:
    return QosTime(*divmod(nanoseconds, NANOSECONDS))


def _requested(offered: Iterable[QoSProfile]) -> QoSProfile:
    """Return the most that all publishers of a topic offer, as `ros2 bag record` does."""
    profiles = list(offered)
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def main() -> None:
    """Run the node."""
    # The force that is felt does not wait for its being written down. Said before the
    # middleware starts its threads, which inherit it.
    os.nice(NICENESS)
    run("recorder", Recorder, realtime=False)


if __name__ == "__main__":
    main()
