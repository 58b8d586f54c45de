# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One bag in many guises is read alike to the last digit, or a line says why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from fuzzing import fuzz_few
from guises import BAG_CHANGES, RATE, BagForm, Kind, Made, right_bag, write_form
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.sampling import NANOSECONDS, grid_indices


def content(form: BagForm, folder: Path) -> tuple[object, list[str]]:
    """Return all that is read from a bag, with times as places of samples; and its problems."""
    bag = read_bag(write_form(form, folder))
    start = min((int(each.stamps[0]) for each in bag.signals.values()), default=0)
    signals = {
        name: (grid_indices(each.stamps, start, RATE).tolist(), each.values.tobytes())
        for name, each in bag.signals.items()
    }
    on_time = all((each.received == each.stamps).all() for each in bag.signals.values())
    said = [
        (round((each.received - start) * RATE / NANOSECONDS), each.node, each.message, each.values)
        for each in bag.diagnostics
    ]
    changes = [
        (round((each.received - start) * RATE / NANOSECONDS), each.node, each.parameter)
        for each in bag.changes
    ]
    # Times without samples are no problem of reading: the analysis says so.
    gap = np.diff(sorted({each.received for each in form.messages})).max() * RATE / NANOSECONDS
    lines = bag.problems + [f"no samples for {gap:.0f} periods"] * bool(gap > 1.5)
    return (signals, on_time, said, changes, bag.metadata), lines


BAGS = Kind(right_bag, BAG_CHANGES, content)

SAME = [
    [("split", 0.3, 0.0), ("split", 0.6, 0.0), ("renamed", 0.0, name)] for name in (0.3, 0.5, 0.7)
] + [
    [("split", 0.4, 0.0), ("listed in reverse", 0.0, 0.0)],
    [("other storage", 0.0, 0.0)],
    [("compressed by file", 0.0, 0.0)],
    [("compressed by message", 0.0, 0.0)],
    [("compressed by message", 0.0, 0.0), ("no metadata", 0.0, 0.0)],
    [("split", 0.4, 0.0), ("copy of a file", 0.0, 0.0)],
    [("file of another recording", 0.0, 0.0)],
    [("split", 0.4, 0.0), ("file of another recording", 0.0, 0.0), ("no metadata", 0.0, 0.0)],
    [("clock off", 0.0, 0.9)],
    [("clock set back", 0.5, 0.0)],
    [("clock set back", 0.5, 0.1)],
    [("clock set back", 0.5, 0.9)],
    [("split", 0.7, 0.0), ("clock set back", 0.5, 0.1), ("renamed", 0.0, 0.5)],
    [("clock slewed", 0.0, 0.95)],
    [("clock slewed", 0.9, 0.1)],
    [("blocks in another order", 0.4, 1.0)],
    [("by topic", 0.0, 0.0)],
    [("some messages twice", 0.3, 1.0)],
    [("other names of topics", 0.0, 0.5)],
    [("no data of the recorder", 0.0, 0.0)],
]
"""Changes after which all is the same."""


@pytest.mark.parametrize("made", SAME, ids=lambda made: ", ".join(name for name, *_ in made))
def test_changes_that_cost_nothing(made: Made) -> None:
    found, _ = BAGS.found(made)
    assert found == BAGS.truth


@pytest.mark.parametrize("change", sorted(BAG_CHANGES))
def test_each_change_of_form(change: str) -> None:
    BAGS.check([(change, 0.3, 0.7)])


@fuzz_few
@given(BAGS.any_changes)
def test_any_changes_of_form(made: Made) -> None:
    BAGS.check(made)
