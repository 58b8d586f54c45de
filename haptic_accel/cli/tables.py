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

"""Tables on the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from haptic_accel.core.parameters import printable
from haptic_accel.core.tables import ResultTable


def print_table(table: ResultTable) -> None:
    """Print a table.

    Plain text has no markup, and its control characters are escaped; text of `rich` is printed
    unchanged.
    """
    shown = Table(title=table.title or None, caption=table.note or None, caption_justify="left")
    for place, heading in enumerate(table.headings):
        shown.add_column(
            heading, justify="left" if place < table.left else "right", overflow="fold"
        )
    for row in table.rows:
        shown.add_row(
            *(each if isinstance(each, Text) else Text(printable(each, "\n")) for each in row)
        )
    Console().print(shown)
