# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bag_maker import BagContent, meta, write_bag
from fuzzing import ODD_NUMBERS
from haptic_accel.analysis.segments import cut
from haptic_accel.bags.delivery import count, durations
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.tick.device_side import LATE_TIME, LONGEST, PAST_TICK

RATE = 500.0


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


@pytest.mark.parametrize("before", [0, 50_000])
def test_each_trial_has_its_own_share_of_what_its_device_counted(
    tmp_path: Path, before: int
) -> None:
    # 500 forces due and 10 missed a second; the bag may begin long after the device.
    force = "actuator force"
    diagnostics = []
    for tenth in range(3, 90, 10):
        seconds = tenth / 10
        values = {
            "due": f"{before + RATE * seconds:.0f}",
            "deadlines missed": f"{before // 50 + 10 * seconds:.0f}",
            PAST_TICK: "0",
            LONGEST: "9000.0" if seconds < 4 else "12000.0",
            LATE_TIME: f"{0.01 * seconds}",
        }
        named = {f"{force} {name}": value for name, value in values.items()}
        diagnostics.append((seconds, "master_device", "", named))
    at = {3.0: "inverse", 6.0: "dynamic"}
    changes = [(time, "compensator", "controller", name) for time, name in at.items()]
    noise = np.random.default_rng(0).normal(size=round(9 * RATE))
    signals = dict.fromkeys((topic.name for topic in topics.ANALYSED), noise)
    stated = meta("dynamic", "plywood", rate=RATE)
    content = BagContent(signals, RATE, stated, changes, diagnostics)
    trials = cut(read_bag(write_bag(tmp_path / "bag", content))).segments
    counts = [trial.delivery.deadlines[force] for trial in trials]
    assert len(trials) == 3
    for trial, own in zip(trials, counts, strict=True):
        assert own["due"] == pytest.approx(RATE * trial.seconds, abs=0.7 * RATE)
    # After the first report all is counted; the last one is 0.7 s before the end.
    assert counts[1]["due"] == pytest.approx(RATE * trials[1].seconds, abs=2)
    assert counts[1]["missed"] == pytest.approx(10 * trials[1].seconds, abs=2)
    assert counts[1]["late_s"] == pytest.approx(0.01 * trials[1].seconds, abs=1e-3)
    assert [own["longest_us"] for own in counts] == pytest.approx(
        [9000.0, 12000.0, np.nan], nan_ok=True
    )
