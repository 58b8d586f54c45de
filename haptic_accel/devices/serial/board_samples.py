# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples of a board whose actuator stays disarmed, for its calibration."""

from __future__ import annotations

import time

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.observed import Observation
from haptic_accel.devices.serial.device import MISSING_LIBRARY, PortParameters

try:
    from haptic_accel.devices.serial.link import BoardLink, Requirements
    from haptic_accel.devices.serial.protocol import Configuration, Identity, axes_bits
except ImportError:
    raise DeviceError(f"serial: {MISSING_LIBRARY}") from None

ARRIVAL = 2.0
"""Time to wait for samples beyond their duration, s."""


class BoardSamples:
    """Samples of a board's accelerometer, in counts; a context manager.

    Parameters
    ----------
    port : PortParameters
    rate : int
        Samples per second, Hz.
    axes : str
        Axes to sample, such as ``xyz``.

    Raises
    ------
    DeviceError
        The board cannot be opened, or has no such axis.
    """

    def __init__(self, port: PortParameters, rate: int, axes: str) -> None:
        self._counts: list[int] = []
        self._rate, self._axes = rate, axes
        configuration = Configuration(rate, axes_bits(axes), 1)
        required = Requirements(port.port, port.usb_serial, configuration)
        self._link = BoardLink(required, lambda _, samples: self._counts.extend(samples.counts))

    def __enter__(self) -> BoardSamples:
        """Connect, and start sampling."""
        self._link.open()
        return self

    def __exit__(self, *_: object) -> None:
        """Disconnect."""
        self._link.close()

    @property
    def identity(self) -> Identity:
        """Identity of the connected board."""
        assert self._link.identity
        return self._link.identity

    def last(self, seconds: float) -> Observation:
        """Return the newest uncalibrated samples of the axis with most gravity."""
        number = round(seconds * self._rate)
        rows = self._samples(self._counts[-number * len(self._axes) :])
        signal = np.full(number, np.nan)
        if len(rows):
            axis = int(np.argmax(np.abs(rows.mean(axis=0))))
            signal[-len(rows) :] = self.identity.nominal_gain * rows[:, axis]
        nothing = np.zeros(len(signal))
        return Observation(self._rate, signal, np.full((len(signal), 3), np.nan), nothing)

    def collect(self, seconds: float) -> FloatArray:
        """Return the samples of the next seconds, shape (n, axes), in counts.

        Raises
        ------
        DeviceError
            The board was disconnected.
        """
        number = round(seconds * self._rate) * len(self._axes)
        deadline = time.monotonic() + seconds + ARRIVAL
        self._counts.clear()
        while len(self._counts) < number and time.monotonic() < deadline:
            time.sleep(0.01)
        if self._link.problem:
            raise DeviceError(self._link.problem)
        return self._samples(self._counts[:number])

    def _samples(self, counts: list[int]) -> FloatArray:
        """Return the complete samples in successive counts, shape (n, axes)."""
        complete = len(counts) // len(self._axes) * len(self._axes)
        return np.array(counts[:complete], dtype=float).reshape(-1, len(self._axes))
