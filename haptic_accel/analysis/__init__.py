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

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
