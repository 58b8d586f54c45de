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

"""Packages of ROS 2, which may be absent: lockstep runs, analysis and design do without them."""

from __future__ import annotations

from importlib.util import find_spec

ROS_PACKAGES = frozenset(
    (
        *("rclpy", "launch", "launch_ros", "ament_index_python"),
        *("builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "lifecycle_msgs"),
        *("rcl_interfaces", "sensor_msgs", "std_msgs", "std_srvs"),
    )
)
"""Packages of ROS 2 that the graph, its nodes and launch files import."""

INSTALL_ROS = "pip install 'haptic-accel[ros]', or source a ROS 2"
"""Ways to install ROS 2."""

NEEDS_ROS = f"needs ROS 2: {INSTALL_ROS}"
"""Message, after the name of the command that needs ROS 2."""


def has_ros() -> bool:
    """Return whether the client library of ROS 2 is installed; it is not imported."""
    return find_spec("rclpy") is not None


def check_ros() -> None:
    """Raise the error of an import of rclpy if it is not installed.

    Raises
    ------
    ModuleNotFoundError
    """
    if not has_ros():
        raise ModuleNotFoundError("No module named 'rclpy'", name="rclpy")
