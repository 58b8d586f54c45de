"""What a bag says of one condition: signals on the sampling grid, and how samples travelled."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from haptic_accel.bags.reading import Bag, Signal, read_bag
from haptic_accel.core import topics
from haptic_accel.core.evaluation.histogram import QUANTILES
from haptic_accel.core.identification import RecordingError
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS, on_grid, places
from haptic_accel.core.topics import ACTUATOR_AXIS, Topic
from haptic_accel.core.trial import Trial

SIGNALS: dict[str, Topic] = {
    "tool_acceleration": topics.TOOL_ACCELERATION,
    "desired_acceleration": topics.DESIRED_ACCELERATION,
    "handle_acceleration": topics.HANDLE_ACCELERATION,
    "actuator_force": topics.ACTUATOR_FORCE,
}
"""A trial's signals and the topics they come from."""


AGE_OF = "actuator force"
"""Which command's age counts: the one whose force is felt."""

LABELS = (*QUANTILES, "max")
"""Of durations in diagnostics."""

SAME_PERIOD = 0.1
"""By how much of itself the median of periods may differ from the expected one."""


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
    recorded = _Coupled(read_bag(bag), rate)
    signals = {
        name: _along_actuator(recorded.signals[topic.name], recorded.start, rate, recorded.length)[
            0
        ]
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
    signals = read_bag(bag).signals
    for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION):
        if topic.name not in signals or len(signals[topic.name].stamps) < 2:
            raise RecordingError(f"{bag}: has no {topic.name}")
    force, acceleration = (
        signals[topic.name] for topic in (topics.ACTUATOR_FORCE, topics.HANDLE_ACCELERATION)
    )
    period = NANOSECONDS / rate
    found = float(np.median(np.diff(acceleration.stamps)))
    if abs(found - period) > SAME_PERIOD * period:
        raise RecordingError(
            f"{bag}: {topics.HANDLE_ACCELERATION.name} has {NANOSECONDS / found:.5g} samples per"
            f" second, must have rate = {rate:g} Hz"
        )
    start = int(acceleration.stamps[0])
    length = round((int(acceleration.stamps[-1]) - start) / period) + 1

    held, _ = _along_actuator(force, start, rate, length)
    sampled, seen = _along_actuator(acceleration, start, rate, length)
    return held, sampled, ~seen


def read_force_age(bag: Path) -> float:
    """Return the median age of the actuator's forces where they were applied, s.

    0 where the bag has no diagnostics of it.

    Raises
    ------
    ParameterError
        It is not a bag.
    """
    found = [said for said in read_bag(bag).diagnostics if said.node == "master_device"]
    if not found:
        return 0.0
    return durations(found[-1].values, f"{AGE_OF} age", ("p50",)).get("p50", 0.0) * 1e-6


def read_delivery(bag: Path, rate: float) -> Delivery:
    """Return how samples travelled, from a bag of the graph at a rate in Hz.

    Raises
    ------
    ParameterError
        It is not a bag, or lacks a signal.
    """
    return _Coupled(read_bag(bag), rate).delivery()


class _Coupled:
    """A bag's content, and the stretch of the sampling grid on which every signal was there."""

    def __init__(self, recorded: Bag, rate: float) -> None:
        self.signals = recorded.signals
        self._diagnostics = recorded.diagnostics
        self._rate, self._period = rate, NANOSECONDS / rate
        needed = [topic.name for topic in (*SIGNALS.values(), topics.MASTER_ARM_FORCE)]
        for name in needed:
            if name not in self.signals:
                raise ParameterError(f"{recorded.path}: has no message of {name}")
        self.start = int(max(self.signals[name].stamps[0] for name in needed))
        end = int(min(self.signals[name].stamps[-1] for name in needed))
        self.length = round((end - self.start) / self._period) + 1
        if self.length < 2:
            raise ParameterError(f"{recorded.path}: its signals do not overlap")

    def delivery(self) -> Delivery:
        """Count what is missing on the grid and what came late, and find the ages."""
        late: dict[str, int] = {}
        seen: dict[str, npt.NDArray[np.bool_]] = {}
        length = self.length
        for topic in topics.SIGNALS:
            seen[topic.name] = np.zeros(length, dtype=bool)
            late[topic.name] = 0
        for name, found in self.signals.items():
            where = places(found.stamps, self.start, self._rate)
            within = (where >= 0) & (where < length)
            seen[name][where[within]] = True
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
        end = self.start + length * self._period
        nodes: dict[str, dict[str, str]] = {}
        warnings: list[str] = []
        for said in self._diagnostics:
            nodes[said.node] = said.values
            # Before and after the trial, nodes wait for each other.
            if self.start <= said.received < end and said.message != "OK":
                warnings.append(f"{said.node}: {said.message}")
        return Delivery(
            durations(nodes.get("master_device", {}), f"{AGE_OF} age", ("p50", "p99", "max")),
            lost,
            late,
            {arm: length - int(np.sum(found)) for arm, found in taken.items()},
            list(dict.fromkeys(warnings)),
            nodes,
        )


def _along_actuator(
    signal: Signal, start: int, rate: float, length: int
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return a signal's component on the grid, and which of its samples are there."""
    where = places(signal.stamps, start, rate)
    return on_grid(where, signal.values[:, ACTUATOR_AXIS], length)


def durations(
    values: Mapping[str, str], name: str, labels: Iterable[str] = LABELS
) -> dict[str, float]:
    """Return quantiles, in us, that a node reported; those that it did not are left out."""
    found = {label: values.get(f"{name} {label} (us)") for label in labels}
    return {label: float(value) for label, value in found.items() if value is not None}
