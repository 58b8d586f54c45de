# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Graph on a separate thread of a process, which writes its output to a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread

from haptic_accel.graph.supervisor import Outcome, Supervisor
from haptic_accel.setup.processes import Process


class BackgroundGraph:
    """Graph on a separate thread, until it ends or is closed.

    Parameters
    ----------
    processes : sequence of Process
    log : Path
        File to which its output is added.
    """

    def __init__(self, processes: Sequence[Process], log: Path) -> None:
        self._log = log.open("a", encoding="utf-8")
        self._supervisor = Supervisor(processes, on_line=self._write)
        self._stop = Event()
        self._outcome: Outcome | Exception | None = None
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def ended(self) -> str:
        """Reason for which the graph has ended; empty while it runs."""
        outcome = self._outcome
        if isinstance(outcome, Outcome):
            return f"graph: {outcome.first or 'it'} ended with status {outcome.status}"
        return f"graph: {outcome}" if outcome else ""

    def stop_forces(self) -> None:
        """Remove all forces; they stay off until the graph is closed."""
        self._supervisor.stop_forces()

    def close(self) -> None:
        """End all processes."""
        self._stop.set()
        self._thread.join()
        self._log.close()

    def _run(self) -> None:
        try:
            self._outcome = self._supervisor.run(self._stop.is_set)
        except Exception as error:
            self._outcome = error

    def _write(self, name: str, line: str) -> None:
        print(f"[{name}] {line}", file=self._log, flush=True)
