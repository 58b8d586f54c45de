# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Analysis of bags, without ROS: metrics, tables, plots and pages.

In a notebook::

    from haptic_accel.analysis import groups, load, trials

    analysis = load("bags", shift="measured")
    trials(analysis).groupby(["controller", "surface"])["nrmse_percent"].describe()

Tables are pandas data frames. Notebooks, plotting libraries and statistics packages read these
without conversion. pandas is packaged in Debian and known to rosdep as ``python3-pandas``.
"""

from haptic_accel.analysis.frames import bands, compare, groups, load, signals, spectra, trials

__all__ = ["bands", "compare", "groups", "load", "signals", "spectra", "trials"]
