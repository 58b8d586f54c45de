# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS graph: launch, supervision of processes, locks, and checks of the machine."""
