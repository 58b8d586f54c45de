# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ROS graph: arguments, parameters, processes and their supervision."""
