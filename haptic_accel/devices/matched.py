# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers of publishers that a subscription is matched with; imports ROS, so import it late."""

from __future__ import annotations

from typing import Any

from rclpy.event_handler import EventHandler, QoSSubscriptionEventType
from rclpy.node import Node
from rclpy.subscription import Subscription

from haptic_accel.core.sequence_check import Matched


class MatchedPublishers(EventHandler):  # type: ignore[misc]  # rclpy leaves it untyped
    """Event of a subscription, from which counts can be taken without an executor.

    Node and subscription own it: it ends with the subscription.

    Parameters
    ----------
    node : Node
    subscription : Subscription
    """

    def __init__(self, node: Node, subscription: Subscription) -> None:
        super().__init__(
            callback_group=node.default_callback_group,
            callback=_ignore,
            event_type=QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED,
            parent_impl=subscription.handle,
        )
        subscription.event_handlers.append(self)
        node.add_waitable(self)

    def counts(self) -> Matched | None:
        """Return the present and the total number of publishers; a call takes 1 us."""
        self._ready_to_take_data = True
        counts: Matched | None = self.take_data()
        return counts


def _ignore(event: Any) -> None:
    """Do nothing when an executor serves the event."""
