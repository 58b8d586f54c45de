# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from haptic_accel.core.model import Vector
from haptic_accel.nodes.wires import Queue, Wire, Wires

SAMPLE: tuple[int, Vector] = (1_000_000, (0.0, 0.0, 0.5))


class Receiver:
    """Receives a signal from this process or, as here is noted, as messages."""

    def __init__(self) -> None:
        self.queue = Queue()
        self.here = False

    def __call__(self, here: bool) -> Queue | None:
        self.here = here
        return self.queue if here else None


def send(wire: Wire) -> None:
    for queue in wire.queues:
        queue.append(SAMPLE)


def test_each_receiver_gets_what_is_sent_whoever_was_there_first() -> None:
    wire, before, after = Wire(), Receiver(), Receiver()
    wire.join(before)
    wire.offer()
    wire.join(after)
    send(wire)
    assert list(before.queue) == list(after.queue) == [SAMPLE]


def test_a_signal_that_is_left_to_others_comes_as_messages() -> None:
    wire, receiver = Wire(), Receiver()
    wire.join(receiver)
    wire.offer()
    wire.withdraw()
    send(wire)
    assert not receiver.here
    assert not receiver.queue


def test_who_has_left_gets_nothing() -> None:
    wire, left, stays = Wire(), Receiver(), Receiver()
    wire.offer()
    wire.join(left)
    wire.join(stays)
    wire.leave(left)
    send(wire)
    assert (len(left.queue), len(stays.queue)) == (0, 1)


def test_only_nodes_that_are_to_share_a_process_share_wires() -> None:
    wires = Wires()
    alone = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is not alone
    wires.joined = True
    shared = wires.of("/master/measured_cp")
    assert wires.of("/master/measured_cp") is shared
    assert wires.of("/left/master/measured_cp") is not shared
