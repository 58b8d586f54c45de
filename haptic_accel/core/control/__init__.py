# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Acceleration control: filters, compensation, controllers and their design."""
