# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Coupling of two hosts over a network: packets, sessions, clocks, playout."""
