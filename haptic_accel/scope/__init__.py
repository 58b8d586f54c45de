# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Live scope without ROS: the last seconds of the signals, and a page that shows them."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
