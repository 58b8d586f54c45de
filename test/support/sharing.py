# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS domains of tests, and graphs that several tests look at."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import ClassVar

import pytest

from haptic_accel.core.process import DONE, module_command
from running import Command, nodes_of, open_ports, reserved_domain, use_domain, wait_until


@contextmanager
def own_domain(variables: Mapping[str, str] | None = None) -> Iterator[int]:
    """Give this process, and every process it starts, a ROS domain and variables meanwhile."""
    with reserved_domain() as number, pytest.MonkeyPatch.context() as environment:
        use_domain(environment, number)
        for name, value in (variables or {}).items():
            environment.setenv(name, value)
        yield number
    # What tests leave open in their own process would send in the domain of a later one.
    wait_until(lambda: not any(open_ports(number)), f"nobody is left in ROS domain {number}")


class SharedGraph:
    """Graph that tests only look at.

    Parameters
    ----------
    domain : int
        Its ROS domain.
    words : list of str
        What Python runs.
    folder : callable
        Makes a new working directory.

    Attributes
    ----------
    folder : Path
        Working directory of the command that runs now.
    command : Command
    """

    folder: Path
    command: Command

    def __init__(self, domain: int, words: list[str], folder: Callable[[], Path]) -> None:
        self.domain = domain
        self._words, self._new_folder = words, folder
        self._begun = False

    def run(self) -> None:
        """Start the graph where it does not run, and wait until its arms are engaged.

        One whose arms did not engage is not left for the next test.
        """
        if self._begun and self.command.process.poll() is None:
            return
        self.close()  # what may be left of one that died
        self.folder, self._begun = self._new_folder(), True
        self.command = Command(self._words, self.folder)
        try:
            self.command.wait_for("engaged")
        except AssertionError:
            self.close()
            raise

    def end(self) -> None:
        """End the graph by Ctrl-C, cleanly."""
        assert self.command.end(signal.SIGINT) == DONE, self.command.text
        assert nodes_of(self.domain) == {}

    def close(self) -> None:
        """Kill the graph where it still runs."""
        if self._begun and self.command.process.poll() is None:
            self.command.process.kill()
        if self._begun:
            self.command.end()
        wait_until(lambda: nodes_of(self.domain) == {}, "all nodes ended")


class LookAtOneGraph:
    """Class of tests that look at one graph, started with the first and ended by the last.

    A subclass names the words of ``haptic-accel``. The fixtures of all tests, such as `observer`
    and `ask`, join the graph's ROS domain. A graph that has died is started again for the next
    test. The last test calls `graph.end`.
    """

    WORDS: ClassVar[tuple[str, ...]]
    VARIABLES: ClassVar[Mapping[str, str]] = {}

    @pytest.fixture(scope="class")
    @classmethod
    def domain(cls) -> Iterator[int]:
        with own_domain(cls.VARIABLES) as number:
            yield number

    @pytest.fixture(scope="class")
    @classmethod
    def shared_graph(
        cls, domain: int, tmp_path_factory: pytest.TempPathFactory
    ) -> Iterator[SharedGraph]:
        _, *words = module_command("haptic_accel.cli.main")
        words += cls.WORDS
        graph = SharedGraph(domain, words, lambda: tmp_path_factory.mktemp("graph"))
        yield graph
        graph.close()

    @pytest.fixture
    def graph(self, shared_graph: SharedGraph) -> SharedGraph:
        shared_graph.run()
        return shared_graph
