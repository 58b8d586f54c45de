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


def test_three_joints_at_1_khz_fit_1_mbit_when_streamed() -> None:
    load = BusLoad(3, 1000.0, 1e6)
    # 3 x (1000 x (135 + 95) + 10 x 135) bits
    assert load.bits == 694_050
    assert load.fits
    assert str(load) == (
        "bus load up to 69 % of 1 Mbit/s (3 joints at 1000 Hz, estimates streamed)"
    )


def test_they_do_not_when_requested_or_with_a_second_arm() -> None:
    assert not BusLoad(3, 1000.0, 1e6, requested=True).fits
    assert not BusLoad(6, 1000.0, 1e6).fits
    assert not BusLoad(3, 1000.0, 500e3).fits
    assert BusLoad(1, 1000.0, 500e3).fits


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
