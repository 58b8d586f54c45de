"""How faults that an emulator is to show, and their times, are written."""

from __future__ import annotations

import math
from collections.abc import Iterable

from haptic_accel.core.parameters import ParameterError


def read_faults(text: str, known: Iterable[str]) -> list[tuple[str, float | None]]:
    """Read words such as ``drop,error@3,unplug@8``.

    Parameters
    ----------
    text : str
        Faults with commas between, each with the time of its beginning in s after an @, or
        without one.
    known : iterable of str
        Faults there are.

    Returns
    -------
    list of tuple
        Each fault and its time, None where there is none.

    Raises
    ------
    ParameterError
        An unknown fault, or a time that is none.
    """
    faults: list[tuple[str, float | None]] = []
    for word in text.split(",") if text else []:
        name, at, when = word.strip().partition("@")
        try:
            begin = float(when) if at else 0.0
        except ValueError:
            begin = math.nan
        if name not in known or not 0 <= begin < math.inf:
            names = ", ".join(known)
            raise ParameterError(f"faults: {word!r}: must be NAME or NAME@SECONDS of {names}")
        faults.append((name, begin if at else None))
    return faults
