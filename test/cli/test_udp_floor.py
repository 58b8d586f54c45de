from __future__ import annotations

import itertools
import math
import multiprocessing
import os
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from haptic_accel.cli.udp_floor import udp_floor
from haptic_accel.core.parameters import ParameterError
from running import Command, processes_of, wait_until

CALL = """
from haptic_accel.cli.udp_floor import udp_floor
if __name__ == "__main__":
    udp_floor(100.0, 3600.0)
"""


def compensators(domain: int) -> Iterator[int]:
    """Yield the process ids of second processes with a test's environment."""
    return (pid for pid, words in processes_of(domain) if any("spawn_main" in w for w in words))


def at_work(pid: int) -> bool:
    """Return True once a second process has left Ctrl-C to the first, its first action."""
    with suppress(FileNotFoundError):
        status = Path(f"/proc/{pid}/status").read_text()
        ignored = int(re.findall(r"^SigIgn:\s*(\w+)", status, re.MULTILINE)[0], 16)
        return bool(ignored & 1 << signal.SIGINT - 1)
    return False


def test_every_sample_arrives_and_has_an_age(domain: int) -> None:
    found = udp_floor(200.0, 0.5)
    assert found["sent"] == 100
    # A force that comes after the last period is not waited for.
    assert 90 <= found["received"] <= 100
    assert list(found["age_us"]) == ["p50", "p90", "p99", "p99_9", "max"]
    ages = list(found["age_us"].values())
    assert 0 < ages[0] < math.inf
    assert all(one <= other for one, other in itertools.pairwise(ages))
    assert not list(compensators(domain))


@pytest.mark.parametrize("rate", [-1.0, 0.0, 49.0, 1e6, math.inf, math.nan])
def test_a_rate_that_the_compensator_has_not_is_refused(rate: float) -> None:
    with pytest.raises(ParameterError, match="^rate = "):
        udp_floor(rate, 1.0)


@pytest.mark.parametrize("seconds", [-1.0, 0.0, 1e-4, math.inf, math.nan])
def test_less_than_a_sample_and_more_than_there_is_are_refused(seconds: float) -> None:
    with pytest.raises(ParameterError, match="^seconds = "):
        udp_floor(1000.0, seconds)


@pytest.mark.usefixtures("domain")
def test_a_second_process_that_dies_is_named() -> None:
    with ThreadPoolExecutor() as pool:
        floor = pool.submit(udp_floor, 100.0, 3600.0)
        wait_until(lambda: bool(multiprocessing.active_children()), "the process is started")
        for child in multiprocessing.active_children():
            os.kill(child.pid or 0, signal.SIGKILL)
        with pytest.raises(RuntimeError, match="^compensator: "):
            floor.result()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_the_caller_is_stopped(
    start: Callable[..., Command], domain: int, tmp_path: Path, number: signal.Signals
) -> None:
    (tmp_path / "call.py").write_text(CALL)
    caller = start("call.py")
    wait_until(lambda: any(map(at_work, compensators(domain))), "the second process works")
    assert caller.end(number) != 0
    wait_until(lambda: not any(compensators(domain)), "it has ended")
    # Ctrl-C is an exception of the caller's, as everywhere in Python.
    assert number == signal.SIGINT or caller.text == ""
