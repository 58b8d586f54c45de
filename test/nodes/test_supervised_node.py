# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from std_msgs.msg import Bool
from std_srvs.srv import SetBool, Trigger

from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.nodes.crtk import Managed
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.supervised_node import Wire, Wires
from nightly import rest_slow
from observing import Observer
from running import PATIENCE, python, wait_until

WRONG = "wrong\nin two lines"


def fail(*taken: Any) -> Any:
    """Be the callback of somebody who made a mistake."""
    raise KeyError(WRONG)


def unsendable(request: Any, response: Any) -> Any:
    """Return what ROS cannot convert."""
    response.message = "\ud800"
    return response


class Faulty(Managed, GraphNode):
    """A node all of whose callbacks fail."""

    task = "failing"

    def __init__(self) -> None:
        GraphNode.__init__(self, "slave_device")
        self.begin_lifecycle()
        self.create_service(Trigger, "~/fail", fail)
        self.create_service(SetBool, "~/answer", unsendable)
        self.create_subscription(Bool, "fails", fail, 10)
        self.create_timer(0.05, fail)
        events = SubscriptionEventCallbacks(matched=fail)
        self.create_subscription(Bool, "fails", lambda message: None, 10, event_callbacks=events)
        self.polled = self.requests(Trigger, "~/polled")

    def on_configure(self, state: Any) -> Outcome:
        """Fail, too."""
        return fail()


class Served:
    """A node in this process, served by the executor of all nodes."""

    def __init__(self, node: GraphNode, observer: Observer) -> None:
        self.node, self.observer = node, observer
        self.executor = EventsExecutor()
        self.executor.add_node(node)

    def turn(self) -> None:
        """Serve for a moment; whatever is raised here would end a node."""
        self.executor.spin_once(timeout_sec=0.0)
        self.observer.executor.spin_once(timeout_sec=0.005)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Serve until a condition holds."""

        def met() -> bool:
            self.turn()
            return condition()

        wait_until(met, what)

    def answer(self, kind: Any, name: str) -> Any:
        """Return the response of a service."""
        client = self.observer.node.create_client(kind, f"slave_device/{name}")
        self.until(client.service_is_ready, name)
        future = client.call_async(kind.Request())
        self.until(future.done, name)
        return future.result()


@pytest.fixture
def served(domain: int, observer: Observer) -> Iterator[Served]:
    """Serve a node whose callbacks fail."""
    rclpy.init()
    served = Served(Faulty(), observer)
    yield served
    served.executor.shutdown()
    served.node.destroy_node()
    rclpy.shutdown()


def failures(node: GraphNode) -> int:
    """Return the number of failures that diagnostics show."""
    return int(node._refusals()["callbacks failed"])


def test_whatever_callbacks_raise_the_node_goes_on_counts_and_answers(
    served: Served, capfd: pytest.CaptureFixture[str]
) -> None:
    failed = served.node._guard.failed
    for _ in range(2):
        answer = served.answer(Trigger, "fail")
        assert (answer.success, answer.message) == (False, r"KeyError: 'wrong\nin two lines'")
        answer = served.answer(SetBool, "answer")
        assert not answer.success
        assert answer.message.startswith("UnicodeEncodeError: ")
    publisher = served.observer.node.create_publisher(Bool, "fails", 10)
    served.until(lambda: publisher.get_subscription_count() == 2, "its subscribers")
    publisher.publish(Bool())
    kinds = ("/slave_device/fail", "/slave_device/answer", "/fails", "timer of 0.05 s")
    kinds = (*kinds, "event of a topic")
    served.until(lambda: all(failed[kind] for kind in kinds), f"all of {kinds}: {failed}")
    served.until(lambda: failed["timer of 0.05 s"] > 3, "a timer that goes on")
    assert failures(served.node) == failed.total()
    lines = [line for line in capfd.readouterr().err.splitlines() if "failed: " in line]
    assert len(lines) == len(kinds), lines


def test_a_polled_service_answers_though_its_response_cannot_be_sent(served: Served) -> None:
    client = served.observer.node.create_client(Trigger, "slave_device/polled")
    served.until(client.service_is_ready, "the service")
    future = client.call_async(Trigger.Request())

    def answered() -> bool:
        for _, answer in served.node.polled.drain():
            answer(Trigger.Response(success=True, message="\ud800"))
        return future.done()

    served.until(answered, "its answer")
    assert not future.result().success


def test_each_receiver_is_told_whoever_was_there_first() -> None:
    wire = Wire()
    before: list[bool] = []
    after: list[bool] = []
    wire.join(before.append)
    wire.offer()
    wire.join(after.append)
    assert (before, after) == ([False, True], [True])
    assert wire.listeners == 2


def test_a_signal_left_to_others_comes_as_messages_and_who_has_left_is_told_nothing() -> None:
    wire = Wire()
    told: list[bool] = []
    take = told.append
    wire.join(take)
    wire.offer()
    wire.offer(False)
    assert (told, wire.listeners) == ([False, True, False], 0)
    wire.offer()
    wire.leave(take)
    wire.offer(False)
    assert (told[3:], wire.listeners) == ([True], 0)


def test_only_nodes_that_are_to_share_a_process_share_wires() -> None:
    wires = Wires()
    alone = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is not alone
    wires.joined = True
    shared = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is shared
    assert wires.of("/left/master/measured_cp") is not shared


LOGGING = """
import ctypes, sys
from rclpy.logging import get_logger
from haptic_accel.nodes.scheduling import run_process
sleep = ctypes.CDLL(None).usleep

def log(word, lines):
    for number in range(lines):
        get_logger("node").info(f"{word} {number} " + "x" * 80)
        print(f"{word} {number} " + "y" * 80)

def act(signals):
    log("unread", 1500)
    told = int(sys.argv[1])
    import os
    os.write(told, b"goes on")
    os.read(told, 1)
    log("read", 10)
    while len(sys.argv) > 2 and not signals.ended():
        sleep(1000)

run_process("node", act)
"""

COLOUR = rb"(\x1b\[0m)?"
LINE = rb"(\[INFO\] \[\S+\] \[node\]: )?(unread|read) \d+ (x{80}|y{80})"
WHOLE = re.compile(COLOUR + LINE + COLOUR)


class Node:
    """A process that logs 0.3 MB and says so, then a little when it is asked to.

    Parameters
    ----------
    output : int, optional
        Descriptor of its standard output and error; both closed if not given.
    more : str
        Anything for a process that then waits for a signal.
    """

    def __init__(self, output: int | None, more: str = "") -> None:
        self._here, there = socket.socketpair()

        def prepare() -> None:
            signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where the tests run after nohup
            if output is None:
                os.closerange(0, 3)

        with there:
            self.process = subprocess.Popen(
                [sys.executable, "-c", LOGGING, str(there.fileno()), *([more] if more else [])],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                pass_fds=[there.fileno()],
                preexec_fn=prepare,
                start_new_session=True,
            )
        self._here.settimeout(PATIENCE)

    def goes_on(self) -> bool:
        """Return whether it has logged what nobody reads."""
        return self._here.recv(7) == b"goes on"

    def ask(self) -> None:
        """Let it log what is read."""
        self._here.send(b"!")

    def end(self) -> int:
        return self.process.wait(PATIENCE)

    def ends_in_order(self) -> None:
        """Check that it goes on, and ends once it has logged what is read."""
        assert self.goes_on()
        self.ask()
        assert self.end() == 0

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._here.close()


@pytest.fixture
def node() -> Iterator[Callable[..., Node]]:
    started: list[Node] = []

    def start(*given: int | str | None) -> Node:
        started.append(Node(*given))  # type: ignore[arg-type]
        return started[-1]

    yield start
    for each in started:
        each.close()


def terminal() -> tuple[int, int]:
    """Return both ends of a terminal that passes bytes as they are."""
    here, there = pty.openpty()
    tty.setraw(there)
    return here, there


def stream_sockets() -> tuple[int, int]:
    """Return both ends of a stream, as systemd connects services to its journal."""
    here, there = socket.socketpair()
    return here.detach(), there.detach()


def rest(reader: int) -> bytes:
    """Return what can be read until nobody writes any more."""
    text = b""
    while select.select([reader], [], [], PATIENCE)[0]:
        try:
            more = os.read(reader, 65536)
        except OSError:  # of a terminal whose other end is closed
            more = b""
        if not more:
            return text
        text += more
    raise AssertionError(f"no end after {len(text)} bytes")


@pytest.mark.parametrize("ends", rest_slow([os.pipe, terminal, stream_sockets]))
def test_a_process_whose_log_nobody_reads_goes_on(
    node: Callable[..., Node], ends: Callable[[], tuple[int, int]]
) -> None:
    reader, writer = ends()
    logging = node(writer)
    assert logging.goes_on()
    assert os.get_blocking(writer) or ends is stream_sockets, "others may share it"
    os.close(writer)
    before = os.read(reader, 10_000_000)
    while select.select([reader], [], [], 0)[0]:
        before += os.read(reader, 1_000_000)
    logging.ask()
    after = rest(reader)
    assert logging.end() == 0
    os.close(reader)
    assert len(before) < 250_000
    lines = (before + after).splitlines()
    cut = [line for line in lines if not WHOLE.fullmatch(line)]
    if ends is os.pipe:
        assert not cut, "what is read is whole lines"
    read = [line for line in after.splitlines() if WHOLE.fullmatch(line) and b"unread" not in line]
    assert len(read) == 20, "nothing is lost once somebody reads"


def test_a_full_disk_holds_no_process_up(node: Callable[..., Node]) -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    logging = node(full)
    os.close(full)
    logging.ends_in_order()


def test_closed_streams_hold_no_process_up(node: Callable[..., Node]) -> None:
    logging = node(None)
    assert logging.goes_on()
    streams = Path(f"/proc/{logging.process.pid}/fd")
    assert {os.readlink(streams / str(number)) for number in range(3)} == {os.devnull}
    logging.ask()
    assert logging.end() == 0


def test_a_file_has_every_line(node: Callable[..., Node], tmp_path: Path) -> None:
    with (tmp_path / "log").open("w") as file:
        file.write("before\n")
        file.flush()
        logging = node(file.fileno())
    logging.ends_in_order()
    lines = (tmp_path / "log").read_bytes().splitlines()
    assert lines[0] == b"before"
    assert len(lines) == 1 + 2 * 1510
    assert all(map(WHOLE.fullmatch, lines[1:]))


def test_the_end_of_its_terminal_ends_a_node_in_order(node: Callable[..., Node]) -> None:
    logging = node(subprocess.DEVNULL, "waits")
    assert logging.goes_on()
    logging.ask()
    logging.process.send_signal(signal.SIGTSTP)
    logging.process.send_signal(signal.SIGHUP)
    assert logging.end() == 0


SCRIPT = """import os
from haptic_accel.devices.rclpy_internals import NodeLogger

log = NodeLogger("arm")
os.stat = os.lstat = None  # nothing is asked of the file system

def speak():
    return log.info("cold"), log.warning("hot"), log.warn("too\\x1b hot\\n"), log.debug("silent")

print(speak())
"""


def test_a_line_names_who_logs_it_without_a_look_at_files(tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(SCRIPT)
    form = "{name} {severity} {function_name} {line_number} {message}"
    environment = os.environ | {"RCUTILS_CONSOLE_OUTPUT_FORMAT": form}
    done = python("program.py", cwd=tmp_path, env=environment)
    hot = ["arm WARN speak 8 hot", r"arm WARN speak 8 too\x1b hot\n"]
    assert done.stderr.splitlines() == ["arm INFO speak 8 cold", *hot]
    assert done.stdout.split() == ["(True,", "True,", "True,", "False)"]
