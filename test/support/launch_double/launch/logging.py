# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Loggers of a launch."""

from __future__ import annotations

from logging import Logger, getLogger


def get_logger(name: str) -> Logger:
    """Return the logger with a name."""
    return getLogger(name)
