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

"""Reports in half the time: cutting TrueType fonts for each PDF takes as long as all the rest.

Commands, which are processes of their own, write the fonts that publishers take.
"""

from __future__ import annotations

import pytest

from haptic_accel.analysis.plots import EMBEDDED


@pytest.fixture(autouse=True)
def plain_fonts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write each figure of a test with fonts that need no cutting."""
    monkeypatch.setitem(EMBEDDED, "pdf.fonttype", 3)
