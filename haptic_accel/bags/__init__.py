# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags: writing, reading and repair, without ROS."""

NO_ROSBAGS = "bags need rosbags: pip install 'rosbags>=0.11.9,<0.12'"
"""Message without rosbags. No distribution packages it, and a graph without recording runs without
it."""

OF_ROSBAGS = ("rosbags", "lz4", "backports")
"""Modules installed with rosbags."""
