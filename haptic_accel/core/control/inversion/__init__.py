# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exact inverse of an identified handle as one causal filter, with prediction and error bounds.

`design.design_inverse` designs the filter, and `family.design_family` one for each grip.
`prediction.predict` returns error, force and travel. `bound.causal_bound` is the smallest error of
any causal filter, `bound.limited_bound` that within the limits of travel and force.
"""
