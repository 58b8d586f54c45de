# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both plug-ins beside the double of LeRobot, as its programs would build them."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

SOURCE = Path(__file__).resolve().parents[3]
PLUG_INS = "lerobot_teleoperator_haptic_accel", "lerobot_robot_haptic_accel"
OWN = (*PLUG_INS, "lerobot", "plain_arms")


class PlugIns:
    """Leader and follower, plain or wrapped."""

    def __init__(self) -> None:
        self.arms, self.teleoperators, self.robots, *_ = map(
            importlib.import_module,
            ("plain_arms", "lerobot.teleoperators", "lerobot.robots", *PLUG_INS),
        )

    def leader(self, arguments: str = "", **given: Any) -> Any:
        """Return a wrapped leader."""
        kind = self.teleoperators.TeleoperatorConfig.choices["haptic_accel"]
        config = kind(leader=self.arms.PlainLeaderConfig(**given), arguments=arguments, id="felt")
        return self.teleoperators.make_teleoperator_from_config(config)

    def follower(self, arguments: str = "", fps: int = 30, **given: Any) -> Any:
        """Return a wrapped follower."""
        kind = self.robots.RobotConfig.choices["haptic_accel"]
        arm = self.arms.PlainFollowerConfig(**given)
        return self.robots.make_robot_from_config(
            kind(follower=arm, arguments=arguments, fps=fps, id="felt")
        )


@contextmanager
def plug_ins() -> Iterator[PlugIns]:
    """Put LeRobot's double and the plug-ins on the path, and take them away again."""
    with pytest.MonkeyPatch.context() as patched:
        for folder in (*(f"plugins/{name}" for name in PLUG_INS), "test/support/lerobot_double"):
            patched.syspath_prepend(SOURCE / folder)
        _forget()
        try:
            yield PlugIns()
        finally:
            _forget()


def _forget() -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] in OWN]:
        del sys.modules[name]


@contextmanager
def connected(*devices: Any) -> Iterator[None]:
    """Connect leaders or followers, and disconnect them."""
    with ExitStack() as stack:
        for device in devices:
            device.connect()
            stack.callback(device.disconnect)
        yield


def children(program: str) -> list[int]:
    """Return the processes that this one has started for a program."""
    found = Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
    return [int(each) for each in found if program in Path(f"/proc/{each}/cmdline").read_text()]


def child(program: str) -> int:
    """Return the only process for a program."""
    (found,) = children(program)
    return found
