# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The description of the arms: one tree, with the frames and joints that topics have."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from haptic_accel.core.topics import MASTER, SIGNALS, SLAVE
from haptic_accel.graph.frames import description, frames_at_rest

ROBOT = ElementTree.fromstring(description())
PARENTS = {
    joint.find("child").attrib["link"]: joint.find("parent").attrib["link"]  # type: ignore[union-attr]
    for joint in ROBOT.iter("joint")
}


def above(frame: str) -> list[str]:
    """Return a frame's ancestors, the nearest first."""
    return [PARENTS[frame], *above(PARENTS[frame])] if frame in PARENTS else []


def test_every_link_hangs_in_one_tree_from_the_world() -> None:
    links = [link.attrib["name"] for link in ROBOT.iter("link")]
    assert len(links) == len(set(links)) == len(PARENTS) + 1
    assert all(above(link)[-1:] == ["world"] for link in links if link != "world")


def test_every_frame_of_a_topic_is_a_link() -> None:
    frames = {topic.frame for topic in SIGNALS}
    assert frames <= set(PARENTS)
    assert {frame.name for frame in frames_at_rest(description())} == frames


def test_the_joints_move_handle_and_tool_by_positions_in_the_base() -> None:
    for arm in (MASTER, SLAVE):
        base, moved = arm.position.frame, arm.acceleration.frame
        links = [moved, *above(moved)]
        chain = list(reversed(links[: links.index(base)]))
        joints = {joint.find("child").attrib["link"]: joint for joint in ROBOT.iter("joint")}  # type: ignore[union-attr]
        for axis, link, along in zip("xyz", chain, ("1 0 0", "0 1 0", "0 0 1"), strict=True):
            joint = joints[link]
            assert joint.attrib == {"name": f"{arm.position.source}_{axis}", "type": "prismatic"}
            found = joint.find("axis")
            assert found is not None
            assert found.attrib["xyz"] == along
            assert joint.find("origin") is None


def test_the_bases_stand_where_the_description_puts_them() -> None:
    robot = """
    <robot name="mine">
      <joint name="one" type="fixed">
        <parent link="bench"/><child link="master_base"/>
        <origin xyz="1 2 3" rpy="0 0 1.57"/>
      </joint>
      <joint name="other" type="fixed"><parent link="bench"/><child link="slave_base"/></joint>
    </robot>
    """
    master, slave, handle, tool = frames_at_rest(robot)
    place = (master.parent, master.position, master.rotation)
    assert place == ("bench", ("1", "2", "3"), ("0", "0", "1.57"))
    assert (slave.parent, slave.position) == ("bench", ("0", "0", "0"))
    assert (handle.parent, tool.parent) == ("master_base", "slave_base")
    assert handle.position == tool.rotation == ("0", "0", "0")
