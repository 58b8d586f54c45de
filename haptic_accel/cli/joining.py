# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Join a running graph from a separate process.

Import this module only where needed, because it imports ROS, which is slow.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy

from haptic_accel.cli.output import StoppedError
from haptic_accel.graph.domain import check_middleware, middleware_defaults
from haptic_accel.nodes.service_client import RequestError, ServiceClient

TIMEOUT = 5.0
"""Time-out for a node to be found, and to answer, s."""


@contextmanager
def connected(
    namespace: str, finding: float = TIMEOUT, answering: float = TIMEOUT
) -> Iterator[ServiceClient]:
    """Join the graph of a namespace while the context is entered.

    Parameters
    ----------
    namespace : str
    finding, answering : float
        Time-outs for a service to be found, and for its answer, s.

    Raises
    ------
    StoppedError
        A node does not answer, or refuses.
    ParameterError
        The environment does not suit the middleware.
    """
    check_middleware(os.environ)
    os.environ.update(middleware_defaults(os.environ))
    rclpy.init(args=[])
    node = rclpy.create_node(
        f"haptic_accel_caller_{os.getpid()}",
        namespace=namespace,
        enable_rosout=False,
        start_parameter_services=False,
    )

    async def spin(seconds: float) -> None:
        rclpy.spin_once(node, timeout_sec=seconds)
        await asyncio.sleep(0)  # allow cancellation at this point

    try:
        yield ServiceClient(node, spin, finding, answering)
    except RequestError as error:
        raise StoppedError(str(error)) from None
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
