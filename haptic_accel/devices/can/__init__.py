# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arms whose joints are driven by ODrives on a CAN bus, through any interface of python-can."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
