# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Zenoh datagrams between two hosts: encrypted, for holders of a certificate only.

The slave's host opens a router on one UDP port, to which the master's host connects. Both must
show certificates of the same authority, the slave for the host name used by the master. QUIC
datagrams carry the signals, so that a loss does not delay later datagrams.
"""

from __future__ import annotations

import json
import math
import os
import re
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from haptic_accel import ParameterError
from haptic_accel.kits.link.addresses import Route

AUTHORITY, CERTIFICATE, KEY = "ca.pem", "cert.pem", "key.pem"
"""Files of a host: certificate of the authority, own certificate, and private key."""

MISSING_LIBRARY = "transport zenoh needs eclipse-zenoh: pip install 'haptic_accel[zenoh]'"

RETRY = 0.25
"""Interval between the master host's connection attempts, s."""

OPENING = 2000
"""Timeout of a connection attempt, ms: three round trips of 0.5 s. It also ends an attempt that
started while a cable was unplugged."""

LEASE = 1000
"""Time without a sign of life after which a connection is renewed, ms. A peer that was killed and
restarted is found within 2 s."""

WAITING = 64
"""Number of datagrams stored for a slow thread, which discards older ones: 0.1 s."""

_HEAD = struct.Struct("<QQ")  # numbers of this datagram and of the newest received

REPEAT = 5.0
"""Minimum interval between log lines on rejections, s."""

ADVICE = "both hosts need certificates of one haptic-accel keys, for the names that they use"

_REASON = re.compile(r'reason: b?"([^"]+)"|(invalid peer certificate[^@]*?) at /')
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_LOGGED = re.compile(r"\S+Z .*?(WARN|ERROR) .*?zenoh\S*: (.*)")
_CLOSED = re.compile(r"on QUIC link .*(closed|lost)", re.IGNORECASE)


def check_keys(folder: str) -> Path:
    """Return the folder of a host's certificates after checking that all are readable.

    Raises
    ------
    ParameterError
        The message names the file that cannot be read.
    """
    if not folder:
        raise ParameterError(
            "keys = '': must be the folder of this host's certificates for transport zenoh;"
            " run haptic-accel keys to make them"
        )
    for name in (AUTHORITY, CERTIFICATE, KEY):
        try:
            Path(folder, name).read_bytes()
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ParameterError(
                f"keys = {folder!r}: {name}: {reason}; run haptic-accel keys to make it"
            ) from None
    return Path(folder)


def refusal(logged: str) -> str | None:
    """Return the reason for a rejection in a line of Zenoh's log.

    Empty for any other warning, such as a lost connection; None for other text.
    """
    logged = _COLOUR.sub("", logged)
    if not (found := _LOGGED.match(logged)):
        return None
    level, text = found[1], found[2].partition(" at /")[0]
    reason = _REASON.search(logged)
    if not reason and not _CLOSED.search(text):
        return f"zenoh: {text[:200]}" if level == "ERROR" else ""
    why = f": {(reason[1] or reason[2]).strip()}" if reason else " by the peer"
    return f"connection refused{why}; {ADVICE}"


class ZenohCarrier:
    """Transport of datagrams to and from the peer.

    Parameters
    ----------
    route : Route
    side : str
        Side of this host, from `ARMS`.
    namespace : str
        Namespace, starting with a slash; empty for the root.
    keys : str
        Folder with this host's certificates.
    say : callable
        Called with log lines, from any thread.

    Raises
    ------
    ParameterError
        The library or a file is missing.
    """

    def __init__(
        self, route: Route, side: str, namespace: str, keys: str, say: Callable[[str], None]
    ) -> None:
        try:
            import zenoh
        except ImportError:
            raise ParameterError(MISSING_LIBRARY) from None
        self._zenoh: Any = zenoh
        self._say, self._said = say, -REPEAT
        self._settings = settings(route, side, check_keys(keys))
        other = "slave" if side == "master" else "master"
        self._keys = [f"haptic_accel{namespace}/from_{name}" for name in (side, other)]
        self._session: Any = None
        self._publisher: Any = None
        self._pace, self._lock = Pace(), threading.Lock()
        self._newest = 0
        self._over = threading.Event()
        self._follow_log()

    def send(self, datagram: bytes) -> None:
        """Send a datagram; discard it without a connection."""
        if not self._publisher:
            return
        with self._lock:
            number = self._pace.number(time.monotonic())
        if number is not None:
            self._publisher.put(_HEAD.pack(number, self._newest) + datagram)

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Connect, and pass received datagrams on, until `close` is called."""
        while not self._over.is_set():
            try:
                self._session = self._zenoh.open(self._config())
                break
            except self._zenoh.ZError as error:
                if "connect" not in str(error):
                    raise OSError(str(error).partition(" at /")[0]) from None
                self._over.wait(RETRY)
        else:
            return
        subscriber = self._declared(self._session)
        while not self._over.is_set():
            try:
                message = subscriber.recv().payload.to_bytes()
            except self._zenoh.ZError:
                if not self._over.is_set():
                    raise
                break
            if len(message) < _HEAD.size:
                continue
            self._newest, acknowledged = _HEAD.unpack_from(message)
            with self._lock:
                self._pace.acknowledge(acknowledged, time.monotonic())
            deliver(message[_HEAD.size :])

    def close(self) -> None:
        """End the session."""
        self._over.set()
        if self._session:
            self._session.close()

    def _declared(self, session: Any) -> Any:
        """Return the subscriber of the peer's datagrams; from now on, `send` works."""
        zenoh = self._zenoh
        own, peers = self._keys
        subscriber = session.declare_subscriber(peers, zenoh.handlers.RingChannel(WAITING))
        self._publisher = session.declare_publisher(
            own,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            reliability=zenoh.Reliability.BEST_EFFORT,
        )
        return subscriber

    def _config(self) -> Any:
        config = self._zenoh.Config()
        for name, value in self._settings.items():
            config.insert_json5(name, json.dumps(value))
        return config

    def _follow_log(self) -> None:
        """Read Zenoh's log from standard output, the only explanation of a refused peer."""
        reading, writing = os.pipe()
        rest = os.dup(1)
        os.dup2(writing, 1)
        os.close(writing)
        self._zenoh.init_log_from_env_or("warn")
        threading.Thread(target=self._read_log, args=(reading, rest), daemon=True).start()

    def _read_log(self, reading: int, rest: int) -> None:
        with open(reading, encoding="utf-8", errors="replace") as log:
            for line in log:
                text = refusal(line)
                if text is None:
                    os.write(rest, line.encode())
                elif text and time.monotonic() - self._said >= REPEAT:
                    self._said = time.monotonic()
                    self._say(text)


def settings(route: Route, side: str, keys: Path) -> dict[str, Any]:
    """Return Zenoh's settings: one endpoint, certificates on both sides, no discovery."""
    listens = side == "slave"
    host = route.own if listens else route.host
    host = f"[{host}]" if ":" in host else host
    endpoints = [f"quic/{host}:{route.peer_port}?mixed_rel=1"]
    role = "listen" if listens else "connect"
    return {
        "mode": "router" if listens else "client",
        f"{role}/endpoints": endpoints,
        "connect/retry": {
            "period_init_ms": round(1000 * RETRY),
            "period_max_ms": round(1000 * RETRY),
            "period_increase_factor": 1,
        },
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/open_timeout": OPENING,
        "transport/link/tx/lease": LEASE,
        "transport/link/tls": {
            "root_ca_certificate": str(keys / AUTHORITY),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
            f"{role}_certificate": str(keys / CERTIFICATE),
            f"{role}_private_key": str(keys / KEY),
        },
    }


ROUND_TRIP_WINDOW = 0.1
"""Window for the shortest round trip, s: jitter lengthens many round trips, a queue all."""

REMEMBERED = 100
"""Number of windows whose shortest round trip counts as an empty queue's: 10 s."""

LATE = 0.01
"""Round trip in excess of the shortest that indicates a queue, s."""

STEADY = 5
"""Number of windows without a queue before the rate is increased."""

SPARSEST = 16
"""Maximum decimation factor: each packet of the coupling contains the last 16 samples."""

LONGEST_GAP = 0.01
"""Maximum interval between datagrams, s: a tenth of the coupling's watchdog timeout."""


class Pace:
    """Decimation of datagrams that avoids a queue before the network.

    Congestion control interprets lost and overtaken datagrams as overload. At 5 % loss it passes a
    few hundred per second; at 1000 per second, each waits seconds. Each datagram contains the
    number of the newest received from the peer. If the shortest round trip of a
    `ROUND_TRIP_WINDOW` grows by `LATE`, half of the datagrams are skipped, and more if that has no
    effect. The initial rate is low, as a queue takes seconds to drain.

    Attributes
    ----------
    stride : int
        Decimation factor: number of datagrams of which one is sent.

    Examples
    --------
    >>> pace = Pace()
    >>> [pace.number(now) for now in (0.0, 0.001)]
    [1, None]
    """

    def __init__(self) -> None:
        self.stride = SPARSEST // 2
        self._given = self._numbered = self._calm = 0
        self._last = -math.inf
        self._sent: deque[tuple[int, float]] = deque(maxlen=4096)
        self._least, self._until = math.inf, -math.inf
        self._windows: deque[float] = deque(maxlen=REMEMBERED)

    def number(self, now: float) -> int | None:
        """Return the number of a datagram to send at a time, s; None to skip it."""
        self._given += 1
        if self._given % self.stride and now - self._last < LONGEST_GAP:
            return None
        self._last = now
        self._numbered += 1
        self._sent.append((self._numbered, now))
        return self._numbered

    def acknowledge(self, newest: int, now: float) -> None:
        """Process the number of the newest datagram that the peer received."""
        trip = math.inf
        while self._sent and self._sent[0][0] <= newest:
            trip = now - self._sent.popleft()[1]
        self._least = min(self._least, trip)
        if now >= self._until and math.isfinite(self._least):
            self._windows.append(self._least)
            self._follow(self._least - min(self._windows))
            self._least, self._until = math.inf, now + ROUND_TRIP_WINDOW

    def _follow(self, excess: float) -> None:
        """Reduce the rate while a queue exists; increase it after some time without one."""
        if excess > LATE:
            self.stride, self._calm = min(2 * self.stride, SPARSEST), 0
            return
        self._calm += 1
        if self._calm >= STEADY:
            self.stride, self._calm = max(1, self.stride - 1), 0
