# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Analysis of bags, without ROS: metrics, tables, plots and pages.

In a notebook::

    from haptic_accel.analysis import groups, load, trials

    analysis = load("bags", shift="measured")
    trials(analysis).groupby(["controller", "surface"])["nrmse_percent"].describe()

Tables are pandas data frames. Notebooks, plotting libraries and statistics packages read these
without conversion. Debian packages pandas, and rosdep knows it as ``python3-pandas``.
"""

from haptic_accel.analysis.frames import bands, compare, groups, load, signals, spectra, trials

__all__ = ["bands", "compare", "groups", "load", "signals", "spectra", "trials"]
