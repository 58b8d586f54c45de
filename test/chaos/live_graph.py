# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A graph whose processes are started, hurt and started again one by one."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Collection
from dataclasses import replace
from pathlib import Path

from chaos.device_trace import DeviceTrace, Held
from chaos.traced_node import ACTUATOR, ARM, CLOCK, CLOCK_FILE, TELEOP
from haptic_accel.core.process import CUT_SHORT, DONE
from haptic_accel.core.topics import MASTER_STOPPED, SLAVE_STOPPED
from haptic_accel.nodes.supervised_node import message_type, quality
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.processes import COMPOSED, graph
from haptic_accel.setup.setup import RECORDER, SCOPE
from observing import Observer
from running import PATIENCE, Command, free_port, processes_of

RATE = 200.0
"""Samples per second, Hz: few enough for a machine that is busy with other things, too."""

FLOWING = 10
"""Forces of each kind after which forces count as flowing."""

LOOK_PERIOD = 0.02
"""Interval between looks at the graph, s."""

VIEWER = """
import asyncio
import sys
import aiohttp

async def look(page):
    while True:
        try:
            async with (
                aiohttp.ClientSession(headers={"Origin": page}) as session,
                session.ws_connect(f"{page}/live") as live,
            ):
                print("looks", flush=True)
                async for message in live:
                    pass
        except (aiohttp.ClientError, OSError):
            pass
        await asyncio.sleep(0.1)

asyncio.run(look(sys.argv[1]))
"""
"""A page that stays open, and connects again when the scope is back."""

Force = tuple[str, int]
"""A device and a kind of force."""

FORCES: tuple[Force, ...] = (
    ("master_device", ARM),
    ("slave_device", ARM),
    ("master_device", ACTUATOR),
)


SEPARATE = "separate"
ARRANGEMENTS = (COMPOSED, SEPARATE, TELEOP)
"""Arrangements of the graph: all nodes in one process beside the recorder, as is the default; a
process for each node; or the verb, which starts and watches the processes of the default."""


class LiveGraph:
    """The graph with traced devices; whatever looks at it fails where a promise is broken.

    Parameters
    ----------
    folder : Path
    observer : Observer
    controller, arrangement : str

    Attributes
    ----------
    nodes : dict
        Running processes by executable.
    stopped : dict
        What each device said last about the emergency stop.
    lead : int
        Time by which the clock was set, ns.
    page : str
        Address of the live page.
    """

    def __init__(
        self, folder: Path, observer: Observer, controller: str, arrangement: str
    ) -> None:
        self.folder = folder
        self.observer = observer
        self.nodes: dict[str, Command] = {}
        self.stopped: dict[str, bool] = {}
        self.lead = 0
        arguments = GraphArguments(
            rate=RATE,
            surface="text",
            controller=controller,
            composed=arrangement == COMPOSED,
            bag=str(folder / "bag"),
            scope=True,
            scope_control=True,
            scope_port=free_port(),
        )
        self.page = f"http://127.0.0.1:{arguments.scope_port}"
        self._processes = {process.executable: process for process in graph(arguments)}
        self._homes = {
            node: TELEOP if arrangement == TELEOP else process.executable
            for process in self._processes.values()
            for node in process.parameters
        }
        said = ("rate", "surface", "controller", "scope", "scope_control", "scope_port")
        self._words = [f"{name}:={str(getattr(arguments, name)).lower()}" for name in said]
        self._bags = 0
        self._traces = {name: DeviceTrace(folder / name, RATE) for name, _ in FORCES}
        for topic, device in ((MASTER_STOPPED, "master_device"), (SLAVE_STOPPED, "slave_device")):
            observer.node.create_subscription(
                message_type(topic),
                topic.name,
                lambda message, device=device: self.stopped.update({device: message.data}),
                quality(topic),
            )
        (folder / CLOCK_FILE).write_bytes(CLOCK.pack(0))
        for executable in dict.fromkeys(self._homes.values()):
            self.start(executable)
        self._viewer = Command(["-c", VIEWER, self.page], folder)

    @property
    def bag(self) -> Path:
        """File that the recorder writes."""
        return self.folder / f"bag{self._bags}" / f"bag{self._bags}_0.mcap"

    @property
    def viewed(self) -> bool:
        """True if the live page has been seen."""
        return bool(self._viewer.lines)

    def left(self, domain: int) -> set[int]:
        """Return the processes in a ROS domain that belong to the graph."""
        return {number for number, _ in processes_of(domain)} - {self._viewer.process.pid}

    @property
    def now(self) -> int:
        """Time by the nodes' clock, ns."""
        return time.time_ns() + self.lead

    def start(self, executable: str) -> None:
        """Start a process of the graph."""
        traced = str(Path(__file__).with_name("traced_node.py"))
        words = [traced, executable, str(self.folder), *self._arguments(executable)]
        self.nodes[executable] = Command(words, self.folder)

    def _arguments(self, executable: str) -> list[str]:
        self._bags += executable in (RECORDER, TELEOP)
        if executable == TELEOP:
            return [*self._words, f"bag:={self.bag.parent}"]
        process = self._processes[executable]
        if executable == RECORDER:
            given = {**process.parameters[RECORDER], "bag": str(self.bag.parent)}
            process = replace(process, parameters={RECORDER: given})
        return process.ros_arguments(self.folder)

    def lines(self, node: str) -> list[str]:
        """Return the output of the process that runs a node, which grows."""
        return self.nodes[self._homes[node]].lines

    def end(self, executable: str, number: signal.Signals, *expected: int) -> None:
        """End a process of the graph with a signal; without a traceback, and as expected."""
        node = self.nodes.pop(executable)
        status = node.end(number)
        for name, home in self._homes.items():
            if home == executable:
                self.stopped.pop(name, None)
        assert status in expected, f"{status}: {node.text}"
        assert "Traceback" not in node.text, node.text

    def end_all(self) -> None:
        """End all processes as the supervisor does, also one that has just been started."""
        for executable in sorted(self.nodes, key=(SCOPE, RECORDER).__contains__):
            self.end(executable, signal.SIGTERM, DONE, -signal.SIGTERM, *CUT_SHORT)

    def kill_all(self) -> None:
        """Leave nothing behind."""
        for node in (*self.nodes.values(), self._viewer):
            node.process.kill()
            node.end()

    def set_clock(self, lead: int) -> None:
        """Set the clock of all nodes ahead of the system's by so many ns."""
        self.lead = lead
        with (self.folder / CLOCK_FILE).open("r+b") as file:
            file.write(CLOCK.pack(lead))

    def look(self, seconds: float = LOOK_PERIOD) -> None:
        """Hold everything known against what is promised for every moment."""
        self.observer.executor.spin_once(timeout_sec=seconds)
        for trace in self._traces.values():
            trace.follow()
        for name, node in self.nodes.items():
            assert node.process.poll() is None, f"{name} has ended:\n{node.text}"

    def within(self, seconds: float, condition: Callable[[], bool]) -> bool:
        """Return whether a condition comes to hold within a time."""
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                return False
            self.look()
        return True

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until a condition holds, as is promised."""
        if not self.within(PATIENCE, condition):
            said = (line for node in self.nodes.values() for line in node.lines[-5:])
            raise AssertionError("\n".join((f"not in {PATIENCE:g} s: {what}", *said)))

    def pause(self, seconds: float) -> None:
        """Let the graph run for a time."""
        self.within(seconds, lambda: False)

    def flow(self) -> Callable[[], bool]:
        """Return a condition that holds once every force was given again and again from now."""
        given = [self._held(force).times for force in FORCES]
        enough = [len(times) + FLOWING for times in given]
        return lambda: all(len(times) >= n for times, n in zip(given, enough, strict=True))

    def expect_no_force(self, since: float, forces: Collection[Force] = FORCES) -> None:
        """Hold against the traces that no force was given since a steady time, s."""
        self.look()
        for force in forces:
            late = [f"{given - since:.3f}" for given in self._held(force).times if given >= since]
            assert not late, f"{force} given so many s later: {', '.join(late[:10])}"

    def wait_without(self, forces: Collection[Force]) -> None:
        """Wait until forces are zero."""
        self.wait_for(lambda: not any(self._held(f).force for f in forces), f"no {forces}")

    def forget(self) -> None:
        """Forget the forces that were given."""
        for force in FORCES:
            self._held(force).times.clear()

    def given(self, force: Force) -> list[float]:
        """Return the steady times at which a force was given since `forget`, s."""
        return self._held(force).times

    def _held(self, force: Force) -> Held:
        device, kind = force
        return self._traces[device].held[kind]
