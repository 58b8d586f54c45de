# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags: written, read and repaired, without ROS."""

NO_ROSBAGS = "bags need rosbags: pip install 'rosbags>=0.11.9,<0.12'"
"""Message where rosbags is missing: no distribution packages it, and a graph that records nothing
runs without it."""

OF_ROSBAGS = ("rosbags", "lz4", "backports")
"""Modules that come with rosbags."""
