# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Studies with participants: protocol, trials, log, analysis and export.

A study is one YAML file, the `protocol`. `plan` makes the trials of a participant from the
protocol, `session` runs them on a rig with a participant, and `log` records all events. Rig and
participant are interfaces of `trials`: the live graph and a page, or simulated observers.
"""
