# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.tick import Trace

measurements = st.lists(st.sampled_from([0.5, 2.0, math.nan, math.inf]), max_size=50)


@given(measurements, st.integers(1, 10))
def test_a_trace_has_the_latest_samples_and_their_gaps(measured: list[float], kept: int) -> None:
    trace, latest, pushed = Trace(), 0.0, []
    trace.kept = kept
    for number, each in enumerate(measured):
        trace.push(1.0 * number, each, 2.0 * number, 3.0 * number)
        latest = each if math.isfinite(each) else latest
        pushed.append((1.0 * number, latest, 2.0 * number, 3.0 * number))
        assert min(kept, number + 1) <= trace.stored <= 2 * kept
        signals = [each[: trace.stored].tolist() for each in trace.signals]
        assert list(zip(*signals, strict=True)) == pushed[-trace.stored :]
        recent = range(max(0, number - kept + 1), number + 1)
        for gaps, is_gap in ((trace.missing, math.isnan), (trace.saturated, math.isinf)):
            expected = [each for each in recent if is_gap(measured[each])]
            assert [each for each in gaps if each in recent] == expected
            assert len(gaps) <= 2 * kept
    assert trace.count == len(measured)
    trace.reset()
    assert (trace.count, trace.stored, trace.missing, trace.saturated) == (0, 0, [], [])
