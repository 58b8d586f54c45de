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

"""Guarded callbacks, whose exceptions are counted and logged, and do not end the node."""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from rclpy.service import Service

from haptic_accel.core.parameters import shown

REASONS = ("message", "reason", "failure_reason")
"""Fields of responses for the reason of a refusal."""

Entity = TypeVar("Entity")


def refused(response: Any, reason: str) -> Any:
    """Return a new response, with the reason of a refusal if its type has a field for reasons.

    By default it is a refusal: fields for success are false.
    """
    for name in REASONS:
        if hasattr(response, name):
            setattr(response, name, reason)
    if hasattr(response, "result"):
        refused(response.result, reason)
    return response


class CallbackGuard:
    """Calls the callbacks of one node's services, subscriptions, timers and events.

    Exceptions are counted, and the first failure of each kind is logged. A service always answers.

    No sender may end a node, and thus the graph. Only two kinds of error end a node:

    - An error in the node's own loop, `work`: closing the node removes its forces. Messages are
      checked before `work` takes them (`Inbox`, `Samples`).
    - An error at the start, or in writing a bag.

    A failed device is closed without force; the node continues.

    Parameters
    ----------
    log, explain : callable
        Called with a line for each kind of failure, and with its traceback.

    Attributes
    ----------
    failed : Counter
        Number of failures by service, topic or timer.
    """

    def __init__(self, log: Callable[[str], object], explain: Callable[[str], object]) -> None:
        self._log = log
        self._explain = explain
        self._kinds: set[tuple[str, type[Exception]]] = set()
        self.failed: Counter[str] = Counter()

    def guarded(self, entity: Entity, name: str) -> Entity:
        """Return a subscription, timer or event with its callback guarded."""
        served: Any = entity
        callback = served.callback
        if hasattr(callback, "guard"):
            return entity

        @wraps(callback)
        def call(*taken: Any) -> Any:
            try:
                return callback(*taken)
            except Exception as error:
                self.note(name, error)
                return None

        vars(call)["guard"] = self
        served.callback = call
        return entity

    def service(self, service: Service) -> Service:
        """Return a guarded service, which answers even if its callback fails."""
        callback, send = service.callback, service.send_response
        if hasattr(callback, "guard"):
            return service
        name = service.service_name

        def call(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                return refused(service.srv_type.Response(), self.note(name, error))

        def answer(response: Any, header: Any) -> None:
            try:
                send(response, header)
            except Exception as error:  # for example, ROS cannot convert a response
                reason = self.note(name, error)
                try:
                    send(refused(service.srv_type.Response(), reason), header)
                except Exception as again:
                    self.note(name, again)

        vars(call)["guard"] = self
        service.callback, service.send_response = call, answer
        return service

    def note(self, name: str, error: Exception) -> str:
        """Count a failure, log the first of its kind, and return it in one line."""
        self.failed[name] += 1
        reason = shown(f"{type(error).__name__}: {' '.join(str(error).split())}")
        if (name, type(error)) not in self._kinds:
            self._kinds.add((name, type(error)))
            self._log(f"{name}: failed: {reason}")
            self._explain("".join(traceback.format_exception(error)))
        return reason
