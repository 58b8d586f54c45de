# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
