# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from haptic_accel.analysis.frames import bands, compare, groups, load, signals, spectra, trials

__all__ = ["bands", "compare", "groups", "load", "signals", "spectra", "trials"]
