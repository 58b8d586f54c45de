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

"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import run


def master_device() -> DeviceNode:
    """Return the device node of the master, which also applies the actuator's force."""
    return DeviceNode("master_device")


def main() -> None:
    """Run the node."""
    run("master_device", master_device, join=join)


if __name__ == "__main__":
    main()
