# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Titles of columns: quantity, unit, and choice of a column by name.

A title may state a unit: ``ax [g]``, ``acceleration (mm/s^2)``, ``acc_mg``, ``force mN``. In
brackets any text but an axis is a unit. Without brackets only a known unit is one, after a blank,
underscore, comma or slash.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.warning import warn_once

STANDARD_GRAVITY = 9.80665
"""Acceleration g_n, m/s^2 (ISO 80000-3)."""

LENGTHS = {
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6},
    **{"in": 0.0254, "ft": 0.3048},
}
"""Metres in units of length."""

AXES = ("x", "y", "z", "0", "1", "2", "3")
"""Axes, which may be in brackets as well."""

WITHOUT_SCALE = (
    *("count", "counts", "lsb", "LSB", "raw", "adc", "ADC", "digit", "digits"),
    *("V", "mV", "volt", "volts"),
)
"""Units of a sensor's output, whose scale the file does not state."""

_BRACKETED = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>.*)\))")
_SEPARATOR = re.compile(r"[ _,/:]+")
_LENGTH = f"(?P<length>{'|'.join(sorted(LENGTHS, key=len, reverse=True))})"
_PER = r" ?(?:/|_per_| per |_|p) ?"
_PER_SECOND = re.compile(
    rf"{_LENGTH}(?:{_PER}(?:s|sec)|[ .\u00b7\u22c5*]s(?:\^|\*\*)?(?:-1|\u207b\u00b9))"
)
_PER_SECOND_SQUARED = re.compile(
    rf"{_LENGTH}(?:(?:{_PER})?(?:s|sec)(?:\^|\*\*|_)?(?:2|\u00b2)|/s/s"
    r"|[ .\u00b7\u22c5*]?s(?:\^|\*\*)?(?:-2|\u207b\u00b2))"
)


@dataclass(frozen=True)
class Quantity:
    """Physical quantity of a column.

    Attributes
    ----------
    unit : str
        Unit of a column without a unit in its title.
    si_unit : str
        Unit of what is read.
    examples : str
        Units for messages.
    units : mapping
        Factor to the SI unit by unit.
    pattern : re.Pattern, optional
        Units that begin with a length, as a group of this name.
    """

    unit: str
    si_unit: str
    examples: str
    units: Mapping[str, float]
    pattern: re.Pattern[str] | None = field(default=None, repr=False)

    def factor(self, unit: str) -> float | None:
        """Return the factor from a unit to SI units; None for an unknown unit."""
        match = self.pattern.fullmatch(unit) if self.pattern else None
        return LENGTHS[match["length"]] if match else self.units.get(unit)

    def parsed(self, title: str) -> tuple[str, str]:
        """Return name and unit in a title; the unit is empty if the title states none."""
        if match := _BRACKETED.fullmatch(title):
            unit = (match["square"] or match["round"] or "").strip()
            name = match["name"].rstrip(" _/,:")
            return (title, "") if unit.lower() in AXES else (name, unit)
        for separator in _SEPARATOR.finditer(title):
            name, unit = title[: separator.start()], title[separator.end() :]
            if name and (unit in WITHOUT_SCALE or self.factor(unit) is not None):
                return re.sub("[ _]in$", "", name).rstrip(" _/,:"), unit
        return title, ""


ACCELERATION = Quantity(
    "m/s^2",
    "m/s^2",
    "m/s^2, mm/s^2, g or mg",
    {
        **dict.fromkeys(("g", "G", "gn", "g_n", "g0"), STANDARD_GRAVITY),
        **dict.fromkeys(("mg", "mG"), 1e-3 * STANDARD_GRAVITY),
        **dict.fromkeys(("ug", "\u00b5g", "\u03bcg"), 1e-6 * STANDARD_GRAVITY),
    },
    _PER_SECOND_SQUARED,
)
FORCE = Quantity(
    "N",
    "N",
    "N or mN",
    {
        **dict.fromkeys(("N", "n", "newton", "newtons", "Newton"), 1.0),
        **dict.fromkeys(("mN", "mn"), 1e-3),
        **{"kN": 1e3, "gf": 1e-3 * STANDARD_GRAVITY, "kgf": STANDARD_GRAVITY, "lbf": 4.4482216},
    },
)
SPEED = Quantity("mm/s", "m/s", "mm/s or m/s", {}, _PER_SECOND)
"""Speed along a surface; without unit in mm/s, as in files of the Penn Haptic Texture Toolkit."""

TIME = Quantity(
    "s",
    "s",
    "s, ms, us or ns",
    {
        **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
        **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
        **dict.fromkeys(("us", "usec", "\u00b5s", "\u03bcs", "microseconds"), 1e-6),
        **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
        **{"min": 60.0, "h": 3600.0},
    },
)

TIME_NAMES = (
    *("time", "times", "t", "timestamp", "timestamps", "stamp"),
    *("time_stamp", "time stamp", "elapsed_time", "elapsed time"),
)
"""Names of columns with the times of samples, in small letters."""


@dataclass(frozen=True)
class Wording:
    """Names, in messages, of the arguments that describe a file.

    Attributes
    ----------
    rate : str
        Argument or option with the sampling rate.
    column : str
        Argument or option that chooses a column of acceleration; empty if its name is fixed.
    """

    rate: str = "recording_rate"
    column: str = "recording_column:=NAME"


THREE_NAMES = "NAME,NAME,NAME"
"""Form, in messages, of a choice of three columns."""

FIXED = Wording(column="")
"""Wording for columns whose names no argument changes."""


@dataclass(frozen=True)
class Column:
    """Column to read: its names in order of preference, and its quantity."""

    names: Sequence[str]
    quantity: Quantity = ACCELERATION


def is_time(title: str) -> bool:
    """Return whether a title is that of the times of samples."""
    return TIME.parsed(title)[0].strip(" %_").casefold() in TIME_NAMES


def chosen(file: str, column: Column, titles: Sequence[str], wording: Wording) -> int:
    """Return the index of a requested column.

    Raises
    ------
    ParameterError
        There is none, or more than one.
    """
    bare = [column.quantity.parsed(title)[0] for title in titles]
    for name in column.names:
        for known in (titles, bare):
            if known.count(name) > 1:
                raise ParameterError(f"{file}: column = {shown(name)}: exists more than once")
            if name in known:
                return known.index(name)
    chooses = column.quantity is ACCELERATION
    raise missing(file, "column", column.names, titles, wording if chooses else FIXED)


def missing(
    file: str, kind: str, names: Sequence[str], titles: Sequence[str], wording: Wording
) -> ParameterError:
    """Return the error for a column or channel that a file does not have."""
    advice = f"; choose one with {wording.column}" if wording.column else ""
    return ParameterError(
        f"{file}: {kind} = {shown(' or '.join(names))}: no such {kind}; "
        f"there are {shown(', '.join(titles))}{advice}"
    )


def factor_of(file: str, title: str, quantity: Quantity) -> float:
    """Return the factor from a column to the SI unit, and tell the user of a conversion.

    Raises
    ------
    ParameterError
        The title states a unit that cannot be converted.
    """
    unit = quantity.parsed(title)[1] or quantity.unit
    factor = quantity.factor(unit)
    if factor is None:
        raise ParameterError(
            f"{file}: column {shown(title)} is in {shown(unit)}: must be in {quantity.examples},"
            f" or without a unit, which means {quantity.unit}"
        )
    if factor != quantity.factor(quantity.unit):
        warn_once(f"{file}: column {shown(title)}: converted from {unit} to {quantity.unit}")
    return factor
