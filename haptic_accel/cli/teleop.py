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

"""``haptic-accel teleop``: the graph as supervised processes, where there is no ros2 launch."""

from __future__ import annotations

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.running import run_shown
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.processes import graph


@verb(
    "haptic-accel teleop controller:=inverse surface:=vinyl duration:=10",
    "haptic-accel teleop master:=serial slave:=serial params_file:=mine.yaml",
    "haptic-accel teleop scope:=true side:=master peer:=ROBOT keys:=keys",
)
@arguments(GraphArguments)
def teleop(arguments: GraphArguments) -> None:
    """Run the graph until Ctrl-C: both arms, or one of them with a peer host."""
    run_shown(graph(arguments), endless=arguments.duration == 0)
