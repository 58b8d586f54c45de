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

"""Times at which a reduced force is hushed, and what is heard then."""

from __future__ import annotations

import pytest

from haptic_accel.core.control.listening import HUSHED_EVERY, HUSHED_FOR, HUSHED_RARELY, Listening

BLOCK = 0.01
"""Time between two blocks, s."""


def heard(listening: Listening, ringing: float, noise: float, minor: float) -> float:
    """Listen once to a handle that rings at first; return what is heard."""
    listening.begin()
    hushed = 0
    while listening.hushes:
        hushed += 1
        listening.hear(ringing if hushed * BLOCK < HUSHED_FOR / 3 else noise, BLOCK, minor)
    assert hushed * BLOCK == pytest.approx(HUSHED_FOR, abs=2 * BLOCK)
    return listening.heard


def waited(listening: Listening) -> float:
    """Return the time until the next listening is due, s."""
    waited = 0.0
    while not listening.is_due:
        listening.wait(BLOCK)
        waited += BLOCK
    return waited


def test_the_noise_is_heard_once_the_handle_has_ceased_to_ring() -> None:
    listening = Listening()
    assert listening.is_due
    assert heard(listening, 100.0, 0.5, minor=0.1) == pytest.approx(0.5, rel=0.1)


def test_a_handle_whose_noise_hides_nothing_is_listened_to_more_and_more_rarely() -> None:
    listening = Listening()
    times = []
    for _ in range(6):
        heard(listening, 0.0, 0.5, minor=1.0)
        times.append(HUSHED_FOR + waited(listening))
    expected = [min(HUSHED_EVERY * 2**number, HUSHED_RARELY) for number in range(1, 7)]
    assert times == pytest.approx(expected, abs=3 * BLOCK)
    heard(listening, 0.0, 0.5, minor=0.1)
    assert HUSHED_FOR + waited(listening) == pytest.approx(HUSHED_EVERY, abs=3 * BLOCK)


def test_a_force_that_falls_is_left_to_ring() -> None:
    listening = Listening()
    listening.postpone()
    assert waited(listening) == pytest.approx(0.3, abs=2 * BLOCK)
