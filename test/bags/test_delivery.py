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

from __future__ import annotations

import pytest

from fuzzing import ODD_NUMBERS
from haptic_accel.bags.delivery import count, durations


def test_what_a_node_reported_is_read() -> None:
    values = {"age p50 (us)": "12.5", "age max (us)": "99.0", "age due": "1000"}
    assert durations(values, "age") == {"p50": 12.5, "max": 99.0}
    assert count(values, "age due") == 1000
    assert count(values, "age deadlines missed") == 0


@pytest.mark.parametrize("text", ODD_NUMBERS)
def test_what_is_no_number_in_a_bag_counts_as_not_reported(text: str) -> None:
    values = {"age p50 (us)": text, "age due": text}
    assert durations(values, "age") == {}
    assert count(values, "age due") == 0
