# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sampling and driving of a device without a graph, with the graph's safety layer."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.actuator import SafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.model import ZERO, FloatArray
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import ACTUATOR, ARM, DeviceSide, SafetyLayer
from haptic_accel.devices.interface import Device, DeviceError

KEPT = 20.0
"""Duration of the kept samples, s."""

LOOKS = 4
"""Number of polls for samples in a period."""

ATTEMPTS = 3
"""Number of measurements after which a device that is interrupted in each is refused."""

CATCH_UP = 0.1
"""Longest pause whose missed ticks are still sampled, s."""

ForceOverTime = Callable[[float], float]
"""Function from a time, s, to the actuator's force, N."""

Prepare = Callable[[], None]
"""Function that prepares the thread of the samples."""


@dataclass(frozen=True)
class Observation:
    """Samples of successive ticks; NaN where a sample is missing.

    Attributes
    ----------
    rate : float
        Ticks per second, Hz.
    acceleration : ndarray
        m/s^2, shape (n,).
    position : ndarray
        Position of the arm, m, shape (n, 3).
    force : ndarray
        Commanded force of the actuator from each tick on, N, shape (n,).
    """

    rate: float
    acceleration: FloatArray
    position: FloatArray
    force: FloatArray


class ObservedDevice:
    """Device sampled by a thread on the machine's grid, as by a device node.

    Parameters
    ----------
    device : Device
    safety : SafetyParameters
        Limits of the device's forces.
    rate : float
        Ticks per second, Hz.
    latency : int
        Ticks from a sample to the force that it causes.
    prepare : callable
        Function called first in the thread, to request a real-time priority.

    Attributes
    ----------
    failure : str
        One-line reason for which the thread has ended; empty if none.
    """

    def __init__(
        self, device: Device, safety: SafetyParameters, rate: float, latency: int, prepare: Prepare
    ) -> None:
        self._device, self._prepare = device, prepare
        self._rate, self._latency = rate, latency
        self._safety = SafetyLayer(safety, rate, device.axes)
        ahead = (ACTUATOR,) if device.description.ahead else ()
        self._side = DeviceSide(
            device, self._safety, rate, latency, time.monotonic, kinds=(ARM, ACTUATOR), ahead=ahead
        )
        length = round(KEPT * rate)
        self._samples: deque[tuple[int, float, tuple[float, ...]]] = deque(maxlen=length)
        self._forces: deque[tuple[int, float]] = deque(maxlen=length)
        self._force: ForceOverTime | None = None
        self._tick = self._began = 0
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="observed device", daemon=True)
        self.failure = ""

    def __enter__(self) -> ObservedDevice:
        """Open the device, and start sampling.

        Raises
        ------
        DeviceError
            The device cannot be opened.
        """
        self._device.open()
        self._safety.enable(time.monotonic(), True)
        self._tick = self._began = math.floor(time.monotonic() * self._rate)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the device without force."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self._device.close()

    @property
    def remark(self) -> str:
        """Remark of the device, such as the board's serial number."""
        return self._device.remark

    @property
    def problem(self) -> str:
        """One-line reason for missing samples or forces; empty if none."""
        return self.failure or self._device.problem

    @property
    def silent_for(self) -> float:
        """Time since the newest sample was taken, s."""
        with self._lock:
            newest = self._samples[-1][0] if self._samples else self._began
        return time.monotonic() - newest / self._rate

    def drive(self, force: ForceOverTime | None) -> None:
        """Command the actuator's force for each sample from now on; None for no commands."""
        self._force = force

    def stop(self) -> None:
        """Stop like an emergency stop: reject all further forces.

        The arm has no force and is not affected.
        """
        with self._lock:
            self._safety.stop(time.monotonic(), True)
            with suppress(DeviceError, OSError):
                self._device.write(time.monotonic(), actuator_force=ZERO)

    def arm(self) -> None:
        """Allow forces again."""
        with self._lock:
            self._safety.stop(time.monotonic(), False)
            self._safety.arm()
            self._device.arm()

    def last(self, seconds: float) -> Observation:
        """Return the samples of the last seconds; the newest samples may not have arrived yet."""
        count = round(seconds * self._rate)
        newest = self._tick - math.ceil(CATCH_UP * self._rate)
        return self._between(newest - count, newest)

    def observe(self, seconds: float) -> Observation:
        """Return the samples of the next seconds, after they have passed.

        The measurement is repeated if the device was interrupted.

        Raises
        ------
        DeviceError
            The device was interrupted in each of `ATTEMPTS` measurements.
        """
        for _ in range(ATTEMPTS):
            start, before = self._tick, self._device.interruptions
            time.sleep(seconds + CATCH_UP)
            if not (lost := self._device.interruptions - before):
                return self._between(start, start + round(seconds * self._rate))
        raise DeviceError(
            f"samples lost or shifted {lost} times in {seconds:g} s, must be none; measured"
            f" {ATTEMPTS} times: close other programs, and run haptic-accel doctor"
        )

    def _between(self, first: int, end: int) -> Observation:
        count = end - first
        acceleration, force = np.full(count, np.nan), np.zeros(count)
        position = np.full((count, 3), np.nan)
        with self._lock:
            samples, forces = list(self._samples), list(self._forces)
        for tick, value, point in samples:
            if first <= tick < end:
                acceleration[tick - first], position[tick - first] = value, point
        for tick, value in forces:
            if first <= tick < end:
                force[tick - first] = value
        return Observation(self._rate, acceleration, position, force)

    def _run(self) -> None:
        self._prepare()
        try:
            while not self._ending.wait(1 / (LOOKS * self._rate)):
                self._catch_up()
        except (DeviceError, OSError) as error:
            self.failure = str(error)

    def _catch_up(self) -> None:
        now = math.floor(time.monotonic() * self._rate)
        with self._lock:
            self._tick = max(self._tick, now - round(CATCH_UP * self._rate))
            while self._tick < now:
                self._tick += 1
                self._side.begin(self._tick)
                self._take()
                self._side.apply()
                self._side.watch()
            self._take()

    def _take(self) -> None:
        """Store the samples that have arrived, and answer each with a force."""
        self._side.read()
        for sample in self._side.samples:
            tick = sample.tick
            self._samples.append((tick, sample.acceleration[ACTUATOR_AXIS], sample.position))
            if self._force and not self._safety.refusal:
                due = tick + self._latency
                force = self._force(due / self._rate)
                moment = round(tick / self._rate * NANOSECONDS)
                self._side.command(ACTUATOR, moment, *along_actuator(force))
                self._forces.append((due, force))
