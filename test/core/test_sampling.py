"""Samples on the grid of their stamps."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.sampling import on_grid, places


@settings(max_examples=40)
@given(st.sets(st.integers(0, 99), min_size=1), st.integers(0, 400_000))
def test_what_is_there_keeps_its_place_and_what_is_not_holds(there: set[int], late: int) -> None:
    start = 1_700_000_000_000_000_000
    where = np.array(sorted(there))
    stamps = start + where * 1_000_000 + late
    found = places(stamps, start, 1000.0)
    np.testing.assert_array_equal(found, where)
    held, seen = on_grid(found, where.astype(float), 100)
    np.testing.assert_array_equal(np.flatnonzero(seen), where)
    for place in range(100):
        before = [one for one in where if one <= place]
        assert held[place] == (before[-1] if before else where[0])


def test_what_lies_outside_is_not_used() -> None:
    held, seen = on_grid(np.array([-1, 1, 5]), np.array([9.0, 2.0, 9.0]), 3)
    np.testing.assert_array_equal(held, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(seen, [False, True, False])
