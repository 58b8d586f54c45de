from __future__ import annotations

import itertools
import math
import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from geometry_msgs.msg import AccelStamped
from rclpy.serialization import serialize_message

from haptic_accel.cli.udp_floor import udp_floor
from haptic_accel.core.parameters import ParameterError
from running import Command, processes_of, wait_until

ROLES = {"slave_device", "compensator", "master_device"}

CALL = """
from geometry_msgs.msg import AccelStamped
from rclpy.serialization import serialize_message
from haptic_accel.cli.udp_floor import udp_floor
udp_floor(100.0, 3600.0, bytes(serialize_message(AccelStamped())))
"""


def message(frame: str = "master_handle") -> bytes:
    made = AccelStamped()
    made.header.frame_id = frame
    return bytes(serialize_message(made))


def roles_of(domain: int) -> dict[str, int]:
    """Return the running processes with a test's environment: process id by role."""
    module = "haptic_accel.cli.udp_floor"
    return {
        words[words.index(module) + 1]: pid
        for pid, words in processes_of(domain)
        if module in words
    }


def all_run(domain: int) -> bool:
    return set(roles_of(domain)) == ROLES


def none_runs(domain: int) -> bool:
    return roles_of(domain) == {}


def test_every_sample_arrives_and_has_an_age(domain: int) -> None:
    found = udp_floor(200.0, 0.5, message())
    # 100 datagrams fit into any receiver's buffer, however long it is kept from running.
    assert (found["sent"], found["received"]) == (100, 100)
    assert list(found["age_us"]) == ["p50", "p90", "p99", "p99_9", "max"]
    ages = list(found["age_us"].values())
    assert 0 < ages[0] < math.inf
    assert all(one <= other for one, other in itertools.pairwise(ages))
    assert none_runs(domain)


@pytest.mark.usefixtures("domain")
def test_any_frame_will_do() -> None:
    assert udp_floor(200.0, 0.05, message(frame="an_arm/handle"))["received"] == 10


@pytest.mark.parametrize("rate", [-1.0, 0.0, 49.0, 1e6, math.inf, math.nan])
def test_a_rate_that_the_compensator_has_not_is_refused(rate: float) -> None:
    with pytest.raises(ParameterError, match="^rate = "):
        udp_floor(rate, 1.0, message())


@pytest.mark.parametrize("seconds", [-1.0, 0.0, 1e-4, math.inf, math.nan])
def test_less_than_a_sample_and_more_than_there_is_are_refused(seconds: float) -> None:
    with pytest.raises(ParameterError, match="^seconds = "):
        udp_floor(1000.0, seconds, message())


@pytest.mark.parametrize("role", sorted(ROLES))
def test_a_process_that_dies_is_named_and_the_others_end(domain: int, role: str) -> None:
    with ThreadPoolExecutor() as pool:
        floor = pool.submit(udp_floor, 100.0, 3600.0, message())
        wait_until(lambda: all_run(domain) or floor.done(), "all three run")
        os.kill(roles_of(domain)[role], signal.SIGKILL)
        with pytest.raises(RuntimeError, match=f"^{role}: ended with status -9"):
            floor.result()
    assert none_runs(domain)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_the_caller_is_stopped(
    start: Callable[..., Command], domain: int, number: signal.Signals
) -> None:
    caller = start("-c", CALL)
    try:
        wait_until(lambda: all_run(domain), "all three run")
        assert caller.end(number) != 0
        wait_until(lambda: none_runs(domain), "all three ended")
        # Ctrl-C is an exception of the caller's, as everywhere in Python.
        assert number == signal.SIGINT or caller.text == ""
    finally:
        for pid in roles_of(domain).values():
            os.kill(pid, signal.SIGKILL)
