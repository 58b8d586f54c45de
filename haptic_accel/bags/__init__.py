# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags: writing, reading and repair, without ROS."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)

NO_ROSBAGS = "bags need rosbags: pip install 'rosbags>=0.11.9,<0.12'"
"""Message if rosbags is missing. No Linux distribution packages rosbags; only bags need it."""

OF_ROSBAGS = ("rosbags", "lz4", "backports")
"""Modules installed with rosbags."""
