# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Columns of a file: quantities, units, choice by name, and sampling rate from time columns.

CSV files are read with units, times and either decimal sign.

A title may state a unit: ``ax [g]``, ``acceleration (mm/s^2)``, ``acc_mg``, ``force mN``. Any text
in brackets except an axis is a unit. Without brackets, only a known unit after a blank,
underscore, comma or slash is a unit.
"""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import re
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, read_decimal, shown, warn_once
from haptic_accel.core.sampling import MOST_SAMPLES, RATE_TOLERANCE, checked_rate

STANDARD_GRAVITY = 9.80665
"""Acceleration g_n, m/s^2 (ISO 80000-3)."""

LENGTHS = {
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6},
    **{"in": 0.0254, "ft": 0.3048},
}
"""Metres in units of length."""

AXES = ("x", "y", "z", "0", "1", "2", "3")
"""Names of axes, which may also be in brackets."""

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
        Unit of the values that are read.
    examples : str
        Examples of units for messages.
    units : mapping
        Factor to the SI unit, by name of the unit.
    pattern : re.Pattern, optional
        Pattern of units that begin with a length, which is the group ``length``.
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


_ACCELERATIONS = {
    **dict.fromkeys(("g", "G", "gn", "g_n", "g0"), STANDARD_GRAVITY),
    **dict.fromkeys(("mg", "mG"), 1e-3 * STANDARD_GRAVITY),
    **dict.fromkeys(("ug", "\u00b5g", "\u03bcg"), 1e-6 * STANDARD_GRAVITY),
}
_FORCES = {
    **dict.fromkeys(("N", "n", "newton", "newtons", "Newton"), 1.0),
    **dict.fromkeys(("mN", "mn"), 1e-3),
    **{"kN": 1e3, "gf": 1e-3 * STANDARD_GRAVITY, "kgf": STANDARD_GRAVITY, "lbf": 4.4482216},
}
_TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "\u00b5s", "\u03bcs", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e-9),
    **{"min": 60.0, "h": 3600.0},
}

_EXAMPLES = "m/s^2, mm/s^2, g or mg"
ACCELERATION = Quantity("m/s^2", "m/s^2", _EXAMPLES, _ACCELERATIONS, _PER_SECOND_SQUARED)
FORCE = Quantity("N", "N", "N or mN", _FORCES)
SPEED = Quantity("mm/s", "m/s", "mm/s or m/s", {}, _PER_SECOND)
"""Speed along a surface; mm/s if the unit is missing, as in files of the Penn Haptic Texture
Toolkit."""

TIME = Quantity("s", "s", "s, ms, us or ns", _TIMES)

COLUMNS = ("acceleration", "accel", "acc", "a")
"""Default column names for acceleration in a CSV file, in order of preference."""

TIME_NAMES = (
    *("time", "times", "t", "timestamp", "timestamps", "stamp"),
    *("time_stamp", "time stamp", "elapsed_time", "elapsed time"),
)
"""Names, in lower case, of columns that contain sample times regardless of their values."""

MOST_CHANNELS = 64
"""Maximum number of channels of a WAV or NPZ file: 21 sensors with three axes and their times."""


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


@dataclass(frozen=True)
class ColumnChoice:
    """Column to read: its names in order of preference, and its quantity."""

    names: Sequence[str]
    quantity: Quantity = ACCELERATION


def named_time(title: str) -> bool:
    """Return whether a title is a common name for sample times."""
    return TIME.parsed(title)[0].strip(" %_").casefold() in TIME_NAMES


def time_unit(title: str) -> str:
    """Return the unit of time in a title, which may be the whole title; empty if none."""
    name, unit = TIME.parsed(title)
    whole = name if len(name) > 1 else ""
    return next((each for each in (unit, unit.casefold(), whole) if each in TIME.units), "")


def chosen(file: str, column: ColumnChoice, titles: Sequence[str], wording: Wording) -> int:
    """Return the index of a requested column.

    Raises
    ------
    ParameterError
        There is no such column, or more than one.
    """
    bare = [column.quantity.parsed(title)[0] for title in titles]
    for name in column.names:
        for known in (titles, bare):
            if known.count(name) > 1:
                raise ParameterError(f"{file}: column = {shown(name)}: exists more than once")
            if name in known:
                return known.index(name)
    chooses = column.quantity is ACCELERATION
    raise missing(file, "column", column.names, titles, wording if chooses else Wording(column=""))


def missing(
    file: str, kind: str, names: Sequence[str], titles: Sequence[str], wording: Wording
) -> ParameterError:
    """Return the error for a column or channel that a file does not have."""
    three = ", or x, y and z with NAME,NAME,NAME" if "," in names[0] else ""
    advice = f"; choose one with {wording.column}{three}" if wording.column else ""
    return ParameterError(
        f"{file}: {kind} = {shown(' or '.join(names))}: no such {kind}; "
        f"there are {shown(', '.join(titles))}{advice}"
    )


def factor_of(file: str, title: str, quantity: Quantity) -> float:
    """Return the factor from a column to the SI unit, and log a conversion.

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


# Times

TOLERANCE = 1e-3
"""Maximum relative difference between the stated rate and that of the times: the accuracy of
stamps in whole milliseconds over one second."""

USUAL_SHARE = 0.9
"""Minimum fraction of steps within half of the median step; otherwise the stamps are coarse or the
sampling is uneven."""

MOST_UNEVEN = 0.01
"""Maximum fraction of uneven steps, and maximum distance of a sample from an even grid relative to
the recording's length."""

JITTER = 0.1
"""Standard deviation of the steps relative to their mean above which a message is logged; maximum
deviation of most steps from their median for values without a unit to count as times."""

FEWEST = 8
"""Minimum number of steps for recognising a column of times."""

COUNT = 1.0
"""Step of values without a unit that count samples."""

Where = Callable[[int], str]
"""Function from a sample's index to its line in a file, or similar location."""

LOWEST, HIGHEST = 100.0, 1e5
"""Range of rates in which times without unit have only one possible unit, Hz: three decades, the
factor between s, ms, us and ns."""


def is_time(title: str, values: FloatArray) -> bool:
    """Return whether a column holds the times of its samples, by title, unit and content.

    Values with a unit of time are times if most of them increase. Values without unit are times if
    all increase, most of them evenly, and they do not count samples.

    Parameters
    ----------
    title : str
    values : ndarray, shape (n,)
        NaN where the file has no number.
    """
    steps = np.diff(values)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if named_time(title):
        return True
    if time_unit(title):
        return bool((steps > 0).any() and np.mean(steps >= 0) >= USUAL_SHARE)
    even = np.abs(steps - usual) <= JITTER * usual
    rises = len(steps) >= FEWEST and steps.min() > 0 and usual != COUNT
    return bool(rises and even.mean() >= USUAL_SHARE)


def rate_of_times(
    location: str, title: str, times: FloatArray, where: Where, stated: float, argument: str
) -> float:
    """Return the sampling rate of a recording from a column that may be times; see `is_time`.

    Parameters
    ----------
    location : str
        File and kind of column in messages.
    title : str
    times : ndarray, shape (n,)
        Time of each sample, in the title's unit; NaN where the file has no number.
    where : callable
        Function from a sample's index to its line, or similar location.
    stated : float
        Sampling rate stated by the user, Hz; 0 if it is not stated.
    argument : str
        Name of the stated rate in messages.

    Returns
    -------
    float
        Samples per second: the stated rate, if the times agree with it. A rate from a column
        without a name of times is logged.

    Raises
    ------
    ParameterError
        The times go back, are uneven, contradict the stated rate, or do not determine a rate.
    """
    if len(times) < 2 or not is_time(title, times):
        return stated
    location, unit = f"{location} {shown(title)}", time_unit(title)
    wrong = np.flatnonzero(~np.isfinite(times))
    if len(wrong) == len(times) or (TIME.parsed(title)[1] and not unit):
        warn_once(f"{location} has no numbers in s, ms, us or ns: not compared with the rate")
        return stated
    if len(wrong):
        raise ParameterError(f"{location}, {where(int(wrong[0]))}: must be a finite number")
    period, uncertainty = _period(location, times, where)
    factors = {unit: TIME.units[unit]} if unit else {each: TIME.units[each] for each in _SCALES}
    rates = {name: 1.0 / (period * factor) for name, factor in factors.items()}
    if stated:
        if any(abs(rate / stated - 1) <= TOLERANCE + uncertainty for rate in rates.values()):
            return stated
        likely = [rate for rate in rates.values() if unit or LOWEST <= rate < HIGHEST]
        says = f"says {_whole(likely[0]):g} Hz" if likely else f"has steps of {period:g}"
        advice = "" if unit or named_time(title) else "; or its title must say its unit, as x [mm]"
        raise ParameterError(f"{location} {says}, {argument} = {stated:g}: must agree{advice}")
    rate = rates[unit or TIME.unit]
    if not unit and not LOWEST <= rate < HIGHEST:
        raise ParameterError(
            f"{location} has steps of {period:g} without a unit: must state it, such as"
            f" time_ms, or {argument} must be given"
        )
    if uncertainty > TOLERANCE:
        raise ParameterError(f"{location} is too coarse for a rate: {argument} must be given")
    rate = checked_rate(f"{location}: sampling rate", _whole(rate))
    if not named_time(title):
        warn_once(f"{location} is taken as the times, in {unit or TIME.unit}: {rate:g} Hz")
    return rate


_SCALES = ("s", "ms", "us", "ns")


def _whole(rate: float) -> float:
    """Return a rate rounded to whole hertz, if the difference is within the usual tolerance."""
    whole = float(round(rate))
    return whole if math.isclose(rate, whole, rel_tol=RATE_TOLERANCE) else rate


def _period(location: str, times: FloatArray, where: Where) -> tuple[float, float]:
    """Return the mean step of even times, and its relative uncertainty.

    If times are rounded to more than half of the step, only the total duration is used.
    """
    steps = np.diff(times)
    back = np.flatnonzero(steps < 0)
    if len(back):
        at = int(back[0])
        raise ParameterError(
            f"{location} goes back at {where(at + 1)}, from {times[at]:.15g} to"
            f" {times[at + 1]:.15g}: must rise"
        )
    length = float(times[-1] - times[0])
    if length <= 0:
        raise ParameterError(f"{location} is always {times[0]:.15g}: must rise")
    usual = float(np.median(steps))
    ordinary = np.abs(steps - usual) <= 0.5001 * usual
    if np.mean(ordinary) < USUAL_SHARE:
        period = length / len(steps)
        # Allow for rounding of these times, and of the first and last time.
        most = 2.0 * float(steps[steps > 0].min())
        if np.ptp(times - times[0] - period * np.arange(len(times))) > most:
            raise _uneven(location, steps, period, where)
        return period, most / 2.0 / length
    period = float(steps[ordinary].mean())
    odd = np.flatnonzero(~ordinary)
    grid = times[0] + period * np.arange(len(times))
    apart = float(np.abs(times - grid).max())
    if len(odd) > MOST_UNEVEN * len(steps) or apart > max(MOST_UNEVEN * length, 1.5 * period):
        raise _uneven(location, steps, period, where)
    away = np.abs(steps - period)
    if len(odd) or steps.std() > JITTER * period:
        count, worst = np.count_nonzero(away > JITTER * period), int(np.argmax(away))
        warn_once(
            f"{location}: {count} of {len(steps)} steps are not {period:g}, such as"
            f" {steps[worst]:g} before {where(worst + 1)}: samples are taken as even"
        )
    return period, 0.0


def _uneven(location: str, steps: FloatArray, period: float, where: Where) -> ParameterError:
    worst = int(np.argmax(np.abs(steps - period)))
    return ParameterError(
        f"{location} is uneven: steps are {period:g} on average, {steps[worst]:g} before"
        f" {where(worst + 1)}: samples must have a constant rate"
    )


LARGEST_VALUE = 1.0e6
"""Maximum magnitude of a value in SI units; larger values indicate another quantity."""

LONGEST_LINE = 1 << 16
"""Maximum length of a line of a CSV file, characters."""

SEPARATORS = ",;\t"
"""Characters between columns."""

COMMENT = "#"
"""Start of a line that is skipped."""

MOST_COMMENTS = 100
"""Maximum number of comments that are kept, the last of which may contain the titles; the same
maximum applies to comments with a frequency."""

FIRST_ROWS = 50
"""Number of rows whose values show which columns may be times."""

_QUOTED = re.compile(r'"[^"]*"|\[[^\]]*\]')
_FREQUENCY = re.compile(r"([0-9]{1,9}(?:[.,][0-9]{1,9})?) ?([kK])?(?:Hz|HZ|hz|S/s|sps|SPS)\b")
_MARKS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
"""Encodings by byte-order mark; without one of these a file is UTF-8."""


def read_csv(
    name: str,
    file: io.BufferedReader,
    columns: Sequence[ColumnChoice],
    rate: float,
    wording: Wording,
) -> tuple[list[FloatArray], float]:
    """Return columns of numbers in SI units, and the sampling rate.

    Parameters
    ----------
    name : str
        Name of the file in messages.
    file : BufferedReader
        The open file, at its start.
    columns : sequence of Column
    rate : float
        Stated sampling rate, Hz; 0 to use that of the file's times.
    wording : Wording

    Returns
    -------
    columns : list of ndarray, shape (n,)
    rate : float
        Samples per second; 0 if neither the file nor the user states it.

    Raises
    ------
    ParameterError
        The file is not a table of numbers, or contradicts itself or the stated rate.
    """
    try:
        return _Table(name, file).read(columns, rate, wording)
    except UnicodeError:
        raise ParameterError(f"{name}: is not text, must be a CSV or WAV file") from None
    except csv.Error as error:
        raise ParameterError(
            f"{name}: {shown(str(error))}: must be comma-separated values"
        ) from None


class _Table:
    """Rows of a CSV file below its titles; columns without titles are numbered."""

    def __init__(self, name: str, file: io.BufferedReader) -> None:
        self._name = name
        self._line = 0
        self._decimal = ""
        self._comments: list[str] = []
        encoding = _MARKS.get(file.peek(2)[:2], "utf-8-sig")
        lines = self._lines(io.TextIOWrapper(file, encoding=encoding, newline=""))
        header = next((line for line in lines if not line.isspace()), "")
        between = _between_numbers(header)
        self._separator = between or _separator(header)
        lines = itertools.chain([header], lines)
        self._rows: Iterator[list[str]] = csv.reader(
            map(str.strip, lines) if between == " " else lines,
            delimiter=self._separator,
            skipinitialspace=True,
            strict=True,
        )
        self._titles = [title.strip() for title in next(self._rows)]
        if between:
            self._rows = itertools.chain([self._titles], self._rows)
            self._titles = self._titles_above(len(self._titles))

    def _titles_above(self, count: int) -> list[str]:
        """Return the titles in the last comment, as written by `numpy.savetxt`, or numbers."""
        if self._comments:
            comment = self._comments[-1].lstrip(f"{COMMENT} ")
            titles = [each.strip() for each in comment.split(_separator(comment))]
            if len(titles) == count and " " not in ACCELERATION.parsed(titles[0])[0]:
                self._comments.pop()
                return titles
        return [str(number + 1) for number in range(count)]

    def read(
        self, columns: Sequence[ColumnChoice], rate: float, wording: Wording
    ) -> tuple[list[FloatArray], float]:
        """Return the columns and the sampling rate; see `read_csv`."""
        rows = ((self._line, row) for row in self._rows if any(row))
        first = list(itertools.islice(rows, FIRST_ROWS))
        times = self._times(first)
        indices = [self._chosen(column, times, wording) for column in columns]
        selected = [
            (index, column.quantity, factor_of(self._name, self._titles[index], column.quantity))
            for index, column in zip(indices, columns, strict=True)
        ]
        stamps = {index: array("d") for index in times if index not in indices}
        values, lines = [array("d") for _ in columns], array("I")
        for line, row in itertools.chain(first, rows):
            self._check(line, row)
            for (index, quantity, factor), numbers in zip(selected, values, strict=True):
                numbers.append(self._value(line, row, index, quantity, factor))
            for index, numbers in stamps.items():
                numbers.append(self._number(_field(row, index)))
            lines.append(line)
            if len(lines) > MOST_SAMPLES:
                raise ParameterError(f"{self._name}: must have at most {MOST_SAMPLES} samples")

        def line_of(sample: int) -> str:
            return f"line {lines[sample]}"

        prefix = f"{self._name}: column"
        for index, numbers in stamps.items():
            title, found = self._titles[index], np.array(numbers)
            rate = rate_of_times(prefix, title, found, line_of, rate, wording.rate)
        self._warn_of_comments(rate)
        return [np.array(each, dtype=np.float64) for each in values], rate

    def _times(self, first: Sequence[tuple[int, Sequence[str]]]) -> list[int]:
        """Return the columns that contain times, according to titles or first values."""
        return [
            index
            for index, title in enumerate(self._titles)
            if time_unit(title)
            or is_time(title, np.array([_plain(_field(row, index)) for _, row in first]))
        ]

    def _chosen(self, column: ColumnChoice, times: Sequence[int], wording: Wording) -> int:
        """Return the index of a column; without titles, the only column that is not times."""
        left = [index for index in range(len(self._titles)) if index not in times]
        is_numbered = all(map(str.isdecimal, self._titles))
        if not is_numbered or column.names[0] in self._titles:
            return chosen(self._name, column, self._titles, wording)
        if column.names != COLUMNS or len(left) != 1:
            free = wording.column if column.quantity is ACCELERATION else ""
            advice = f"choose one with {free}" if free else "add titles"
            raise ParameterError(
                f"{self._name}: has no titles, but columns {', '.join(self._titles)}: {advice}"
            )
        warn_once(f"{self._name}: column {self._titles[left[0]]}: taken as the acceleration")
        return left[0]

    def _check(self, line: int, row: Sequence[str]) -> None:
        """Reject a row with more values than titles, except for the index column of pandas."""
        for index, text in enumerate(row):
            if text and (index >= len(self._titles) or (index and not self._titles[index])):
                commas = "; decimal commas need semicolons or tabs between columns"
                raise ParameterError(
                    f"{self._name}: line {line}: {text[:40]!r} in a column without a title: must"
                    f" have one{commas if self._separator == ',' else ''}"
                )

    def _value(
        self, line: int, row: Sequence[str], index: int, quantity: Quantity, factor: float
    ) -> float:
        text = _field(row, index)
        value = self._number(text) * factor
        if abs(value) <= LARGEST_VALUE:
            return value
        sign = f" with {self._decimal!r} for decimals, as in the lines before"
        other = {".": ",", ",": "."}.get(self._decimal)
        raise ParameterError(
            f"{self._name}: line {line}: {shown(self._titles[index])} = {text[:40]!r}: must be"
            f" a number from {-LARGEST_VALUE:g} to {LARGEST_VALUE:g} {quantity.si_unit}"
            f"{sign if other and other in text else ''}"
        )

    def _number(self, text: str) -> float:
        """Return a number with the file's decimal sign; NaN for any other text."""
        if sign := "," if "," in text else "." if "." in text else "":
            self._decimal = self._decimal or sign
        return _plain(text) if not sign or sign == self._decimal else math.nan

    def _warn_of_comments(self, rate: float) -> None:
        """Log comments, especially a comment with another rate."""
        if not self._comments:
            return
        stating = [comment for comment in self._comments if _FREQUENCY.search(comment)]
        found = _FREQUENCY.findall("\n".join(stating))
        rates = (
            float(number.replace(",", ".")) * (1e3 if kilo else 1.0) for number, kilo in found
        )
        agrees = any(math.isclose(rate, each, rel_tol=1e-3) for each in rates)
        used = f", though {rate:g} Hz is used" if rate and stating and not agrees else ""
        warn_once(
            f"{self._name}: lines that begin with {COMMENT} are not read, such as"
            f" {shown((stating or self._comments)[0])}{used}"
        )

    def _lines(self, text: io.TextIOWrapper) -> Iterator[str]:
        """Yield the lines of a text without comments; reject long lines."""
        while line := text.readline(LONGEST_LINE + 1):
            self._line += 1
            if len(line) > LONGEST_LINE:
                raise ParameterError(f"{self._name}: a line exceeds {LONGEST_LINE} characters")
            if "\0" in line:
                raise UnicodeError
            if not line.startswith(COMMENT):
                yield line
            elif len(self._comments) < MOST_COMMENTS * (2 if _FREQUENCY.search(line) else 1):
                self._comments.append(line.rstrip())


def _field(row: Sequence[str], index: int) -> str:
    return row[index] if index < len(row) else ""


def _separator(header: str) -> str:
    """Return the most frequent separator outside of quotes and brackets."""
    bare = _QUOTED.sub("", header)
    return max(SEPARATORS, key=bare.count)


def _between_numbers(line: str) -> str:
    """Return the separators between the numbers of a line; empty for a line with other texts."""
    for separator in (*reversed(SEPARATORS), " "):
        texts = line.split(separator) if separator != " " else line.split()
        if texts and all(not math.isnan(_plain(each.strip())) for each in texts):
            return separator
    return ""


def _plain(text: str) -> float:
    """Return a number with either decimal sign; NaN for any other text."""
    try:
        return read_decimal(text.replace(",", "."))
    except ValueError:
        return math.nan
