# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core import sampling
from haptic_accel.core.actuator import MAX_AGE
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import (
    CONFIRMING_LOOKS,
    IN_A_ROW,
    SequenceCheck,
    SolePublisher,
)

START = 1_700_000_000_000_000_000
PERIOD = 1_000_000
"""Period, ns."""


def stamps_at(where: object) -> sampling.IntArray:
    """Return stamps on the grid of 1 kHz."""
    return START + np.asarray(where, dtype=np.int64) * PERIOD


@settings(max_examples=40)
@given(st.sets(st.integers(0, 99), min_size=1), st.integers(0, 400_000))
def test_what_is_there_keeps_its_place_and_what_is_not_holds(there: set[int], late: int) -> None:
    start = 1_700_000_000_000_000_000
    where = np.array(sorted(there))
    stamps = start + where * 1_000_000 + late
    found = sampling.grid_indices(stamps, start, 1000.0)
    np.testing.assert_array_equal(found, where)
    held, seen = sampling.on_grid(found, where.astype(float), 100)
    np.testing.assert_array_equal(np.flatnonzero(seen), where)
    for place in range(100):
        before = [one for one in where if one <= place]
        assert held[place] == (before[-1] if before else where[0])


def test_what_lies_outside_is_not_used() -> None:
    held, seen = sampling.on_grid(np.array([-1, 1, 5]), np.array([9.0, 2.0, 9.0]), 3)
    np.testing.assert_array_equal(held, [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(seen, [False, True, False])


@given(st.sampled_from([100.0, 400.0, 1000.0, 3000.0, 4000.0]), st.integers(0, 5))
def test_the_rate_is_found_in_spite_of_jitter_and_loss(rate: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    places = np.flatnonzero(random.random(2000) > 0.1)
    noise = random.uniform(-0.1, 0.1, len(places))
    stamps = START + np.rint((places + noise) * 1e9 / rate).astype(np.int64)
    assert sampling.sampling_rate(stamps) == rate


def test_a_rate_that_is_stated_is_taken_where_the_stamps_agree() -> None:
    stamps = START + np.arange(500, dtype=np.int64) * 3_003_003
    assert sampling.sampling_rate(stamps, 333.0) == 333.0
    assert sampling.sampling_rate(stamps, 1000.0) == 333.0
    odd = START + np.arange(500, dtype=np.int64) * 2_994_012
    assert sampling.sampling_rate(odd) == pytest.approx(334.0)


@pytest.mark.parametrize("stamps", [[], [5], [5, 5, 5]])
def test_no_rate_is_found_where_stamps_do_not_advance(stamps: list[int]) -> None:
    with pytest.raises(ParameterError, match="rate not found"):
        sampling.sampling_rate(np.array(stamps, dtype=np.int64))


def test_stamps_with_little_between_long_silences_lie_on_no_grid() -> None:
    with pytest.raises(ParameterError, match="4 samples in 1 s are not on a sampling grid"):
        sampling.sampling_rate(stamps_at([0, 1, 999, 1000]), 1000.0)


def test_rates_are_the_same_within_a_tenth_of_the_stated_one() -> None:
    found = [sampling.same_rate(rate, 1000.0) for rate in (899.0, 900.0, 1100.0, 1101.0)]
    assert found == [False, True, True, False]
    assert sampling.half_period(4000.0) == 125_000.0


def test_samples_are_missing_where_a_step_is_longer_than_one_and_a_half_periods() -> None:
    assert sampling.missing_samples(stamps_at([0, 1, 2, 3])) == 0
    assert sampling.missing_samples(stamps_at([0, 1, 2, 4, 5, 9, 10, 11])) == 4
    jitter = np.array([0, 240_000, -90_000, 240_000, 0])
    assert sampling.missing_samples(stamps_at(np.arange(5)) + jitter) == 0
    assert sampling.missing_samples(stamps_at([5, 5, 5])) == 0


def test_arms_are_coupled_from_the_first_force_of_a_stretch_that_has_any() -> None:
    let_go = np.zeros((1, 3))
    stretch = np.zeros((50, 3))
    stretch[20:] = 0.3  # encoders take a while to see that the hand has moved
    stamps = np.concatenate([stamps_at([0]), stamps_at(np.arange(500, 550)), stamps_at([900])])
    values = np.concatenate([let_go, stretch, let_go])
    samples = stamps_at(np.arange(1000))
    found = [(START + 500 * PERIOD, START + 549 * PERIOD)]
    assert sampling.coupled_stretches(stamps, values, samples) == found
    assert sampling.coupled_stretches(stamps[::-1], values[::-1], samples) == found
    assert sampling.coupled_stretches(stamps, values, samples[:0]) == found
    assert sampling.coupled_stretches(stamps[:1], let_go, samples) == []
    assert sampling.coupled_stretches(stamps[:0], let_go[:0], samples) == []


def test_silence_and_zeros_both_end_a_stretch() -> None:
    acting = np.zeros((1000, 3))
    acting[200:400, 1] = acting[600:, 2] = -1.0
    stamps = stamps_at(np.concatenate([np.arange(800), np.arange(1000, 1200)]))
    found = [
        ((a - START) // PERIOD, (b - START) // PERIOD)
        for a, b in sampling.coupled_stretches(stamps, acting, stamps_at(np.arange(1200)))
    ]
    assert found == [(0, 399), (600, 799), (1000, 1199)]


def test_a_gap_of_the_recorder_ends_no_stretch() -> None:
    # Forces are lost for 300 samples; of the arm's own samples 50 are recorded meanwhile.
    kept = np.concatenate([np.arange(400), np.arange(700, 1000)])
    forces = np.ones((len(kept), 3))
    samples = stamps_at(np.sort(np.append(kept, np.arange(500, 550))))
    whole = [(START, START + 999 * PERIOD)]
    assert sampling.coupled_stretches(stamps_at(kept), forces, samples) == whole
    forces[399] = 0.0  # with this force the arms were let go
    parts = [(START, START + 398 * PERIOD), (START + 700 * PERIOD, START + 999 * PERIOD)]
    assert sampling.coupled_stretches(stamps_at(kept), forces, samples) == parts


HOUR = 3600 * 10**9
LIMIT = round(MAX_AGE * 1e9)


class Source:
    """A signal of 1 kHz whose samples come at once, and the clock that stamps them."""

    def __init__(self) -> None:
        self.sequence = SequenceCheck(1000.0)
        self.steady = 0
        self.system = 10**18
        self.jumps: list[float] = []

    def admitted(self, stamp: int) -> bool:
        """Return whether a sample with a stamp is admitted now."""
        admitted = self.sequence.admits(stamp, self.system, self.steady)
        if admitted and self.sequence.jump:
            self.jumps.append(self.sequence.jump)
        return admitted

    def run(self, count: int) -> list[bool]:
        """Return which of the next samples are admitted."""
        return [self.step() for _ in range(count)]

    def step(self, delay: int = 0) -> bool:
        """Let a period pass; return whether the sample is admitted, taken a delay ago."""
        self.steady += PERIOD
        self.system += PERIOD
        return self.admitted(self.system - delay)


@pytest.mark.parametrize("missing", [3, 1000])
def test_samples_in_order_are_admitted_also_where_some_are_missing(missing: int) -> None:
    source = Source()
    assert all(source.run(5))
    source.steady += missing * PERIOD
    source.system += missing * PERIOD
    assert source.step()
    assert source.step()
    assert source.jumps == []


def test_a_straggler_and_a_repeated_sample_are_refused() -> None:
    source = Source()
    source.run(5)
    assert [source.admitted(source.system - n * PERIOD) for n in (0, 2, 1, 0, 0)] == [False] * 5
    assert source.step()
    assert (source.sequence.stale, source.jumps) == (5, [])


@pytest.mark.parametrize("before", [0, 5])
@pytest.mark.parametrize("off", [LIMIT + 1, -LIMIT - 1, HOUR, -HOUR])
def test_a_stamp_far_from_now_is_refused_and_shuts_out_no_other(off: int, before: int) -> None:
    source = Source()
    source.run(before)
    assert not source.admitted(source.system + off)
    assert source.sequence.outdated == 1
    assert all(source.run(5))
    assert source.jumps == []


@given(st.integers(2, LIMIT // PERIOD))
def test_a_stamp_a_little_ahead_shuts_out_few(ahead: int) -> None:
    source = Source()
    source.run(5)
    assert source.admitted(source.system + ahead * PERIOD)
    assert source.run(10)[IN_A_ROW:] == [True] * (10 - IN_A_ROW)


@given(
    st.sampled_from([-HOUR, HOUR]) | st.integers(-10 * LIMIT, 10 * LIMIT),
    st.integers(0, LIMIT // 4),
)
def test_after_a_step_of_the_clock_few_samples_are_refused(step: int, delay: int) -> None:
    source = Source()
    for _ in range(5):
        source.step(delay)
    source.system += step
    admitted = [source.step(delay) for _ in range(20)]
    assert all(admitted[IN_A_ROW:])
    assert len(source.jumps) <= 1
    if step < -3 * PERIOD or step > LIMIT:
        (jump,) = source.jumps
        assert jump == pytest.approx(step / 1e9, abs=1e-9 * LIMIT)


@given(st.lists(st.integers(-3 * LIMIT, 3 * LIMIT), max_size=50))
def test_samples_admitted_are_newer_than_the_last_unless_a_clock_was_set(offs: list[int]) -> None:
    source = Source()
    last = 0
    for off in offs:
        source.steady += PERIOD
        source.system += PERIOD
        jumps = len(source.jumps)
        stamp = source.system + off
        if source.admitted(stamp):
            assert abs(off) <= LIMIT
            assert stamp > last or len(source.jumps) > jumps
            last = stamp


def refused(sequence: SequenceCheck, stamps: Iterable[int]) -> int:
    return sum(not sequence.admits(stamp, stamp, 0) for stamp in stamps)


def test_a_sequence_that_begins_anew_knows_no_sample_before() -> None:
    sequence = SequenceCheck(1000.0)
    assert refused(sequence, [7 * PERIOD, 2 * PERIOD]) == 1
    sequence.begin()
    assert refused(sequence, [2 * PERIOD]) == 0
    assert sequence.jump == 0.0


COMES, GOES, SENDS, LOOK = "comes", "goes", "sends", "look"

events = st.lists(
    st.one_of(
        st.tuples(st.sampled_from((COMES, GOES, SENDS)), st.integers(0, 2)), st.just((LOOK, 0))
    ),
    max_size=60,
)


class Queue:
    """A subscription's queue, with the middleware's counts."""

    def __init__(self) -> None:
        self.counts = SimpleNamespace(total_count=0, current_count=0)
        self.publisher = SolePublisher(lambda: self.counts)
        self.waiting: list[tuple[int, int]] = []
        self.numbers: dict[int, int] = {}

    def comes(self, name: int, *, counted: bool = True) -> None:
        self.numbers[name] = 0
        if counted:
            self.count()

    def count(self) -> None:
        self.counts.total_count += 1
        self.counts.current_count += 1

    def goes(self, name: int) -> None:
        del self.numbers[name]
        self.counts.current_count -= 1

    def sends(self, name: int, messages: int = 1) -> None:
        for _ in range(messages):
            self.numbers[name] += 1
            self.waiting.append((name, self.numbers[name]))

    def confirm(self) -> None:
        """Look as often as a publisher whose numbers start again is doubted."""
        for _ in range(CONFIRMING_LOOKS):
            assert self.look() == []

    def look(self) -> list[int]:
        """Return the publishers of the messages that are taken."""
        taken, self.waiting = self.waiting, []
        if not self.publisher.sole([number for _, number in taken]):
            self.waiting = []
            return []
        return [name for name, _ in taken]


@given(events)
def test_nothing_is_taken_of_a_time_with_two_publishers_and_all_of_a_sole_one(
    events: list[tuple[str, int]],
) -> None:
    queue, possible, sent, contended = Queue(), 0, 0, False
    for event, name in events:
        if event == COMES and name not in queue.numbers:
            queue.comes(name)
            possible += 1
        elif event == GOES and name in queue.numbers:
            queue.goes(name)
        elif event == SENDS and name in queue.numbers:
            queue.sends(name)
            sent += 1
        elif event == LOOK:
            taken = queue.look()
            contended = contended or possible > 1
            # After that, who remains is taken once it is confirmed.
            assert len(taken) in ((0 if contended else sent), (sent if possible <= 1 else 0))
            possible, sent = len(queue.numbers), 0
    if len(queue.numbers) == 1:
        (name,) = queue.numbers
        for _ in range(CONFIRMING_LOOKS + 2):
            queue.sends(name)
            taken = queue.look()
        assert taken == [name]


@pytest.fixture
def queue() -> Queue:
    """Return the queue of a publisher whose first messages are taken."""
    queue = Queue()
    queue.comes(0)
    queue.sends(0, 5)
    assert queue.look() == [0] * 5
    return queue


def test_a_publisher_that_comes_and_goes_between_two_looks_is_noticed(queue: Queue) -> None:
    queue.comes(1)
    queue.sends(1, 3)
    queue.goes(1)
    assert queue.look() == []
    queue.sends(0)
    assert queue.look() == [0]


def test_messages_that_precede_the_count_of_their_publisher_are_known_by_their_numbers(
    queue: Queue,
) -> None:
    queue.comes(1, counted=False)
    queue.sends(0)
    queue.sends(1, 3)
    assert queue.look() == []
    queue.sends(1)
    assert queue.look() == []
    queue.sends(0)
    queue.count()
    assert queue.look() == []


def test_numbers_are_remembered_while_a_rival_comes_and_goes(queue: Queue) -> None:
    queue.comes(1)
    assert queue.look() == []
    queue.goes(1)
    assert queue.look() == []
    queue.comes(1, counted=False)
    for _ in range(2):
        queue.sends(1)
        assert queue.look() == []
    queue.count()
    assert queue.look() == []
    queue.goes(1)
    queue.sends(0)
    assert queue.look() == []
    queue.confirm()
    queue.sends(0)
    assert queue.look() == [0]


def test_who_replaces_another_beside_a_rival_is_taken_once_it_is_confirmed(queue: Queue) -> None:
    queue.comes(1)
    queue.goes(0)
    assert queue.look() == []
    queue.sends(1)
    queue.confirm()
    queue.sends(1)
    assert queue.look() == [1]


def test_a_successor_counts_its_messages_anew(queue: Queue) -> None:
    queue.goes(0)
    assert queue.look() == []
    queue.comes(1)
    queue.sends(1, 2)
    assert queue.look() == [1, 1]
    assert queue.publisher.changed
    assert queue.publisher.contenders == 1
    queue.sends(1)
    assert queue.look() == [1]
    assert not queue.publisher.changed


def test_a_middleware_without_numbers_or_news_is_enough_for_one_publisher() -> None:
    counts = iter((SimpleNamespace(total_count=1, current_count=1), None))
    publisher = SolePublisher(lambda: next(counts))
    assert publisher.sole([None, None])
    assert publisher.sole([None])
