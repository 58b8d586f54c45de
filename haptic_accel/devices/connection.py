# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Connection to hardware with a separate thread that reads, and reconnects after a loss."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Mapping

from haptic_accel.devices.interface import DeviceError

RETRY = 0.2
"""Time between attempts to connect again, s."""

JOIN_TIMEOUT = 5.0
"""Longest time for a driver to return from connecting or reading, s."""

AUTO, MANUAL = "auto", "manual"
"""Values of the parameter `rearm`: forces after a lost connection are allowed automatically or by
a user."""


class Connection(ABC):
    """Base of connections to hardware.

    A subclass connects, receives and disconnects. Its methods raise `DeviceError` when the
    hardware is gone; the thread then disconnects and retries to connect.

    Attributes
    ----------
    connected : bool
        True from a successful `_connect` until `_disconnect`.
    problem : str
        Reason for a missing connection, in one line; empty while connected.
    losses, reconnects : int
        Numbers of lost and restored connections.
    """

    def __init__(self) -> None:
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self.connected = False
        self.problem = ""
        self.losses = self.reconnects = 0

    def open(self) -> None:
        """Connect, and stay connected from now on.

        Raises
        ------
        DeviceError
            The connection cannot be made.
        """
        self._closing.clear()
        try:
            self._connect()
        except DeviceError:
            self._disconnect()
            raise
        self.problem = ""
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the hardware without force; may be called even if never opened."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join(JOIN_TIMEOUT)
            self._thread = None
        if self.connected:
            self._release()
        self._disconnect()

    @abstractmethod
    def _connect(self) -> None:
        """Make the connection or raise `DeviceError`."""

    @abstractmethod
    def _receive(self) -> None:
        """Wait a short time for data and process it; raise `DeviceError` if the link is lost."""

    @abstractmethod
    def _release(self) -> None:
        """Remove all forces, as far as the hardware still answers."""

    @abstractmethod
    def _disconnect(self) -> None:
        """Close a connection, even if `_connect` only succeeded in part."""

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                if not self.connected:
                    self._connect()
                    self.reconnects += 1
                    self.problem = ""
                self._receive()
            except DeviceError as error:
                self.losses += self.connected
                self.problem = str(error)
                self._disconnect()
                self._closing.wait(RETRY)


def explained(error: BaseException, reasons: Mapping[int, str]) -> str:
    """Return the explanation of an error by its errno; empty if unknown.

    Parameters
    ----------
    error : BaseException
        Error whose causes are searched as well.
    reasons : mapping
        Explanations by number, as in the module `errno`.
    """
    cause: BaseException | None = error
    while cause is not None:
        if (number := getattr(cause, "errno", None) or 0) in reasons:
            return reasons[number]
        cause = cause.__cause__ or cause.__context__
    return ""
