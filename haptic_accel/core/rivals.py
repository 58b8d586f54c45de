# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rivals: several publishers of what may have one sender only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple


class Endpoint(NamedTuple):
    """A publisher that was found.

    Attributes
    ----------
    topic : str
    node : str
        Full name of its node, which other nodes may have, too.
    participant : bytes
        Globally unique identifier of the process that it is in.
    """

    topic: str
    node: str
    participant: bytes


def rivals(endpoints: Sequence[Endpoint]) -> str:
    """Return who the publishers are if they are not of one sender; otherwise an empty text.

    One node may publish one of each topic.

    Examples
    --------
    >>> one = Endpoint("/slave/servo_cf", "/coupler", b"1")
    >>> rivals([one, one._replace(topic="/slave/servo_cp")])
    ''
    >>> rivals([one, one._replace(participant=b"2")])
    '/coupler (2 publishers)'
    >>> rivals([one, Endpoint("/slave/servo_cf", "/evil", b"2")])
    '/coupler and /evil'
    """
    topics = Counter(each.topic for each in endpoints)
    senders = {(each.participant, each.node) for each in endpoints}
    if len(senders) < 2 and max(topics.values(), default=0) < 2:
        return ""
    nodes = sorted(Counter(each.node for each in endpoints).items())
    return " and ".join(f"{name} ({n} publishers)" if n > 1 else name for name, n in nodes)
