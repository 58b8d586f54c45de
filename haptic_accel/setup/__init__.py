# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Description of a graph: its arguments, parameter files, and the parameters of its nodes."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
