# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Control of the fast path from LeRobot's process: arguments, start, samples and end.

The samples are in memory that both processes share.
"""

from __future__ import annotations

import mmap
import os
import select
import shlex
import subprocess
import time

import numpy as np

from haptic_accel import Axes, FloatArray, ParameterError, Setup, Vector
from haptic_accel.core.process import module_command
from haptic_accel.devices import NO_ARM, DeviceError
from haptic_accel.setup import arguments as names
from haptic_accel.setup import assigned_keys, build_device

WRITTEN, TICKS, LATE, LOST, FELT = range(5)
"""Indices in `Ring.counts`: number of samples so far; of ticks; of ticks late by half a period or
more; of missing samples, replaced by the previous ones; steady time of the last request to let the
coil move, ns, set by the reader."""

SLOTS = 8192
"""Capacity of a ring, samples: 8 s at 960 Hz, so that the writer overtakes no reader."""

LONGEST = SLOTS // 2
"""Maximum number of samples read at once; the other half gives the reader 4 s at 960 Hz."""

_COLUMNS = 4  # tick, acceleration along x, y, z
_SIZE = 8 * (FELT + 1 + SLOTS * _COLUMNS)


class Ring:
    """Newest samples of one writer, for readers in other processes.

    Parameters
    ----------
    descriptor : int
        File of `memory_file`, which this process has made or inherited.

    Attributes
    ----------
    counts : ndarray of int
        See `WRITTEN` and the others.

    Notes
    -----
    The writer never waits for a reader. A reader checks that its copy was not overwritten.
    """

    def __init__(self, descriptor: int) -> None:
        memory = mmap.mmap(descriptor, _SIZE)
        self.counts = np.frombuffer(memory, np.int64, FELT + 1)
        slots = np.frombuffer(memory, np.float64, offset=self.counts.nbytes)
        self._slots = slots.reshape(SLOTS, _COLUMNS)

    def put(self, tick: int, acceleration: Vector) -> None:
        """Add the sample of a tick, m/s^2; skipped ticks repeat the previous sample."""
        if written := self.counts[WRITTEN]:
            before, *held = self._slots[(written - 1) % SLOTS].tolist()
            for missing in range(max(int(before) + 1, tick - SLOTS), tick):
                self._put(missing, *held)
                self.counts[LOST] += 1
        self._put(tick, *acceleration)

    def _put(self, *row: float) -> None:
        self._slots[self.counts[WRITTEN] % SLOTS] = row
        self.counts[WRITTEN] += 1  # last, because readers use all counted samples

    def newest(self, size: int) -> tuple[int, FloatArray] | None:
        """Return the newest tick, and the requested number of samples, the newest last.

        Parameters
        ----------
        size : int
            Number of samples, `LONGEST` at most.

        Returns
        -------
        tuple of int and ndarray, shape (size, 3), or None
            Tick, and accelerations in m/s^2; None until enough samples exist.
        """
        while (begin := int(self.counts[WRITTEN]) - size) >= 0:
            rows = self._slots[np.arange(begin, begin + size) % SLOTS]
            if self.counts[WRITTEN] - begin < SLOTS:
                return int(rows[-1, 0]), rows[:, 1:]
        return None


def memory_file() -> int:
    """Return the descriptor of a new file in memory, which exists until its last process ends.

    The file has no name: named shared memory outlives a killed process, and Python's tracker of
    such names would remove it when the first process ends.
    """
    descriptor = os.memfd_create("haptic_accel")
    os.ftruncate(descriptor, _SIZE)
    return descriptor


RATE = 960.0
"""Default rate, Hz: near the paper's 1 kHz, and a whole multiple of 24, 30, 48, 60 and 120, so
that a frame of LeRobot has a whole number of samples."""

DEVICES = NO_ARM, names.SIMULATED, names.VIRTUAL, names.REPLAY
"""Devices allowed as an arm: none, with a sound card, and those without hardware."""

START = 30.0
"""Time-out for the start of the process, s: loading libraries and measuring the card's round trip
are slow on a busy machine."""

END = 3.0
"""Time-out for the requested end of the process, s. If the card's server is gone, PortAudio never
ends."""

STALE = 0.2
"""Age of the newest sample above which the fast path counts as stopped, s: far above any card's
delay."""

RUNNING = "running:"
"""Prefix of the line that the process prints once it runs."""


def read_arguments(text: str) -> names.GraphArguments:
    """Return the arguments of ``haptic-accel teleop`` in a text, with this kit's rate.

    Raises
    ------
    ParameterError
        An argument is not allowed, or selects an arm, which LeRobot moves.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise ParameterError(f"arguments = {text!r}: {error}") from None
    found = names.parse_arguments(words)
    if "rate" not in assigned_keys(words) and found.rate == names.GraphArguments.rate:
        found = names.parse_arguments([*words, f"rate:={RATE:g}"])
    names.check_both_arms(found)
    for arm, device in (("master", found.master), ("slave", found.slave)):
        if device not in DEVICES:
            allowed = " or ".join(DEVICES)
            raise ParameterError(f"{arm} = {device!r}: must be {allowed}: LeRobot moves the arms")
    return found


def samples_per_frame(rate: float, fps: int) -> int:
    """Return the samples of the fast path in a frame of LeRobot.

    Raises
    ------
    ParameterError
        The number is not whole, or too large to read at once.
    """
    if fps < 1 or rate % fps or rate > fps * LONGEST:
        raise ParameterError(
            f"fps = {fps}: must divide the fast path's rate, {rate:g} Hz, into whole numbers up to"
            f" {LONGEST}; give another rate:="
        )
    return round(rate / fps)


def tool_axes(arguments: names.GraphArguments) -> Axes:
    """Return the axes of the gripper's accelerometer.

    Raises
    ------
    ParameterError
        The accelerometer's parameters are unusable.
    """
    return build_device("slave_device", *Setup.of(arguments).node("slave_device")).axes


class FastPath:
    """Running fast path, whose coil is silent until `feel`.

    The fast path is a separate process, because a thread would share Python's lock with LeRobot,
    whose loop, networks and image encoding hold it for 5 ms and more, or five ticks. The process
    is started without `multiprocessing`, which would load LeRobot's program again.

    Parameters
    ----------
    arguments : GraphArguments

    Attributes
    ----------
    arguments : GraphArguments
    remarks : str
        Remarks of the devices, and the scheduling class of the process.
    process : Popen
    ring : Ring
    users : int
        Number of devices that use the fast path; see `join`.
    is_told : bool
        True once a device has logged its `problem`.

    Raises
    ------
    DeviceError
        The fast path does not start: no card, no answer of an accelerometer, or an invalid value.
    """

    def __init__(self, arguments: names.GraphArguments) -> None:
        self.arguments, self.users, self.is_told, self._reason = arguments, 0, False, ""
        descriptor = memory_file()
        self.ring = Ring(descriptor)
        command = module_command("haptic_accel.kits.lerobot.felt_loop")
        words = str(descriptor), str(os.getpid()), *names.assigned(arguments)
        self.process = subprocess.Popen(
            [*command, *words], stdout=subprocess.PIPE, pass_fds=[descriptor], text=True
        )
        os.close(descriptor)
        assert self.process.stdout
        self._output = self.process.stdout
        try:
            self.remarks = self._started()
        except BaseException:
            self.close()
            raise

    def _started(self) -> str:
        """Wait until the process runs; return its remarks."""
        if not select.select([self._output], [], [], START)[0]:
            raise DeviceError(f"fast path: not running after {START:g} s")
        line = self._line()
        if not line.startswith(RUNNING):
            raise DeviceError(f"fast path: {line}")
        return line.removeprefix(RUNNING).strip()

    def _line(self) -> str:
        """Return the next line of the process, or the reason of its end."""
        line = self._output.readline().strip()
        return line or f"ended with status {self.process.wait()}"

    @property
    def problem(self) -> str:
        """Reason why no vibration is rendered or measured; empty while the fast path runs."""
        # Read the reason without waiting for the end, which a lost card may delay forever.
        if not self._reason and select.select([self._output], [], [], 0)[0]:
            self._reason = self._line()
        if self._reason:
            return self._reason
        newest = self.ring.newest(1)
        age = time.monotonic() - newest[0] / self.arguments.rate if newest else 0.0
        return f"no sample for {age:.1f} s" if age > STALE else ""

    def feel(self) -> None:
        """Let the coil move for half a second, from the next tick on."""
        self.ring.counts[FELT] = time.monotonic_ns()

    def window(self, size: int) -> FloatArray | None:
        """Return the newest samples, after a wait at the start; None if there is a `problem`.

        Returns
        -------
        ndarray, shape (size, 3), or None
            Acceleration, m/s^2, the newest last.
        """
        while not self.problem:
            if found := self.ring.newest(size):
                return found[1]
            time.sleep(1 / self.arguments.rate)
        return None

    def close(self) -> None:
        """End the process with a silent coil."""
        with self.process as process:
            process.terminate()
            try:
                process.wait(END)
            except subprocess.TimeoutExpired:
                process.kill()


_RUNNING: list[FastPath] = []
"""Fast path that leader and follower of this process share, as a card can be opened only once."""


def join(arguments: names.GraphArguments) -> FastPath:
    """Return the fast path of this process; the first call starts it.

    Raises
    ------
    ParameterError
        The fast path runs with other arguments.
    DeviceError
        It does not start.
    """
    path = next((each for each in _RUNNING if not each.problem), None)
    if path is None:
        path = FastPath(arguments)
        _RUNNING.append(path)
    if path.arguments != arguments:
        given, known = (" ".join(names.assigned(each)) for each in (arguments, path.arguments))
        raise ParameterError(
            f"arguments = {given!r}: must be {known!r}, as leader and follower share one fast path"
        )
    path.users += 1
    return path


def leave(path: FastPath) -> None:
    """End a fast path once the last device that has joined it leaves."""
    path.users -= 1
    if not path.users:
        _RUNNING.remove(path)
        path.close()
