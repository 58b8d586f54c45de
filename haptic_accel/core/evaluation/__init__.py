# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of a trial: error, regression, delay, frequency bands, statistics."""
