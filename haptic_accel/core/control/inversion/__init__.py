# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exact inverse of an identified handle as one causal filter, with prediction and error bounds.

`design.design_inverse` designs the filter; a filter per grip is designed in the controller
`adaptive`. `prediction.predict` returns error, force and travel. `bound.causal_bound` is the
smallest error of any causal filter, `bound.bounds` includes the limits of travel and force.
"""
