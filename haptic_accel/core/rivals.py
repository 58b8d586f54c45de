# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of several publishers on topics that allow one sender only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple


class Endpoint(NamedTuple):
    """Publisher of a topic.

    Attributes
    ----------
    topic : str
    node : str
        Full name of its node, which is not necessarily unique.
    participant : bytes
        Globally unique identifier of its process.
    """

    topic: str
    node: str
    participant: bytes


def rivals(endpoints: Sequence[Endpoint]) -> str:
    """Return the names of the publishers if they belong to several senders; otherwise "".

    One node may have one publisher per topic.

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
