# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated boards and drives behind pseudo-terminals, with fault injection."""
