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

"""Handlers of events."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class OnShutdown:
    """Handler of the end of a launch."""

    def __init__(self, *, on_shutdown: Callable[..., None]) -> None:
        self._on_shutdown = on_shutdown

    def handle(self, event: Any, context: Any) -> None:
        self._on_shutdown(event, context)
