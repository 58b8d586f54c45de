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

"""Templates of studies, to begin a study of one's own."""

from __future__ import annotations

from pathlib import Path

from haptic_accel.core.bounded_files import located
from haptic_accel.core.parameters import ParameterError, shown, suggestion
from haptic_accel.materials.folders import config_folder

PROTOCOL = "study.yaml"
"""Name of the protocol in the folder of a study."""


def templates() -> dict[str, Path]:
    """Return the templates by name."""
    return {path.stem: path for path in sorted((config_folder() / "studies").glob("*.yaml"))}


def write_template(name: str, folder: Path) -> Path:
    """Write a template into a folder, which is made if it is not there; return the file.

    Raises
    ------
    ParameterError
        There is no such template, or the folder has a protocol already.
    """
    known = templates()
    if name not in known:
        allowed = f"must be one of {', '.join(known)}{suggestion(name, known)}"
        raise ParameterError(f"template = {name!r}: {allowed}")
    path = folder / PROTOCOL
    with located(shown(str(path)), unreadable="must be a new file: "):
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            file.write(known[name].read_bytes())
    return path
