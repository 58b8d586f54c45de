# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Transports of datagrams: between processes of one host, and between two hosts."""
