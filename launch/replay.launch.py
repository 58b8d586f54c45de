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

"""Plays a bag again: ``ros2 launch haptic_accel replay.launch.py bag:=BAG controller:=inverse``.

`rate` is the speed, as with ``ros2 bag play``. Arguments of the graph that are left empty default
to those stored in the bag.
"""

from __future__ import annotations

from launch import LaunchDescription

from haptic_accel.graph.launching import launched
from haptic_accel.setup.processes import graph
from haptic_accel.setup.replay import described_replay, replay_arguments


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes; the end of one ends all."""
    return launched(
        described_replay(),
        lambda words: graph(
            replay_arguments(word for word in words if not word.endswith(":=")).graph
        ),
    )
