# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Dynamics of the handle: mechanics, responses, and the plant for controllers."""
