# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bad wire: two network namespaces joined by a network that delays, loses and doubles frames.

Each namespace has a TAP device. One process reads frames from each device, sends them through a
`Channel` and writes them to the other. The namespaces end with that process, and the process ends
with its standard input, so that killed tests leave nothing behind.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import select
import socket
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from types import TracebackType
from typing import Any

from haptic_accel.core.network import Channel, ChannelParameters

ADDRESSES = ("10.77.0.1", "10.77.0.2")
"""IPv4 address of each end."""

TUN = "/dev/net/tun"

DEVICE = "wire0"
"""Name of the TAP device in each namespace."""

CARRIED = ChannelParameters()
"""Wire without impairments."""

PRIORITY = 45
"""Real-time priority of the process, above every node and below the kernel's threads at 50:
a network does not wait for the processors of its hosts, and a busy machine is no slow network."""

LARGE = 200
"""Length of a frame with the smallest packet of the coupling, less 10 bytes."""

_MARK = b"hapt"
"""First bytes of a packet of the coupling."""

_MACS = ("02:00:00:00:77:01", "02:00:00:00:77:02")
_LIBC = ctypes.CDLL(None, use_errno=True)
_IPV4 = b"\x08\x00"
_CLONE_NEWNET = 0x40000000  # linux/sched.h
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000  # linux/if_tun.h
_LONGEST_FRAME = 2048
_LONGEST_WAIT = 0.1


def reason_against() -> str | None:
    """Return why this machine cannot make a wire."""
    if "CI" in os.environ:
        return "CI has no network namespaces"
    if os.geteuid() != 0:
        return "network namespaces need root"
    return None if os.access(TUN, os.R_OK | os.W_OK) else f"{TUN} is not there"


class Wire:
    """Two namespaces and the wire between them.

    Parameters
    ----------
    parameters : ChannelParameters
        Behaviour in both directions.
    seed : int

    Attributes
    ----------
    process : Popen
        Process that carries the frames.
    """

    def __init__(self, parameters: ChannelParameters = CARRIED, seed: int = 1) -> None:
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen([sys.executable, __file__, str(seed)], **pipes)
        self._namespaces: list[int] = self._answer()
        self.change(parameters)

    def __enter__(self) -> Wire:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def inside(self, end: int, words: Sequence[str]) -> list[str]:
        """Return the command line that runs a command on the host at an end, 0 or 1.

        The host has its own network and its own shared memory, as another machine would.
        """
        network = f"--net=/proc/{self.process.pid}/fd/{self._namespaces[end]}"
        mounted = 'mount -t tmpfs none /dev/shm; exec "$@"'
        return ["nsenter", network, "unshare", "--mount", "sh", "-c", mounted, "sh", *words]

    def change(self, there: ChannelParameters, back: ChannelParameters | None = None) -> None:
        """Set the behaviour from end 0 to end 1, and back: the same by default."""
        self._ask(parameters=[asdict(there), asdict(back or there)])

    def cut(self) -> int:
        """Lose every sent frame until `mend`; return the start, system time in ns."""
        return int(self._ask(cut=True)["time"])

    def mend(self) -> int:
        """Carry frames again; return the start, system time in ns."""
        return int(self._ask(cut=False)["time"])

    def counts(self) -> list[dict[str, dict[str, int]]]:
        """Return counts of UDP datagrams from ends 0 and 1: ``sent`` and ``lost`` by kind.

        Kinds are ``packet``, a readable packet of the coupling; ``large``, others from `LARGE`
        bytes on, such as an encrypted packet; and ``small``.
        """
        found: list[dict[str, dict[str, int]]] = self._ask()["counts"]
        return found

    def close(self) -> None:
        """Remove the wire; its namespaces go with the last process inside."""
        assert self.process.stdin
        assert self.process.stdout
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()

    def _ask(self, **request: Any) -> Any:
        assert self.process.stdin
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self.process.stdout
        line = self.process.stdout.readline()
        assert line, "the wire has ended"
        return json.loads(line)


class _End:
    """TAP device and network namespace of one host, and the channel that leads away from it."""

    def __init__(self, number: int, seed: int) -> None:
        if _LIBC.unshare(_CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), "unshare")
        self.namespace = os.open("/proc/self/ns/net", os.O_RDONLY)
        self.tap = os.open(TUN, os.O_RDWR | os.O_NONBLOCK)
        request = struct.pack("16sH22x", DEVICE.encode(), _IFF_TAP | _IFF_NO_PI)
        fcntl.ioctl(self.tap, _TUNSETIFF, request)
        other = 1 - number
        # Address resolution over a wire that loses frames would take seconds.
        neighbour = f"neigh add {ADDRESSES[other]} lladdr {_MACS[other]} nud permanent"
        for words in (
            "link set lo up",
            f"link set {DEVICE} address {_MACS[number]}",
            f"link set {DEVICE} addrgenmode none up",
            f"addr add {ADDRESSES[number]}/24 dev {DEVICE}",
            f"{neighbour} dev {DEVICE}",
        ):
            subprocess.run(["ip", *words.split()], check=True)
        self.channel = Channel[bytes](CARRIED, seed + number)
        self.parameters = CARRIED
        self.counts = {"sent": Counter[str](), "lost": Counter[str]()}

    def read(self, now: float) -> None:
        """Send each frame queued in the device."""
        with suppress(BlockingIOError):
            while True:
                self._send(os.read(self.tap, _LONGEST_FRAME), now)

    def write(self, frames: Sequence[bytes]) -> None:
        """Hand frames to the host; a full queue loses them, or a device that is down."""
        for frame in frames:
            with suppress(OSError):
                os.write(self.tap, frame)

    def _send(self, frame: bytes, now: float) -> None:
        before = len(self.channel.travelling)
        self.channel.send(frame, now)
        if frame[12:14] == _IPV4 and frame[23] == socket.IPPROTO_UDP:
            kind = "packet" if _MARK in frame else "large" if len(frame) >= LARGE else "small"
            self.counts["sent"][kind] += 1
            self.counts["lost"][kind] += len(self.channel.travelling) == before


def _carry(ends: Sequence[_End]) -> None:
    """Carry frames and obey requests until standard input ends."""
    requests = sys.stdin.fileno()
    taps = [end.tap for end in ends]
    while True:
        now = time.monotonic()
        due = min(end.channel.next_arrival for end in ends) - now
        # select waits in microseconds, epoll in milliseconds.
        ready, _, _ = select.select([*taps, requests], [], [], max(0.0, min(due, _LONGEST_WAIT)))
        now = time.monotonic()
        for end, other in (ends, ends[::-1]):
            if end.tap in ready:
                end.read(now)
            other.write(end.channel.arrived(now))
        if requests in ready:
            line = sys.stdin.readline()
            if not line:
                return
            print(json.dumps(_obey(json.loads(line), ends)), flush=True)


def _obey(request: dict[str, Any], ends: Sequence[_End]) -> dict[str, Any]:
    """Change the wire as requested; return the time of the change, and counts."""
    for end, given in zip(ends, request.get("parameters", ()), strict=False):
        end.parameters = end.channel.parameters = ChannelParameters(**given)
    if "cut" in request:
        for end in ends:
            lost = ChannelParameters(loss=1.0)
            end.channel.parameters = lost if request["cut"] else end.parameters
    return {"time": time.time_ns(), "counts": [end.counts for end in ends]}


def _main() -> None:
    ends = [_End(number, int(sys.argv[1])) for number in (0, 1)]
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    print(json.dumps([end.namespace for end in ends]), flush=True)
    _carry(ends)


if __name__ == "__main__":
    _main()
