"""What an emulated bus and its drives may be made to do wrong, and when."""

from __future__ import annotations

import math
from dataclasses import dataclass

from haptic_accel.emulators.faults import read_faults

DROP, GARBAGE, AXIS_ERROR, HEARTBEAT = "drop", "garbage", "error", "heartbeat"
ESTIMATES, BUS_OFF, UNPLUG = "estimates", "bus_off", "unplug"

FAULTS = {
    DROP: "one frame in twenty is lost",
    GARBAGE: "one frame in twenty is replaced by one that is random",
    AXIS_ERROR: "an axis has an error until it is cleared",
    HEARTBEAT: "an axis sends no heartbeats",
    ESTIMATES: "an axis sends no estimates",
    BUS_OFF: "nothing passes, but the adapter is there",
    UNPLUG: "the adapter is gone",
}
"""Every fault there is, and what it does."""

SHARE = 0.05
"""Of frames, that `DROP` and `GARBAGE` spoil."""


@dataclass(frozen=True)
class Fault:
    """One fault.

    Attributes
    ----------
    name : str
        Of `FAULTS`.
    begin, end : float
        When, s.
    """

    name: str
    begin: float
    end: float


class Faults:
    """Faults and their times.

    Parameters
    ----------
    faults : list of Fault
    """

    def __init__(self, faults: list[Fault]) -> None:
        self._faults = faults

    def active(self, name: str, time: float) -> bool:
        """Whether a fault is there at a time, s."""
        return any(f.name == name and f.begin <= time < f.end for f in self._faults)

    def begins(self, name: str, time: float, before: float) -> bool:
        """Whether a fault begins after one time and not after another, s."""
        return any(f.name == name and before < f.begin <= time for f in self._faults)


def parse_faults(text: str, seconds: float) -> Faults:
    """Read words such as ``drop,error@3,unplug@8``.

    Parameters
    ----------
    text : str
        Faults with commas between; with the time of its beginning in s after an @ a fault is
        there for a while, without from the beginning to the end.
    seconds : float
        That while.

    Raises
    ------
    ParameterError
        An unknown fault, or a time that is none.
    """
    return Faults(
        [
            Fault(name, 0.0, math.inf) if begin is None else Fault(name, begin, begin + seconds)
            for name, begin in read_faults(text, FAULTS)
        ]
    )
