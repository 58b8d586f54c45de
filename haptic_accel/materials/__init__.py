# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of textures, taps, materials and scenes: reading and writing, without ROS."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
