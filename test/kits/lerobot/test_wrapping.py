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

"""The part of LeRobot's interface that is used is named in one place."""

from __future__ import annotations

from pathlib import Path
from typing import get_type_hints

from kits.lerobot.plug_ins import plug_ins

from haptic_accel.kits.lerobot import wrapping


def test_every_member_that_lerobot_asks_for_is_named() -> None:
    named = Path(wrapping.__file__).read_text()
    with plug_ins() as built:
        asked = {
            name
            for base in (built.teleoperators.Teleoperator, built.robots.Robot)
            for name in base.__abstractmethods__
        }
    assert [name for name in sorted(asked) if name not in named] == []


def test_a_configuration_is_not_among_its_own_choices() -> None:
    with plug_ins() as built:
        for registry, field in (
            (built.teleoperators.TeleoperatorConfig, "leader"),
            (built.robots.RobotConfig, "follower"),
        ):
            own = registry.get_choice_class("haptic_accel")
            choice = get_type_hints(own)[field]
            assert list(choice.get_known_choices()) == [f"plain_{field}"]
            plain = choice.get_choice_class(f"plain_{field}")
            assert choice.get_choice_name(plain) == f"plain_{field}"
            assert choice.default_choice_name() is None
