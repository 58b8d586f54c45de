# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Identification of the handle: excite it, estimate its response, fit models to that."""
