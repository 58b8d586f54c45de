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

"""Writes the tables of arguments in the documentation, which come from the code.

``python docs/tables.py`` puts each between its marks in a page: a line with the comment
``arguments: NAME``, and one with the comment ``end``.
"""

from __future__ import annotations

import re
from pathlib import Path

from haptic_accel.core.parameters import Checked
from haptic_accel.graph.arguments import GraphArguments, IdentifyArguments
from haptic_accel.graph.words import described, group

FOLDER = Path(__file__).parent

ARGUMENTS: dict[str, type[Checked]] = {"teleop": GraphArguments, "identify": IdentifyArguments}

PLACE = re.compile(r"(<!-- arguments: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def table(kind: type[Checked]) -> str:
    """Return the arguments of a dataclass, under headings, as a table in Markdown."""
    rows, above = [], ""
    for name, default, text in described(kind):
        if (heading := group(kind, name)) != above:
            rows.append(f"| **{heading}** | | |")
            above = heading
        shown = f"`{default}`" if default else ""
        rows.append(f"| `{name}` | {shown} | {text.replace('|', chr(92) + '|')} |")
    return "\n".join(["| argument | default | meaning |", "|---|---|---|", *rows, ""])


def with_tables(text: str) -> str:
    """Return a page with its tables as the code has them."""

    def filled(place: re.Match[str]) -> str:
        return f"{place[1]}{table(ARGUMENTS[place[2]])}{place[3]}"

    return PLACE.sub(filled, text)


def main() -> None:
    """Write the tables of all pages anew."""
    for page in sorted(FOLDER.glob("*.md")):
        text = page.read_text()
        if (new := with_tables(text)) != text:
            page.write_text(new)


if __name__ == "__main__":
    main()
