"""Publishes a bag's slave signals as `ros2 bag play` does: ``python bag_player.py BAG``.

At their original times, with their old stamps, below ``/played``; once somebody listens.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import rclpy
from rosbags.rosbag2 import Reader

from haptic_accel.core.topics import PLAYED, SLAVE_SIGNALS
from haptic_accel.nodes.interface import message_type, quality

PATIENCE = 60.0
"""s."""


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("bag_player")
    publishers = {
        f"/{topic.name}": node.create_publisher(
            message_type(topic), f"/{PLAYED}/{topic.name}", quality(topic)
        )
        for topic in SLAVE_SIGNALS
    }
    with Reader(Path(sys.argv[1])) as reader:
        wanted = [found for found in reader.connections if found.topic in publishers]
        messages = [(time, c.topic, data) for c, time, data in reader.messages(wanted)]
    deadline = time.monotonic() + PATIENCE
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        assert time.monotonic() < deadline, "nobody listens"
        time.sleep(0.05)
    begin, first = time.monotonic_ns(), messages[0][0]
    for recorded, topic, data in messages:
        ahead = recorded - first - (time.monotonic_ns() - begin)
        time.sleep(max(0, ahead) / 1e9)
        publishers[topic].publish(data)
    print(f"played {len(messages)} messages", flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
