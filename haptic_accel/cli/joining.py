# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joining a running graph from a process of its own.

Imports ROS, which takes a while: load it where it is used.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.node import Node

from haptic_accel.cli.ending import StoppedError
from haptic_accel.nodes.middleware import middleware_defaults


class CallError(StoppedError):
    """A node does not answer, or refuses; the message is one line fit to be shown."""


@contextmanager
def connected(namespace: str) -> Iterator[Node]:
    """Join the graph of a namespace with a node while the context is entered."""
    os.environ.update(middleware_defaults(os.environ))
    rclpy.init(args=[])
    node = rclpy.create_node(
        f"haptic_accel_caller_{os.getpid()}",
        namespace=namespace,
        enable_rosout=False,
        start_parameter_services=False,
    )
    try:
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
