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

"""The paper's kind of model against the handle that it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.handle.approximate import approximate_model
from haptic_accel.core.model import ApproximateModel, HandleParameters, handle_model
from haptic_accel.core.parameters import ParameterError

TABLE_I = HandleParameters()


def magnitude_error(model: ApproximateModel, handle: HandleParameters) -> float:
    """Return the root mean square difference of two magnitudes over the paper's band, dB."""
    frequency = np.geomspace(15.0, 200.0, 200)
    ratio = model.model().response(frequency) / handle_model(handle).response(frequency)
    return float(np.sqrt(np.mean((20 * np.log10(np.abs(ratio))) ** 2)))


def test_on_table_i_it_is_closer_than_the_papers_numbers() -> None:
    model = approximate_model(TABLE_I)
    # The paper's own is 0.48 dB off.
    assert magnitude_error(model, TABLE_I) < 0.01 < magnitude_error(ApproximateModel(), TABLE_I)


@settings(deadline=None, max_examples=20)
@given(st.floats(0.07, 0.3), st.floats(500.0, 4000.0), st.floats(5.0, 30.0))
def test_it_is_close_for_any_hand(m_h: float, k_u: float, b_u: float) -> None:
    hand = replace(TABLE_I, m_h=m_h, k_u=k_u, b_u=b_u)
    assert magnitude_error(approximate_model(hand), hand) < 0.5


def test_what_cannot_be_approximated_is_refused() -> None:
    with pytest.raises(ParameterError, match="^band = 200 to 15 Hz: must satisfy 0 < low < high$"):
        approximate_model(TABLE_I, (200.0, 15.0))
