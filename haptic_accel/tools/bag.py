"""Reads the signals of one condition back from a bag."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core.histogram import QUANTILES
from haptic_accel.core.identification import RecordingError
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.trial import Trial
from haptic_accel.nodes import topics
from haptic_accel.nodes.topics import TOPICS, VECTORS, Topic

NANOSECONDS = 1_000_000_000

SIGNALS: dict[str, Topic] = {
    "tool_acceleration": topics.TOOL_ACCELERATION,
    "desired_acceleration": topics.DESIRED_ACCELERATION,
    "handle_acceleration": topics.HANDLE_ACCELERATION,
    "actuator_force": topics.ACTUATOR_FORCE,
}
"""A trial's signals and the topics they come from."""

ALONG_ACTUATOR = {kind: attrgetter(f"{vector}.z") for kind, vector in VECTORS.items()}
"""What gets the component along the actuator's axis, by message type."""

AGE_OF = "actuator force"
"""Which command's age counts: the one whose force is felt."""

LABELS = (*QUANTILES, "max")
"""Of durations in diagnostics."""

SAME_PERIOD = 0.1
"""By how much of itself the median of periods may differ from the expected one."""

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Delivery:
    """How samples travelled through the graph.

    Attributes
    ----------
    age_us : dict
        Age of the actuator's forces when applied, us: p50, p99, max.
    lost : dict
        By topic: messages missing in the bag although their sample was taken.
    late : dict
        By topic: messages recorded more than half a period after their stamp.
    missed : dict
        By arm: samples of the grid that were not taken.
    warnings : list of str
        What nodes complained of in their diagnostics.
    nodes : dict
        By node: its last diagnostics.
    """

    age_us: dict[str, float]
    lost: dict[str, int]
    late: dict[str, int]
    missed: dict[str, int]
    warnings: list[str]
    nodes: dict[str, dict[str, str]]


@dataclass
class _Series:
    """What a bag holds of one topic: when stamped, when recorded, and the z component."""

    stamps: IntArray
    received: IntArray
    values: FloatArray


def read_trial(
    bag: Path, surface: str, controller: str, rate: float, high_pass_frequency: float
) -> tuple[Trial, Delivery]:
    """Read a bag of the graph.

    The signals are put on the sampling grid that their stamps lie on, from the moment the
    arms were coupled and every signal was there; a sample that was lost is given the value
    of the one before, and counted.

    Parameters
    ----------
    bag : Path
        Folder written by the recorder.
    surface, controller : str
        The condition it was made under.
    rate : float
        Samples per second of the graph.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.

    Raises
    ------
    ParameterError
        It is not a bag, or lacks a signal.
    """
    recorded = _Recorded(bag, rate)
    signals = {
        name: _on_grid(recorded.places(topic.name), recorded.series[topic.name], recorded.length)
        for name, topic in SIGNALS.items()
    }
    trial = Trial(
        surface,
        controller,
        rate,
        np.arange(recorded.length) / rate,
        **signals,
        high_pass_frequency=high_pass_frequency,
    )
    return trial, recorded.delivery()


def read_excited(bag: Path, rate: float) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Return actuator force and handle acceleration of an identification's bag.

    Parameters
    ----------
    bag : Path
        Folder written by the recorder.
    rate : float
        Samples per second of the graph.

    Returns
    -------
    actuator_force, handle_acceleration : ndarray, shape (n,)
        N and m/s^2, each force at the sample that caused it.
    missing : ndarray of bool, shape (n,)
        Which samples are not there, and are given the value of the one before.

    Raises
    ------
    ParameterError
        It is not a bag.
    RecordingError
        It lacks a signal, or is of another rate.
    """
    series, _ = _read(bag)
    force, acceleration = (
        series[topic.name] for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION)
    )
    for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION):
        if len(series[topic.name].stamps) < 2:
            raise RecordingError(f"{bag}: has no {topic.name}")
    period = NANOSECONDS / rate
    found = float(np.median(np.diff(acceleration.stamps)))
    if abs(found - period) > SAME_PERIOD * period:
        raise RecordingError(
            f"{bag}: {topics.HANDLE_ACCELERATION.name} has {NANOSECONDS / found:.5g} samples per"
            f" second, must have rate = {rate:g} Hz"
        )
    start = int(acceleration.stamps[0])
    length = round((int(acceleration.stamps[-1]) - start) / period) + 1

    def places(signal: _Series) -> IntArray:
        return np.asarray(np.round((signal.stamps - start) / period), dtype=np.int64)

    missing = np.ones(length, dtype=np.bool_)
    missing[places(acceleration)] = False
    return (
        _on_grid(places(force), force, length),
        _on_grid(places(acceleration), acceleration, length),
        missing,
    )


def read_force_age(bag: Path) -> float:
    """Return the median age of the actuator's forces where they were applied, s.

    0 where the bag has no diagnostics of it.

    Raises
    ------
    ParameterError
        It is not a bag.
    """
    _, diagnostics = _read(bag)
    found = [status for _, status in diagnostics if status.name == "master_device"]
    if not found:
        return 0.0
    values = {pair.key: pair.value for pair in found[-1].values}
    return durations(values, f"{AGE_OF} age", ("p50",)).get("p50", 0.0) * 1e-6


def read_delivery(bag: Path, rate: float) -> Delivery:
    """Return how samples travelled, from a bag of the graph at a rate in Hz.

    Raises
    ------
    ParameterError
        It is not a bag, or lacks a signal.
    """
    return _Recorded(bag, rate).delivery()


class _Recorded:
    """A bag's content, and the stretch of the sampling grid on which every signal was there."""

    def __init__(self, bag: Path, rate: float) -> None:
        self.series, self._diagnostics = _read(bag)
        self._period = NANOSECONDS / rate
        needed = [topic.name for topic in (*SIGNALS.values(), topics.MASTER_ARM_FORCE)]
        for name in needed:
            if not len(self.series[name].stamps):
                raise ParameterError(f"{bag}: has no message of {name}")
        self._start = int(max(self.series[name].stamps[0] for name in needed))
        end = int(min(self.series[name].stamps[-1] for name in needed))
        self.length = round((end - self._start) / self._period) + 1
        if self.length < 2:
            raise ParameterError(f"{bag}: its signals do not overlap")

    def places(self, name: str) -> IntArray:
        """Return on which sample of the stretch each message of a topic lies."""
        stamps = self.series[name].stamps
        return np.round((stamps - self._start) / self._period).astype(np.int64)

    def delivery(self) -> Delivery:
        """Count what is missing on the grid and what came late, and find the ages."""
        late, seen = {}, {}
        length = self.length
        for name, found in self.series.items():
            places = self.places(name)
            within = (places >= 0) & (places < length)
            seen[name] = np.zeros(length, dtype=bool)
            seen[name][places[within]] = True
            late[name] = int(np.sum((found.received - found.stamps)[within] > self._period / 2))
        # A sample was taken if any message that it caused is there.
        taken = {
            arm: np.any(
                [seen[topic.name] for topic in topics.SIGNALS if topic.source == arm], axis=0
            )
            for arm in ("master", "slave")
        }
        lost = {
            topic.name: int(np.sum(taken[topic.source] & ~seen[topic.name]))
            for topic in topics.SIGNALS
        }
        end = self._start + length * self._period
        nodes: dict[str, dict[str, str]] = {}
        warnings: list[str] = []
        for received, status in self._diagnostics:
            nodes[status.name] = {pair.key: pair.value for pair in status.values}
            # Before and after the trial, nodes wait for each other.
            if self._start <= received < end and status.message != "OK":
                warnings.append(f"{status.name}: {status.message}")
        return Delivery(
            durations(nodes.get("master_device", {}), f"{AGE_OF} age", ("p50", "p99", "max")),
            lost,
            late,
            {arm: length - int(np.sum(found)) for arm, found in taken.items()},
            list(dict.fromkeys(warnings)),
            nodes,
        )


def _read(bag: Path) -> tuple[dict[str, _Series], list[tuple[int, Any]]]:
    """Return the stamped topics by relative name, and statuses with their time of receipt."""
    types = get_typestore(Stores.ROS2_JAZZY)
    rows: dict[str, list[tuple[int, int, float]]] = {
        topic.name: [] for topic in TOPICS if topic is not topics.DIAGNOSTICS
    }
    diagnostics: list[tuple[int, Any]] = []
    try:
        with Reader(bag) as reader:
            for connection, received, data in reader.messages():
                name = _relative(connection.topic)
                message: Any = types.deserialize_cdr(data, connection.msgtype)
                if name in rows:
                    moment = message.header.stamp
                    stamp = moment.sec * NANOSECONDS + moment.nanosec
                    along_actuator = ALONG_ACTUATOR[connection.msgtype](message)
                    rows[name].append((stamp, received, along_actuator))
                elif name == topics.DIAGNOSTICS.name:
                    diagnostics.extend((received, status) for status in message.status)
    except (ReaderError, OSError) as error:
        raise ParameterError(f"{bag}: must be a bag of this graph: {error}") from None
    return {name: _series(found) for name, found in rows.items()}, diagnostics


def _relative(topic: str) -> str:
    """Return a topic's name in our table, whatever namespace the graph had."""
    for known in TOPICS:
        if topic == f"/{known.name}" or topic.endswith(f"/{known.name}"):
            return known.name
    return topic


def _series(rows: list[tuple[int, int, float]]) -> _Series:
    return _Series(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1] for row in rows], dtype=np.int64),
        np.array([row[2] for row in rows], dtype=float),
    )


def _on_grid(places: IntArray, series: _Series, length: int) -> FloatArray:
    """Put samples at their places, each held until the next."""
    within = (places >= 0) & (places < length)
    source = np.full(length, -1)
    source[places[within]] = np.flatnonzero(within)
    # The index of the latest sample at each place; before the first sample, the first.
    source = np.maximum.accumulate(source)
    first = int(np.argmax(within))
    return np.asarray(series.values[np.maximum(source, first)])


def durations(
    values: Mapping[str, str], name: str, labels: Iterable[str] = LABELS
) -> dict[str, float]:
    """Return quantiles, in us, that a node reported; those that it did not are left out."""
    found = {label: values.get(f"{name} {label} (us)") for label in labels}
    return {label: float(value) for label, value in found.items() if value is not None}
