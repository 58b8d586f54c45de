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

"""Load of a bus by frames."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from haptic_accel.devices.can.load import BusLoad, frame_bits


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (1, 65), (4, 95), (8, 135)])
def test_worst_case_of_a_frame(data_bytes: int, bits: int) -> None:
    # Davis, Burns, Bril and Lukkien 2007: 55 + 10 s bits for s bytes and 11-bit ids.
    assert frame_bits(data_bytes) == bits


@pytest.mark.parametrize("requested", [False, True])
@pytest.mark.parametrize("joints", [1, 3, 6])
def test_what_would_fit_just_fits(joints: int, requested: bool) -> None:
    highest = BusLoad(joints, 5000.0, 1e6, requested).highest_rate
    assert BusLoad(joints, highest * 0.999, 1e6, requested).fits
    assert not BusLoad(joints, highest * 1.001, 1e6, requested).fits


def test_what_does_not_fit_is_said() -> None:
    assert str(BusLoad(6, 1000.0, 1e6)).endswith(": too much, up to 574 Hz would fit")


DOCUMENT = Path(__file__).parents[3] / "docs" / "can_arms.md"


def test_the_documented_table_is_what_is_computed() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d) joints?(.*?) \| (.*%.*) \| (\d+) Hz \|$", text, re.MULTILINE)
    assert len(rows) == 6
    for joints, how, shares, highest in rows:
        requested = "requested" in how
        for rate, shown in zip((250.0, 500.0, 1e3, 2e3), shares.split(" | "), strict=True):
            load = BusLoad(int(joints), rate, 1e6, requested)
            figure = f"{100 * load.share:.0f} %"
            assert shown == (figure if load.fits else f"**{figure}**")
        assert f"{BusLoad(int(joints), 1e3, 1e6, requested).highest_rate:.0f}" == highest
