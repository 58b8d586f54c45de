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

"""Fast path as LeRobot's process sees it: its arguments, its start, its samples, its end."""

from __future__ import annotations

import json
import os
import select
import shlex
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress

from haptic_accel.core.axes import Axes
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import module_command
from haptic_accel.devices import DeviceError
from haptic_accel.devices.sound_bench import NO_ARM
from haptic_accel.kits.lerobot.exchange import FEEL, LONGEST, MUTE, Ring, memory_file
from haptic_accel.setup.arguments import (
    SIMULATED,
    VIRTUAL,
    GraphArguments,
    check_both_arms,
    parse_arguments,
    stated_words,
)
from haptic_accel.setup.node_parameters import build_device
from haptic_accel.setup.setup import Setup
from haptic_accel.setup.words import given_keys

RATE = 960.0
"""Rate without ``rate:=``, Hz: near the paper's 1 kHz, and a whole multiple of 24, 30, 48, 60 and
120, so that a frame of LeRobot has a whole number of samples."""

START = 30.0
"""Longest time until the process runs, s: it loads its libraries and measures the card's round
trip, which a busy machine makes slow."""

END = 3.0
"""Longest time for the process to end when it is told to, s. Where the card's server is gone,
PortAudio never ends."""

STALE = 0.2
"""Age of the newest sample above which the fast path counts as stopped, s: far above the delay of
any card."""


def read_arguments(text: str) -> GraphArguments:
    """Return the arguments of ``haptic-accel teleop`` in a text, with this kit's rate.

    Raises
    ------
    ParameterError
        A word or a value is not allowed, or names an arm that LeRobot moves.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise ParameterError(f"arguments = {text!r}: {error}") from None
    found = parse_arguments(words)
    if "rate" not in given_keys(words) and found.rate == GraphArguments.rate:
        found = parse_arguments([*words, f"rate:={RATE:g}"])
    check_both_arms(found)
    allowed = {"master": (NO_ARM, SIMULATED), "slave": (NO_ARM, SIMULATED, VIRTUAL)}
    for arm, devices in allowed.items():
        if (device := getattr(found, arm)) not in devices:
            raise ParameterError(
                f"{arm} = {device!r}: must be {' or '.join(devices)}, as LeRobot moves the arms"
            )
    return found


def samples_per_frame(rate: float, fps: int) -> int:
    """Return the samples of the fast path in a frame of LeRobot.

    Raises
    ------
    ParameterError
        They are not a whole number, or too many to be read together.
    """
    if fps < 1 or rate % fps:
        raise ParameterError(
            f"fps = {fps}: must divide the fast path's rate, {rate:g} Hz, into a whole number of"
            " samples; give another rate:="
        )
    if (size := round(rate / fps)) > LONGEST:
        raise ParameterError(f"fps = {fps}: must be at least {rate / LONGEST:g} at {rate:g} Hz")
    return size


def tool_axes(arguments: GraphArguments) -> Axes:
    """Return the axes of the gripper's accelerometer.

    Raises
    ------
    ParameterError
        Its parameters are not usable.
    """
    own, options = Setup.of(arguments).node("slave_device")
    return build_device("slave_device", own, options).axes


class FastPath:
    """Running fast path, with a silent coil until `feel`.

    It is a process of its own, because a thread would share Python's lock with LeRobot, whose
    loop, networks and image encoding hold it for 5 ms and more: five ticks. It is a new
    Python rather than a child of `multiprocessing`, which would load LeRobot's script again.

    Parameters
    ----------
    arguments : GraphArguments

    Attributes
    ----------
    arguments : GraphArguments
    remarks : list of str
        Remarks of the devices, and the process' scheduling.
    users : int
        Number of devices that use it; see `join`.

    Raises
    ------
    DeviceError
        It cannot start: no card, no answer of an accelerometer, a value that is not allowed.
    """

    def __init__(self, arguments: GraphArguments) -> None:
        self.arguments, self.users = arguments, 0
        self._reason = ""
        descriptor = memory_file()
        try:
            self._ring = Ring(descriptor)
            self._process = subprocess.Popen(
                [
                    *module_command("haptic_accel.kits.lerobot.felt_loop"),
                    *(str(descriptor), str(os.getpid()), *stated_words(arguments)),
                ],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[descriptor],
                bufsize=0,
            )
        finally:
            os.close(descriptor)
        try:
            self.remarks = self._started()
        except BaseException:
            self.close()
            raise

    def _started(self) -> list[str]:
        """Wait until the process runs; return its remarks."""
        assert self._process.stdout
        readable, _, _ = select.select([self._process.stdout], [], [], START)
        if not readable:
            raise DeviceError(f"fast path: not running after {START:g} s")
        found: dict[str, list[str]] = json.loads(line) if (line := self._line()) else {}
        if "remarks" not in found:
            raise DeviceError(f"fast path: {found.get('error', self._status())}")
        return found["remarks"]

    def _line(self) -> bytes:
        assert self._process.stdout
        return self._process.stdout.readline()

    def _status(self) -> str:
        return f"ended with status {self._process.wait()}"

    @property
    def problem(self) -> str:
        """Reason why no vibration is felt or measured; empty while the fast path runs."""
        if self._reason:
            return self._reason
        if self._process.poll() is not None:
            line = self._line()
            self._reason = json.loads(line)["error"] if line else self._status()
            return self._reason
        newest = self._ring.newest(1)
        assert newest
        age = time.monotonic() - newest[0] / self.arguments.rate
        return f"no sample for {age:.1f} s" if age > STALE else ""

    @property
    def process_id(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def ticks(self) -> tuple[int, int]:
        """Numbers of ticks, and of late ticks."""
        return self._ring.ticks

    def feel(self, felt: bool) -> None:
        """Let the coil move, or silence it; do nothing once the process has ended."""
        assert self._process.stdin
        with suppress(OSError):
            self._process.stdin.write(FEEL if felt else MUTE)

    def window(self, size: int) -> tuple[int, FloatArray] | None:
        """Return the newest tick and samples, as `Ring.newest`, which are awaited at the start.

        None if the fast path has a `problem`.
        """
        while not self.problem:
            if found := self._ring.newest(size):
                return found
            time.sleep(1 / self.arguments.rate)
        return None

    def close(self) -> None:
        """End the process, with a silent coil."""
        with self._process as process:
            assert process.stdin
            process.stdin.close()
            # A process that was forked meanwhile may hold the other end open.
            process.terminate()
            try:
                process.wait(END)
            except subprocess.TimeoutExpired:
                process.kill()


_RUNNING: list[FastPath] = []
"""Fast path that the leader and the follower of this process share: a card opens once."""


def join(arguments: GraphArguments) -> FastPath:
    """Return the fast path of this process, which the first device starts.

    Raises
    ------
    ParameterError
        It runs with other arguments.
    DeviceError
        It cannot start.
    """
    path = next((each for each in _RUNNING if not each.problem), None)
    if path is None:
        path = FastPath(arguments)
        _RUNNING.append(path)
    elif path.arguments != arguments:
        raise ParameterError(
            f"arguments = {_text(arguments)!r}: must be {_text(path.arguments)!r}, as leader and"
            " follower share one fast path"
        )
    path.users += 1
    return path


def leave(path: FastPath) -> None:
    """End a fast path once the last device that has joined it leaves."""
    path.users -= 1
    if not path.users:
        _RUNNING.remove(path)
        path.close()


def _text(arguments: GraphArguments) -> str:
    words: Sequence[str] = stated_words(arguments)
    return " ".join(words)
