# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fast path as a process: its samples, its coil, its end, and what it refuses."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import DeviceError
from haptic_accel.graph.stop_signal import PendingStop
from haptic_accel.kits.lerobot import fast_path
from haptic_accel.nodes.timing import RateKeeper
from running import wait_until
from sound_cards import NAME, received, sound_card


def rings() -> tuple[fast_path.Ring, fast_path.Ring]:
    """Return the same samples twice, as the writer and a reader have them."""
    descriptor = fast_path.memory_file()
    try:
        return fast_path.Ring(descriptor), fast_path.Ring(descriptor)
    finally:
        os.close(descriptor)


def sample(tick: int) -> Vector:
    """Return an acceleration that tells its tick."""
    return float(tick), -float(tick), tick / 2


@settings(max_examples=20)
@given(st.integers(0, 3 * fast_path.SLOTS), st.integers(1, fast_path.LONGEST))
def test_another_user_reads_the_newest_samples_in_their_order(count: int, size: int) -> None:
    writer, reader = rings()
    for tick in range(count):
        writer.put(tick, sample(tick))
    found = reader.newest(size)
    if count < size:
        assert found is None
        return
    assert found is not None
    assert found[0] == count - 1
    np.testing.assert_array_equal(found[1], [sample(tick) for tick in range(count - size, count)])


@pytest.mark.parametrize("gap", [1, 5, 2 * fast_path.SLOTS])
def test_ticks_without_a_sample_hold_the_one_before_and_are_counted(gap: int) -> None:
    ring, _ = rings()
    for tick in (10, 11, 12 + gap):
        ring.put(tick, sample(tick))
    found = ring.newest(min(gap, fast_path.LONGEST - 1) + 1)
    assert found is not None
    tick, samples = found
    assert tick == 12 + gap
    assert set(samples[:-1, 0]) == {11.0}
    assert samples[-1, 0] == tick
    assert ring.counts[fast_path.LOST] == min(gap, fast_path.SLOTS)


pytestmark = pytest.mark.quiet

RATE = 960.0
STEP = 1e-3
"""Difference of two samples of the known signal, m/s^2."""


@pytest.fixture
def start() -> Iterator[Callable[[str], fast_path.FastPath]]:
    """Return a function that joins a fast path, which ends with the test."""
    joined = []

    def join_it(text: str = "") -> fast_path.FastPath:
        joined.append(fast_path.join(fast_path.read_arguments(text)))
        return joined[-1]

    yield join_it
    for path in joined:
        fast_path.leave(path)


Start = Callable[..., fast_path.FastPath]


def has_ended(process: int) -> bool:
    """Return whether a process has ended; one that nobody has waited for is a zombie."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return True
    return state == "Z"


def test_windows_are_contiguous_and_right(start: Start, tmp_path: Path) -> None:
    ramp = STEP * np.arange(round(20 * RATE))
    lines = "\n".join(f"{value:.6f}" for value in ramp)
    (tmp_path / "ramp.csv").write_text(f"acceleration\n{lines}\n")
    path = start(f"slave:=replay replay:={tmp_path}/ramp.csv recording_rate:={RATE:g}")
    size = fast_path.samples_per_frame(RATE, 30)
    assert size == 32

    def moving() -> tuple[int, np.ndarray] | None:
        found = path.ring.newest(size)
        return found if found and 0 < found[1][1, 2] - found[1][0, 2] < 2 * STEP else None

    found = [wait_until(moving, "recording is played")]
    found += [wait_until(moving, "next") for _ in range(3)]
    for _, samples in found:
        np.testing.assert_allclose(np.diff(samples[:, 2]), STEP, atol=1e-9)
    begins = {round(tick - samples[-1, 2] / STEP) for tick, samples in found}
    assert len(begins) == 1  # each value is that of its tick


def test_a_process_that_holds_pythons_lock_does_not_delay_the_fast_path(start: Start) -> None:
    path = start()
    keeper, ending = RateKeeper(RATE), threading.Event()

    def tick() -> None:
        while not ending.is_set():
            keeper.due()
            time.sleep(max(0.0, keeper.next - time.monotonic()))

    def served() -> tuple[int, int]:
        """Return the fast path's newest tick, and its number of ticks in time."""
        newest = path.ring.newest(1)
        assert newest
        return newest[0], int(path.ring.counts[fast_path.TICKS] - path.ring.counts[fast_path.LATE])

    thread = threading.Thread(target=tick)
    begin, before = served()
    thread.start()
    while keeper.late < 200:
        sum(range(1_000_000))  # holds the lock all the time
    ending.set()
    thread.join()
    end, after = served()
    of_thread = (keeper.ticks - keeper.late) / (keeper.ticks + keeper.missed)
    assert (after - before) / (end - begin) > 4 * of_thread


PARENT = """
import os, signal, sys, time
# A suite run in the background ignores Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
from haptic_accel.kits.lerobot.fast_path import join, read_arguments
path = join(read_arguments(""))
path.feel()
if sys.argv[1] == "forked" and os.fork() == 0:
    time.sleep(60)
    os._exit(0)
print(path.process.pid, os.getpid(), flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("forked", ["alone", "forked"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_fast_path_ends_with_its_parent(number: signal.Signals, forked: str) -> None:
    # A session of its own, so that what it has forked can be ended, too.
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, forked],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    ) as parent:
        assert parent.stdout
        process, own = map(int, parent.stdout.readline().split())
        os.kill(own, number)
        parent.wait()
        try:
            wait_until(lambda: has_ended(process), "end of the fast path")
        finally:
            if forked == "forked":
                os.killpg(own, signal.SIGKILL)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_an_end_is_known_with_its_reason(start: Start, number: signal.Signals) -> None:
    path = start()
    assert path.problem == ""
    os.kill(path.process.pid, number)
    problem = wait_until(lambda: path.problem, "end")
    expected = -int(number) if number == signal.SIGKILL else 0
    assert wait_until(lambda: path.problem.startswith("ended"), "end"), problem
    assert path.problem == f"ended with status {expected}"
    assert path.window(32) is None
    path.feel()  # is of no use, and no error
    assert not start().problem, "another one"


def test_a_process_that_hangs_is_noticed(start: Start) -> None:
    path = start()
    os.kill(path.process.pid, signal.SIGSTOP)
    try:
        assert re.match("no sample for", wait_until(lambda: path.problem, "hang"))
    finally:
        os.kill(path.process.pid, signal.SIGCONT)
    wait_until(lambda: not path.problem, "recovery")


def test_all_devices_share_one_fast_path_which_ends_with_the_last() -> None:
    first, second = map(fast_path.join, map(fast_path.read_arguments, ("", "rate:=960")))
    try:
        assert first is second
        with pytest.raises(ParameterError, match="must be 'rate:=960', as leader and follower"):
            fast_path.join(fast_path.read_arguments("rate:=480"))
    finally:
        fast_path.leave(first)
        assert not second.problem
        fast_path.leave(second)
    assert has_ended(first.process.pid)


@pytest.fixture
def card(tmp_path: Path) -> Iterator[SimpleNamespace]:
    """Provide a card that keeps what is played, and a rig whose coil is on it."""
    values = f"ros__parameters: {{actuator_device: audio, audio: {{device: {NAME}}}}}"
    file = tmp_path / "rig.yaml"
    file.write_text(f"master_device:\n  {values}\n")
    with sound_card(tmp_path):
        yield SimpleNamespace(folder=tmp_path, words=f"params_file:={file} latency:=15")


@pytest.mark.parametrize("stopped", [False, True])
def test_the_coil_moves_while_it_is_asked_for_and_no_stop_is_pending(
    card: SimpleNamespace, domain: int, stopped: bool
) -> None:
    path, pending = fast_path.join(fast_path.read_arguments(card.words)), PendingStop(domain, "")
    asked = iter([False, True, stopped, stopped])

    def play() -> None:
        ticks, asks = int(path.ring.counts[fast_path.TICKS]), next(asked)

        def is_over() -> bool:
            if asks:
                path.feel()
            return bool(path.ring.counts[fast_path.TICKS] > ticks + 1.5 * RATE)

        wait_until(is_over, "strokes")

    try:
        play()
        play()
        if stopped:
            assert pending.leave()
        play()
        play()
    finally:
        pending.withdraw()
        fast_path.leave(path)
    played = received(card.folder)
    loud = np.flatnonzero(played.any(axis=1))
    # Four parts of the same length, after the card's start; a request holds for a third of one.
    assert loud.min() > 0.15 * len(played)
    assert 0.4 * len(played) < loud.max() < 0.7 * len(played)


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("rate", "'rate': must have the form key:=value"),
        ("speed:=3", "speed: no such argument"),
        ("surface:='x", 'arguments = "surface:=\'x": No closing quotation'),
        ("master:=can", "master = 'can': must be none or simulated or virtual or"),
        ("slave:=serial", "slave = 'serial': must be none or simulated or virtual or"),
        ("side:=master peer:=127.0.0.1 insecure:=true", "side = 'master': must be empty"),
        ("slave:=none", "device = none: must come with accelerometers:=audio"),
        ("accelerometers:=audio", "audio.scales = '': must be the acceleration at full scale"),
        ("slave:=replay", "replay.file = '': must be"),
    ],
)
def test_wrong_arguments_are_refused_in_one_line(text: str, refused: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(refused)) as error:
        fast_path.tool_axes(fast_path.read_arguments(text))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("fps", "rate", "refused"),
    [
        *(
            (fps, RATE, f"fps = {fps}: must divide the fast path's rate")
            for fps in (0, 7, 50, 961)
        ),
        (1, 8192.0, "whole numbers up to 4096"),
    ],
)
def test_a_frame_without_whole_samples_or_with_too_many_is_refused(
    fps: int, rate: float, refused: str
) -> None:
    with pytest.raises(ParameterError, match=refused):
        fast_path.samples_per_frame(rate, fps)


CANNOT_START = {
    "actuator:=audio": "",
    "master:=none": "device = none: must come with accelerometers:=audio",
}


@pytest.mark.parametrize("text", CANNOT_START)
def test_what_cannot_start_is_told_in_one_line(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ALSA_CONFIG_PATH", os.devnull)  # no card
    with pytest.raises(DeviceError, match=f"^fast path: {CANNOT_START[text]}") as error:
        fast_path.join(fast_path.read_arguments(text))
    assert "\n" not in str(error.value)
    assert "Traceback" not in str(error.value)
