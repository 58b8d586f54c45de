# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Values of parameters."""

from __future__ import annotations

from typing import Any


class ParameterValue:
    """A value with its type."""

    def __init__(self, value: Any, *, value_type: type) -> None:
        self.value = value
