# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live scope: the latest seconds of the signals and the page that shows them (no ROS)."""
