# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS graph: launch, supervision of processes, locks, and checks of the machine."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
