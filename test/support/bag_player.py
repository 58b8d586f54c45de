# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Publish a bag as `ros2 bag play` does: ``python bag_player.py BAG [all | RATE]``.

Messages keep their original times and stamps. The slave's signals appear below ``/played``, once
all have subscribers. With ``all``, every topic keeps its name and recorded quality of service.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader

from haptic_accel.core.topics import PLAYED, SLAVE_SIGNALS, Topic
from haptic_accel.nodes.supervised_node import message_type

PATIENCE = 240.0
"""s."""


def publisher(node: Node, recorded: Connection, name: str) -> Publisher:
    """Create a topic's publisher as it was recorded."""
    profile = QoSProfile(depth=10)
    for offered in recorded.ext.offered_qos_profiles:  # type: ignore[union-attr]
        profile = QoSProfile(
            depth=offered.depth,
            reliability=ReliabilityPolicy(offered.reliability.value),
            durability=DurabilityPolicy(offered.durability.value),
        )
    topic = Topic(name, recorded.msgtype, "", "")
    return node.create_publisher(message_type(topic), name, profile)


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("rosbag2_player")
    bag, everything = Path(sys.argv[1]), sys.argv[2:] == ["all"]
    rate = 1.0 if everything or len(sys.argv) < 3 else float(sys.argv[2])
    signals = {f"/{topic.name}" for topic in SLAVE_SIGNALS}
    with Reader(bag) as reader:
        wanted = [found for found in reader.connections if everything or found.topic in signals]
        messages = [(time, c.topic, data) for c, time, data in reader.messages(wanted)]
    names = {each.topic: each.topic if everything else f"/{PLAYED}{each.topic}" for each in wanted}
    publishers = {each.topic: publisher(node, each, names[each.topic]) for each in wanted}
    deadline = time.monotonic() + PATIENCE
    while not all(each.get_subscription_count() for each in publishers.values()):
        if everything and time.monotonic() > deadline - PATIENCE + 1.0:
            break  # not every topic needs a subscriber
        assert time.monotonic() < deadline, "nobody listens"
        time.sleep(0.05)
    begin, first = time.monotonic_ns(), messages[0][0]
    for recorded, topic, data in messages:
        ahead = (recorded - first) / rate - (time.monotonic_ns() - begin)
        time.sleep(max(0, ahead) / 1e9)
        publishers[topic].publish(data)
    print(f"played {len(messages)} messages", flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
