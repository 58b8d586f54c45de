# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Double of LeRobot: the part of release 0.6.1 that its plug-ins use, without its dependencies."""
