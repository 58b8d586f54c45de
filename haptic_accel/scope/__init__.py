# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Live scope without ROS: the latest seconds of the signals, and a page for display."""
