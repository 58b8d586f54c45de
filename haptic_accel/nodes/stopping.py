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

"""The emergency stop in ROS: words on its topics, and the coupler's service that releases it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.task import Future
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from haptic_accel.core.emergency_stop import EmergencyStop
from haptic_accel.core.topics import COUPLER_STOPPED, EMERGENCY_STOP, STOPS
from haptic_accel.nodes.graph_node import GraphNode
from haptic_accel.nodes.graph_requests import DEVICES, refusals

ANSWER_TIME = 1.0
"""Time in which a device must answer to a release, s."""

AGAIN = "stopped again meanwhile"
"""Reason against a release that came before the effect of a stop."""


class StopWords:
    """Words on the topics of the emergency stop, and the nodes that may say more.

    Parameters
    ----------
    node : GraphNode
        Node that listens.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        # Without a namespace the graph's own topic is that of all graphs.
        topics = {(node.resolve_topic_name(each.name), each.latched): each for each in STOPS}
        self._inboxes = [node.inbox(topic) for topic in topics.values()]
        self._names = {name for name, _ in topics}

    def drain(self) -> list[bool]:
        """Return the words that have come: true stops, false withdraws that."""
        return [word for inbox in self._inboxes for word in inbox.drain_states()]

    def publishers(self) -> list[str]:
        """Return the full names of the nodes that publish the topics now."""
        return self._node.publishers(*self._names)


@dataclass(frozen=True)
class _Release:
    """A release that devices were asked for, and the function that answers who asked for it."""

    answer: Callable[[SetBool.Response], None]
    asked: dict[str, Future]
    deadline: float


class GraphStop:
    """Emergency stop in the coupler: its state over all nodes, and its release.

    The service `estop` stops at once. A release is passed on to the devices, and answered when
    they have: all are released, or none.

    Parameters
    ----------
    node : GraphNode
        The coupler.
    stop : EmergencyStop
        Its stop, which others may set, too.
    """

    def __init__(self, node: GraphNode, stop: EmergencyStop) -> None:
        self._stop = stop
        self._words = StopWords(node)
        self._publish = node.publisher(COUPLER_STOPPED).publish
        self._requests = node.requests(SetBool, EMERGENCY_STOP.name)
        self._devices = {name: node.create_client(SetBool, f"{name}/estop") for name in DEVICES}
        self._releases: list[_Release] = []
        self._told = self._followed = False

    def follow(self) -> bool:
        """Process reports and requests; return whether the stop has changed."""
        now = time.monotonic()
        for word in self._words.take():
            self._stop.heard(word, now)
        requests = list(self._requests.take())
        if any(request.data for request, _ in requests):
            self._stop.stop()
        new = self._stop.stopped and not self._followed
        for request, answer in requests:
            if request.data:
                answer(SetBool.Response(success=True, message="stopped"))
            elif new:  # the release was requested before the stop took effect
                answer(SetBool.Response(success=False, message=AGAIN))
            else:
                self._release(answer, now)
        self._releases = [each for each in self._releases if not self._is_answered(each, now)]
        if self._stop.stopped != self._told:
            self.tell()
        before, self._followed = self._followed, self._stop.stopped
        return self._followed != before

    def tell(self) -> None:
        """Publish whether all is stopped; to be called once a second at least."""
        self._told = self._stop.stopped
        self._publish(Bool(data=self._told))

    def _release(self, answer: Callable[[SetBool.Response], None], now: float) -> None:
        """Release the coupler and ask the devices, or answer why not."""
        if refusal := self._stop.release(now, self._words.publishers()):
            answer(SetBool.Response(success=False, message=refusal))
            return
        self.tell()  # before the devices are asked, which refuse while the coupler is stopped
        asked = {
            name: device.call_async(SetBool.Request(data=False))
            for name, device in self._devices.items()
            if device.service_is_ready()
        }
        self._releases.append(_Release(answer, asked, now + ANSWER_TIME))

    def _is_answered(self, release: _Release, now: float) -> bool:
        """Answer once all devices have, or time is over; stop all again if one refuses."""
        answers = {name: each.result() for name, each in release.asked.items() if each.done()}
        silent = release.asked.keys() - answers.keys()
        refused = refusals(answers)
        if now >= release.deadline:
            refused += [f"{name}: no answer within {ANSWER_TIME:g} s" for name in sorted(silent)]
        if self._stop.stopped:
            refused = refused or [AGAIN]
        if silent and not refused:
            return False
        if refused:
            self._stop.follow()  # no new stop: a peer that was released stays so
        devices = f"{' and '.join(release.asked)} take forces again"
        message = "; ".join(refused) or f"released: {devices if release.asked else 'no device'}"
        release.answer(SetBool.Response(success=not refused, message=message))
        return True
