"""Turns bags into figures, tables and pages. No ROS is needed for any of it.

In a notebook::

    from haptic_accel.analysis import groups, load, trials

    analysis = load("bags", shift="measured")
    trials(analysis).groupby(["controller", "surface"])["nrmse_percent"].describe()

Tables are pandas data frames: what notebooks, plotting libraries and statistics packages take
without conversion, packaged in Debian and known to rosdep as ``python3-pandas``. Polars is
neither, and its speed is of no use to some hundred rows.
"""

from haptic_accel.analysis.frames import bands, compare, groups, load, signals, spectra, trials

__all__ = ["bands", "compare", "groups", "load", "signals", "spectra", "trials"]
