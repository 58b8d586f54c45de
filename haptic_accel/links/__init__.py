# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Addresses and parameters of two hosts, and a relay that stands for the network between them."""
