# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arms whose joints are driven by ODrives on a CAN bus, through any interface of python-can."""
