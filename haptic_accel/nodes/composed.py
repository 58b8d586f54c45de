# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Executable `composed`: all nodes for both arms, except the recorder, in one process.

The nodes exchange signals without messages, in lockstep order, but a fault in one node ends all.
The recorder is a separate process, so that writing delays no force.
"""

from __future__ import annotations

from haptic_accel.nodes.compensator import Compensator
from haptic_accel.nodes.coupler import Coupler
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.master_device import master_device
from haptic_accel.nodes.scheduling import run
from haptic_accel.nodes.slave_device import slave_device


def main() -> None:
    """Run the nodes."""
    # The order of lockstep: the master is sampled first, then the slave; the resulting forces are
    # due at the next tick.
    run("composed", master_device, slave_device, Coupler, Compensator, join=join)


if __name__ == "__main__":
    main()
