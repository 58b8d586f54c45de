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

"""Reader of columns of CSV files, with their units, times and decimal sign."""

from __future__ import annotations

import codecs
import csv
import io
import itertools
import math
import re
from array import array
from collections.abc import Iterator, Sequence

import numpy as np

from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, shown, warn_once
from haptic_accel.core.sampling import MOST_SAMPLES
from haptic_accel.materials.columns import (
    ACCELERATION,
    COLUMNS,
    Column,
    Quantity,
    Wording,
    chosen,
    factor_of,
    is_time,
    rate_of_times,
    time_unit,
)

LARGEST_VALUE = 1.0e6
"""Maximum magnitude of a value in SI units; a file that exceeds it contains something else."""

LONGEST_LINE = 1 << 16
"""Maximum length of a line of a CSV file, characters."""

SEPARATORS = ",;\t"
"""Characters between columns."""

COMMENT = "#"
"""Start of a line that is skipped."""

MOST_COMMENTS = 100
"""Maximum number of comments that are kept, of which the last may be the titles; as many again
with a frequency."""

FIRST_ROWS = 50
"""Number of rows whose values show which columns may be times."""

_QUOTED = re.compile(r'"[^"]*"|\[[^\]]*\]')
_FREQUENCY = re.compile(r"([0-9]{1,9}(?:[.,][0-9]{1,9})?) ?([kK])?(?:Hz|HZ|hz|S/s|sps|SPS)\b")
_MARKS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
"""Encodings by byte-order mark; without one of these a file is UTF-8."""


def read_csv(
    name: str, file: io.BufferedReader, columns: Sequence[Column], rate: float, wording: Wording
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
        The file is no table of numbers, or contradicts itself or the stated rate.
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
    """Rows of a CSV file below its titles, which are numbers if it has none."""

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
        """Return the titles in the last comment, as `numpy.savetxt` writes it, or numbers."""
        if self._comments:
            comment = self._comments[-1].lstrip(f"{COMMENT} ")
            titles = [each.strip() for each in comment.split(_separator(comment))]
            if len(titles) == count and " " not in ACCELERATION.parsed(titles[0])[0]:
                self._comments.pop()
                return titles
        return [str(number + 1) for number in range(count)]

    def read(
        self, columns: Sequence[Column], rate: float, wording: Wording
    ) -> tuple[list[FloatArray], float]:
        """Return the columns and the sampling rate; see `read_csv`."""
        rows = ((self._line, row) for row in self._rows if any(row))
        first = list(itertools.islice(rows, FIRST_ROWS))
        times = self._times(first)
        indices = [self._chosen(column, times, wording) for column in columns]
        wanted = [
            (index, column.quantity, factor_of(self._name, self._titles[index], column.quantity))
            for index, column in zip(indices, columns, strict=True)
        ]
        stamps = {index: array("d") for index in times if index not in indices}
        values, lines = [array("d") for _ in columns], array("I")
        for line, row in itertools.chain(first, rows):
            self._check(line, row)
            for (index, quantity, factor), numbers in zip(wanted, values, strict=True):
                numbers.append(self._value(line, row, index, quantity, factor))
            for index, numbers in stamps.items():
                numbers.append(self._number(_field(row, index)))
            lines.append(line)
            if len(lines) > MOST_SAMPLES:
                raise ParameterError(f"{self._name}: must have at most {MOST_SAMPLES} samples")

        def line_of(sample: int) -> str:
            return f"line {lines[sample]}"

        place = f"{self._name}: column"
        for index, numbers in stamps.items():
            title, found = self._titles[index], np.array(numbers)
            rate = rate_of_times(place, title, found, line_of, rate, wording.rate)
        self._tell_comments(rate)
        return [np.array(each, dtype=np.float64) for each in values], rate

    def _times(self, first: Sequence[tuple[int, Sequence[str]]]) -> list[int]:
        """Return the columns that hold times by their titles or first values."""
        return [
            index
            for index, title in enumerate(self._titles)
            if time_unit(title)
            or is_time(title, np.array([_plain(_field(row, index)) for _, row in first]))
        ]

    def _chosen(self, column: Column, times: Sequence[int], wording: Wording) -> int:
        """Return the index of a column; of a file without titles the only one but times."""
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
        """Reject a row with values that no title names, but for the index that pandas writes."""
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

    def _tell_comments(self, rate: float) -> None:
        """Tell the user of comments, above all of one with another rate."""
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
        """Yield the lines of a text but comments; long lines are rejected."""
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
    """Return what separates the numbers of a line; empty for a line with other texts."""
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
