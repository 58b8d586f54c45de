# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Algorithms without ROS: models, filters, controllers, virtual rig, metrics, lockstep trials."""
