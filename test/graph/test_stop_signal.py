# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The emergency stop by signals, before anything else is loaded."""

from __future__ import annotations

import glob
import os
import socket
import subprocess
from collections.abc import Callable, Sequence
from functools import partial

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import MASTER_ARM_FORCE
from haptic_accel.graph import stop_signal
from running import PATIENCE, python, reserved_domain, sending

TOPIC = f"/{MASTER_ARM_FORCE.name}"

STOPPABLE = "import sys; signal.signal(signal.SIGUSR1, lambda *_: sys.exit(7)); "
"""Preparation of a sender that acts upon the stop: it ends with status 7."""

pytestmark = pytest.mark.quiet


def test_an_emergency_stop_reaches_who_sends_and_handles_it_in_its_namespace(domain: int) -> None:
    with sending(domain, TOPIC) as process:
        assert stop_signal.stop_senders(domain, "") == 0, "it would only end"
        assert process.poll() is None
    with (
        sending(domain, f"/left{TOPIC}", STOPPABLE) as left,
        sending(domain, f"/a/b{TOPIC}", STOPPABLE) as far,
        reserved_domain() as other,
    ):
        for elsewhere in ((domain, "/right"), (other, "/left"), (other, "")):
            assert stop_signal.stop_senders(*elsewhere) == 0
        assert stop_signal.stop_senders(domain, "/left") == 1
        assert left.wait(PATIENCE) == 7
        assert stop_signal.stop_senders(domain, "") == 1, "every graph of the domain"
        assert far.wait(PATIENCE) == 7


ODD = [*(b"haptic_accel/" + rest for rest in (b"what", b"\xff/", b"/", b"1e9/sender/"))]
ODD += [b"evil\n\nname", b" ", b"\n", b"\0\n0 1 2\n"]
"""Names of sockets that any program may choose."""


@pytest.mark.parametrize("name", ODD)
def test_odd_addresses_use_no_domain_and_hold_no_stop_up(domain: int, name: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as stranger, sending(domain, TOPIC, STOPPABLE) as process:
        stranger.bind(b"\0" + name)
        # Other tests may use domains at the same time.
        assert {domain} <= stop_signal.used_domains() <= set(range(stop_signal.HIGHEST_DOMAIN + 1))
        assert stop_signal.stop_senders(domain, "") == 1
        assert process.wait(PATIENCE) == 7


@pytest.mark.parametrize("put", [os.mkfifo, os.mkdir, partial(os.symlink, "/dev/full")])
def test_whatever_is_at_its_place_a_stop_is_signalled_and_pending(
    domain: int, put: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    pending = stop_signal.PendingStop(domain, "")
    monkeypatch.setattr(stop_signal, "SOCKETS", "/nowhere")  # a failure to signal, besides
    assert stop_signal.stop_at_once([])
    (place,) = glob.glob(f"{stop_signal.PENDING}-*-{domain}")
    assert pending.withdraw()
    put(place)
    try:
        assert pending.is_new()
        with sending(domain, TOPIC, STOPPABLE) as process:
            assert without("click", ["estop"]).returncode == 9
            assert process.wait(PATIENCE) == 7
        assert pending.is_new(), "given again"
    finally:
        (os.rmdir if put is os.mkdir else os.unlink)(place)


def without(module: str, words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run ``haptic-accel WORDS`` in a process that ends when a module is to be loaded."""
    code = (
        "import os, sys\n"
        "class End:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == {module!r}: os._exit(9)\n"
        "sys.meta_path.insert(0, End())\n"
        "from haptic_accel.cli.main import main\n"
        f"main({list(words)})"
    )
    return python("-c", code, timeout=PATIENCE)


MISSING = [("click", ["namespace:=left"]), ("click", []), ("dataclasses", []), ("rclpy", [])]


@pytest.mark.parametrize(("module", "words"), MISSING)
def test_a_stop_is_signalled_before_anything_else_is_loaded(
    domain: int, module: str, words: list[str]
) -> None:
    with (
        sending(domain, f"/left{TOPIC}", STOPPABLE) as left,
        sending(domain, TOPIC, STOPPABLE) as root,
    ):
        assert without(module, ["estop", *words]).returncode == 9
        assert left.wait(PATIENCE) == 7
        assert root.poll() is None if words else root.wait(PATIENCE) == 7


@pytest.mark.parametrize(
    "words",
    [["--help"], ["release:=true"], ["relase:=true"], ["namespace:=left", "release:=true"]]
    + [[f"namespace:={impossible}"] for impossible in ("a-b", "../x", "1", "a//b")],
)
def test_nothing_is_signalled_before_other_words_are_read(
    domain: int, words: Sequence[str]
) -> None:
    with sending(domain, TOPIC, STOPPABLE), sending(domain, f"/left{TOPIC}", STOPPABLE):
        assert stop_signal.stop_at_once(words) is None
        assert glob.glob(f"{stop_signal.PENDING}-*-{domain}*") == []
        done = stop_signal.stop_at_once(["namespace:=/left/"])
        assert done
        assert done.processes == 1
        assert stop_signal.stop_senders(domain, "") >= 1, "the other has not been signalled"


def test_a_pending_stop_is_new_once_in_its_namespace_or_everywhere(domain: int) -> None:
    root, left = stop_signal.PendingStop(domain, ""), stop_signal.PendingStop(domain, "/left")
    assert not root.withdraw()
    assert not left.is_new()
    assert stop_signal.stop_at_once(["namespace:=left"])
    assert (root.is_new(), left.is_new(), left.is_new()) == (False, True, False)
    assert left.leave()
    assert left.is_new(), "given again"
    assert root.leave()
    assert (root.is_new(), left.is_new()) == (True, True)
    assert root.withdraw()
    assert not left.is_new()
    assert stop_signal.PendingStop(domain, "/left").is_new(), (
        "in another process, until it is withdrawn"
    )
    with reserved_domain() as other:
        assert not stop_signal.PendingStop(other, "/left").is_new()
    assert left.withdraw()
    assert not stop_signal.PendingStop(domain, "/left").is_new()


@pytest.mark.parametrize("text", ["233", "-1", "one", "\uff11", "9" * 5000])
def test_a_domain_that_cannot_be_is_named(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(ParameterError, match=f"ROS_DOMAIN_ID = '{text}': must be from 0 to 232"):
        stop_signal.own_domain()
