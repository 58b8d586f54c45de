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

"""Tables as CSV that spreadsheets show and do not compute.

A spreadsheet takes a cell that begins with one of `STARTS` as a formula, which may run programs or
send data; names in protocols and bags come from others. Such a text gets an apostrophe before it,
and so does one that begins with an apostrophe, so that taking one off gives the text back. Numbers
are as they are. A line within a text ends with a line feed alone. After OWASP, "CSV injection".
"""

from __future__ import annotations

import re
from typing import Any

import pandas as pd
from pandas.api.types import is_numeric_dtype

STARTS = (
    *("=", "+", "-", "@", "\t", "\n", "'"),
    *("\N{FULLWIDTH EQUALS SIGN}", "\N{FULLWIDTH PLUS SIGN}"),
    *("\N{FULLWIDTH HYPHEN-MINUS}", "\N{FULLWIDTH COMMERCIAL AT}"),
)
"""First characters of texts that get an apostrophe."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", re.ASCII | re.IGNORECASE)


def inert(value: Any) -> Any:
    """Return a cell that no spreadsheet takes for a formula.

    Examples
    --------
    >>> inert("=1+1"), inert("-1.5"), inert(-1.5), inert("wood")
    ("'=1+1", '-1.5', -1.5, 'wood')
    """
    if not isinstance(value, str):
        return value
    text = re.sub("\r\n?", "\n", value)  # a carriage return alone would not be quoted
    return f"'{text}" if text.startswith(STARTS) and not _NUMBER.fullmatch(text) else text


def csv_text(frame: pd.DataFrame, separator: str = ",", unknown: str = "") -> str:
    """Return a table as CSV; a named index is a column.

    Parameters
    ----------
    frame : DataFrame
    separator, unknown : str
        Text between two cells, and in place of an unknown value.
    """
    whole = frame.reset_index() if frame.index.name is not None else frame
    cells = whole.rename(columns=inert)
    for name in cells.columns:
        if not is_numeric_dtype(cells[name]):
            cells[name] = cells[name].map(inert)
    text = cells.to_csv(
        sep=separator, index=False, float_format="%.9g", lineterminator="\n", na_rep=unknown
    )
    return str(text)
