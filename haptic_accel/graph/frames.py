# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of the graph's topics in the world, from the arms' URDF (no ROS imported)."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass

from haptic_accel.core.topics import HANDLE_FRAME, MASTER_FRAME, SLAVE_FRAME, TOOL_FRAME
from haptic_accel.materials.folders import config_folder

MOVED = {HANDLE_FRAME: MASTER_FRAME, TOOL_FRAME: SLAVE_FRAME}
"""Base frame of each frame that moves with its arm; the axes of both are parallel."""

_NONE = "0 0 0"


@dataclass(frozen=True)
class Frame:
    """Pose of a frame in its parent frame.

    Attributes
    ----------
    parent, name : str
    position : tuple of str
        x, y and z, m.
    rotation : tuple of str
        Roll, pitch and yaw, rad.
    """

    parent: str
    name: str
    position: tuple[str, ...] = tuple(_NONE.split())
    rotation: tuple[str, ...] = tuple(_NONE.split())


def description() -> str:
    """Return the URDF description of both arms."""
    return (config_folder() / "haptic_accel.urdf").read_text(encoding="utf-8")


def frames_at_rest(urdf: str) -> Iterator[Frame]:
    """Yield the frames of topics: bases as described, and moving frames at their bases."""
    for joint in ElementTree.fromstring(urdf).iter("joint"):
        names = {part.tag: part.get("link", "") for part in joint}
        if names["child"] in MOVED.values():
            origin = joint.find("origin")
            values = {} if origin is None else origin.attrib
            yield Frame(
                names["parent"],
                names["child"],
                tuple(values.get("xyz", _NONE).split()),
                tuple(values.get("rpy", _NONE).split()),
            )
    for name, base in MOVED.items():
        yield Frame(base, name)
