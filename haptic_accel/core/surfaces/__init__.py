# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Virtual surfaces: textures, taps, shapes, and the tool in contact with them."""
