"""What an emulated board may be made to suffer, and when."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.emulators.faults import read_faults

GARBAGE, DROP, STALL, UNPLUG = "garbage", "drop", "stall", "unplug"

FAULTS = {
    GARBAGE: "bytes come that nobody sent",
    DROP: "bytes are lost",
    STALL: "nothing passes for a while, then all of it",
    UNPLUG: "the port is gone for a while, and the board without power",
}
"""Every fault there is, and what it does."""

OFTEN = {GARBAGE: 20.0, DROP: 20.0, STALL: 0.5, UNPLUG: 0.1}
"""How often a second a fault happens that has no time."""


@dataclass(frozen=True)
class PlannedFault:
    """A fault at a time in s, or without one, now and then."""

    name: str
    time: float | None = None


def parse_faults(text: str) -> list[PlannedFault]:
    """Read words such as ``garbage,stall@3,unplug@8``.

    Raises
    ------
    ParameterError
        An unknown fault, or a time that is none.
    """
    return [PlannedFault(name, begin) for name, begin in read_faults(text, FAULTS)]
