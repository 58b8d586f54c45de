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

from haptic_accel.core import resampling
from haptic_accel.core.decimals import read_decimal
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, shown
from haptic_accel.core.warning import warn_once
from haptic_accel.materials.columns import (
    TIME,
    Column,
    Quantity,
    Wording,
    chosen,
    factor_of,
    is_time,
)
from haptic_accel.materials.sample_times import rate_of_times

LARGEST_VALUE = 1.0e6
"""Maximum magnitude of a value in SI units; a file that exceeds it contains something else."""

LONGEST_LINE = 1 << 16
"""Maximum length of a line of a CSV file, characters."""

SEPARATORS = ",;\t"
"""Characters between columns."""

COMMENT = "#"
"""Start of a line that is skipped."""

MOST_COMMENTS = 100
"""Maximum number of comments that are kept, of which the last may be the titles."""

_QUOTED = re.compile(r'"[^"]*"|\[[^\]]*\]')
_MARKS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
"""Encodings by byte-order mark; without one of these a file is UTF-8."""


def read_csv(
    name: str,
    file: io.BufferedReader,
    columns: Sequence[Column],
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
        The file is no table of numbers, or contradicts itself or the stated rate.
    """
    try:
        table = _Table(name, file)
        return table.read(columns, rate, wording)
    except UnicodeError:
        raise ParameterError(f"{name}: is not text, must be a CSV or WAV file") from None
    except csv.Error as error:
        raise ParameterError(
            f"{name}: {shown(str(error))}: must be comma-separated values"
        ) from None


class _Table:
    """Rows of a CSV file below its titles."""

    def __init__(self, name: str, file: io.BufferedReader) -> None:
        self._name = name
        self._line = 0
        self._decimal = ""
        self._comments: list[str] = []
        encoding = _MARKS.get(file.peek(2)[:2], "utf-8-sig")
        lines = self._lines(io.TextIOWrapper(file, encoding=encoding, newline=""))
        header = next((line for line in lines if not line.isspace()), "")
        self._separator = _separator(header)
        if self._comments and all(map(_is_number, header.split(self._separator))):
            # As `numpy.savetxt` writes it: the titles are the last comment.
            lines = itertools.chain([header], lines)
            header = self._comments.pop().lstrip(COMMENT)
            self._separator = _separator(header)
        self._rows = csv.reader(
            itertools.chain([header], lines),
            delimiter=self._separator,
            skipinitialspace=True,
            strict=True,
        )
        self._titles = [title.strip() for title in next(self._rows)]
        # The first one may be the index that pandas writes.
        self._untitled = [index for index, each in enumerate(self._titles) if index and not each]

    def read(
        self, columns: Sequence[Column], rate: float, wording: Wording
    ) -> tuple[list[FloatArray], float]:
        """Return the columns and the sampling rate; see `read_csv`."""
        chosen_columns = [chosen(self._name, column, self._titles, wording) for column in columns]
        factors = [
            factor_of(self._name, self._titles[index], column.quantity)
            for index, column in zip(chosen_columns, columns, strict=True)
        ]
        times = self._times(chosen_columns)
        values = [array("d") for _ in columns]
        lines = array("I")
        for row in self._rows:
            if not any(row):
                continue
            self._check(row)
            for index, column, factor, numbers in zip(
                chosen_columns, columns, factors, values, strict=True
            ):
                numbers.append(self._value(row, index, column.quantity, factor))
            if len(values[0]) > resampling.MOST_SAMPLES:
                raise too_long(self._name, len(values[0]))
            for index in times:
                self._note_time(row, index, times)
            if times:
                lines.append(self._line)
        self._tell_comments()
        for index, stamps in times.items():
            if stamps is not None:
                where = f"{self._name}: column {shown(self._titles[index])}"
                unit = TIME.parsed(self._titles[index])[1]
                rate = rate_of_times(
                    where,
                    np.array(stamps),
                    lambda sample: f"line {lines[sample]}",
                    unit,
                    rate,
                    wording.rate,
                )
        return [np.array(each, dtype=np.float64) for each in values], rate

    def _times(self, chosen_columns: Sequence[int]) -> dict[int, array[float] | None]:
        """Return an empty array for each column of times; None for times in another form."""
        found: dict[int, array[float] | None] = {}
        for index, title in enumerate(self._titles):
            if index not in chosen_columns and is_time(title):
                found[index] = array("d")
                if TIME.parsed(title)[1] and TIME.factor(TIME.parsed(title)[1]) is None:
                    self._leave_out(index, found)
        return found

    def _leave_out(self, index: int, times: dict[int, array[float] | None]) -> None:
        times[index] = None
        warn_once(
            f"{self._name}: column {shown(self._titles[index])} has no numbers in s, ms, us or ns:"
            " it is not compared with the rate"
        )

    def _note_time(
        self, row: Sequence[str], index: int, times: dict[int, array[float] | None]
    ) -> None:
        stamps = times[index]
        if stamps is None:
            return
        text = row[index] if index < len(row) else ""
        time = self._number(text)
        if math.isfinite(time):
            stamps.append(time)
        elif stamps:
            raise self._wrong(index, text, "must be a time, as in the lines before")
        else:
            self._leave_out(index, times)

    def _check(self, row: Sequence[str]) -> None:
        """Reject a row with values that no title names."""
        commas = ""
        if self._separator == ",":
            commas = "; decimal commas need semicolons or tabs between columns"
        if len(row) > len(self._titles):
            raise ParameterError(
                f"{self._name}: line {self._line}: {len(row)} values: must be"
                f" {len(self._titles)} at most, as the header{commas}"
            )
        for index in self._untitled:
            if index < len(row) and row[index]:
                raise ParameterError(
                    f"{self._name}: line {self._line}: {row[index][:40]!r} in a column without a"
                    f" title: must have one{commas}"
                )

    def _value(self, row: Sequence[str], index: int, quantity: Quantity, factor: float) -> float:
        text = row[index] if index < len(row) else ""
        value = self._number(text) * factor
        if not abs(value) <= LARGEST_VALUE:
            raise self._wrong(
                index,
                text,
                f"must be a number from {-LARGEST_VALUE:g} to {LARGEST_VALUE:g}"
                f" {quantity.si_unit}",
            )
        return value

    def _wrong(self, index: int, text: str, allowed: str) -> ParameterError:
        sign = f" with {self._decimal!r} for decimals, as in the lines before"
        other = {".": ",", ",": "."}.get(self._decimal)
        return ParameterError(
            f"{self._name}: line {self._line}: {shown(self._titles[index])} = {text[:40]!r}: "
            f"{allowed}{sign if other and other in text else ''}"
        )

    def _number(self, text: str) -> float:
        """Return a number with the file's decimal sign; NaN for any other text."""
        if sign := "," if "," in text else "." if "." in text else "":
            self._decimal = self._decimal or sign
            if sign != self._decimal:
                return math.nan
        if sign == ",":
            text = text.replace(",", ".")
        try:
            return read_decimal(text)
        except ValueError:
            return math.nan

    def _tell_comments(self) -> None:
        if self._comments:
            warn_once(
                f"{self._name}: lines that begin with {COMMENT} are not read, such as"
                f" {shown(self._comments[0])}"
            )

    def _lines(self, text: io.TextIOWrapper) -> Iterator[str]:
        """Yield the lines of a text but comments; long lines are rejected."""
        while line := text.readline(LONGEST_LINE + 1):
            self._line += 1
            if len(line) > LONGEST_LINE:
                raise ParameterError(
                    f"{self._name}: a line has more than {LONGEST_LINE} characters"
                )
            if "\0" in line:
                raise UnicodeError
            if not line.startswith(COMMENT):
                yield line
            elif len(self._comments) < MOST_COMMENTS:
                self._comments.append(line.rstrip())


def too_long(name: str, samples: int) -> ParameterError:
    """Return the error for a recording with too many samples."""
    return ParameterError(f"{name}: {samples} samples: must be at most {resampling.MOST_SAMPLES}")


def _separator(header: str) -> str:
    """Return the most frequent separator outside of quotes and brackets."""
    bare = _QUOTED.sub("", header)
    return max(SEPARATORS, key=bare.count)


def _is_number(text: str) -> bool:
    try:
        read_decimal(text.strip())
    except ValueError:
        return False
    return True
