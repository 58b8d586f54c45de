# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Addresses, ports and parameters of the link between two hosts."""
