# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The exact inverse of an identified handle as one causal filter, its prediction and its bound.

`design.design_inverse` makes the filter and `family.design_family` one for every grip,
`prediction.predict` gives its error, force and travel, `bound.causal_bound` the smallest error of
any causal filter, and `bound.limited_bound` that within the limits of travel and force.
"""
