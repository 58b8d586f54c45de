# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Public interface for the commands of kits, other packages and benchmarks."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
