# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A trial in a bag and the same trial in lockstep."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from bag_maker import CHANGED, Message, change_bytes, of_trial, write_bag, write_messages
from haptic_accel.analysis.replay import find_divergence
from haptic_accel.bags.metadata import read_metadata
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.device_side import PAST_TICK
from haptic_accel.core.trial import Trial
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.setup import Setup
from reading import with_types

START = 1_700_000_000_000_000_000
ARGUMENTS = GraphArguments(rig="ideal", surface="text", duration=1.0)


@pytest.fixture(scope="module")
def trial() -> Trial:
    return lockstep_trial(Setup.of(ARGUMENTS))


def test_the_same_trial_does_not_part(trial: Trial, tmp_path: Path) -> None:
    record_trial(tmp_path / "bag", trial, Setup.of(ARGUMENTS), START)
    found = find_divergence(tmp_path / "bag")
    assert found.first is None
    assert found.samples == pytest.approx(len(trial.time), abs=1)
    assert "equal those in lockstep" in found.sentence


def test_the_first_sample_that_differs_by_a_bit_is_named(trial: Trial, tmp_path: Path) -> None:
    handle = trial.handle_acceleration.copy()
    handle[700] = np.nextafter(handle[700], np.inf)
    handle[800] += 1.0
    record_trial(
        tmp_path / "bag", replace(trial, handle_acceleration=handle), Setup.of(ARGUMENTS), START
    )
    found = find_divergence(tmp_path / "bag")
    assert (found.first, found.signals) == (700, (topics.HANDLE_ACCELERATION.name,))
    assert found.reasons == ("no node reported a reason",)
    assert "at sample 700" in found.sentence


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({PAST_TICK: "0", "deadlines missed": "9"}, "no node reported a reason"),
        ({PAST_TICK: "1", "deadlines missed": "9"}, f"arm force {PAST_TICK})"),
        ({"deadlines missed": "9"}, "arm force deadlines missed)"),  # as older devices counted
    ],
)
def test_a_force_that_was_late_by_the_clock_alone_is_no_reason(
    trial: Trial, tmp_path: Path, values: dict[str, str], reason: str
) -> None:
    content = of_trial(trial)  # with other arm forces
    content.metadata["arguments"].update(asdict(ARGUMENTS))
    reported = {f"arm force {name}": value for name, value in values.items()}
    diagnostics = [(0.5, "master_device", "OK", reported)]
    write_bag(tmp_path / "bag", replace(content, diagnostics=diagnostics))
    (found,) = find_divergence(tmp_path / "bag").reasons
    assert found.endswith(reason)


@pytest.mark.parametrize(
    ("given", "named"), [({"slave": "replay"}, "replay.file = ''"), ({"latency": 0}, "latency")]
)
def test_what_has_no_counterpart_in_lockstep_is_refused(
    trial: Trial, tmp_path: Path, given: dict[str, str], named: str
) -> None:
    record_trial(tmp_path / "bag", trial, Setup.of(replace(ARGUMENTS, **given)), START)
    with pytest.raises(ParameterError, match=named):
        find_divergence(tmp_path / "bag")


@pytest.mark.parametrize(("later", "is_whole"), [("before", True), ("after", False)])
def test_a_live_trial_is_compared_until_a_parameter_changes_not_until_one_is_declared(
    trial: Trial, tmp_path: Path, later: str, is_whole: bool
) -> None:
    record_trial(tmp_path / "bag", trial, Setup.of(ARGUMENTS), START)
    rows = [Message(*each) for each in with_types(tmp_path / "bag")]
    for seconds, value, declared in (
        (0.3, "before", True),
        (0.4, "before", False),
        (0.5, later, False),
    ):
        moment = START + round(seconds * NANOSECONDS)
        data = change_bytes(moment, "/compensator", "stated_late", value, declared=declared)
        rows.append(Message("/parameter_events", CHANGED, moment, data))
    rows.sort(key=lambda each: each.received)
    custom = read_metadata(tmp_path / "bag").custom
    found = find_divergence(write_messages(tmp_path / "told", rows, custom=custom))
    assert found.first is None
    assert found.samples == pytest.approx(len(trial.time) if is_whole else 500, abs=2)


def test_a_file_that_was_edited_after_the_recording_is_no_divergence(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    text = "master_device: {{ros__parameters: {{simulated: {{handle: {{m_h: {}}}}}}}}}"
    mine.write_text(text.format(0.2))
    setup = Setup.of(replace(ARGUMENTS, params_file=str(mine)))
    record_trial(tmp_path / "bag", lockstep_trial(setup), setup, START)
    mine.write_text(text.format(0.3))
    assert find_divergence(tmp_path / "bag").first is None
    mine.unlink()
    assert find_divergence(tmp_path / "bag").first is None


def test_a_bag_states_the_changes_of_its_trial(tmp_path: Path) -> None:
    setup = Setup.of(ARGUMENTS).changed({"coupler": {"k_m": 150.0}})
    record_trial(tmp_path / "bag", lockstep_trial(setup), setup, START)
    assert read_bag(tmp_path / "bag").metadata["parameters"]["coupler"]["k_m"] == 150.0
    assert find_divergence(tmp_path / "bag").first is None
