# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""CRTK arms of other ROS 2 nodes."""
