# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.graph.domain import (HIGHEST_FREE_DOMAIN as HIGHEST_FREE_DOMAIN,
    sole_graph as sole_graph)
from haptic_accel.graph.networked import (NetworkedGraph as NetworkedGraph, Relay as Relay,
    RelayError as RelayError, networked_graph as networked_graph)
from haptic_accel.graph.stop_signal import (PendingStop as PendingStop, hurry as hurry,
    own_domain as own_domain, used_domains as used_domains)
from haptic_accel.graph.supervisor import BackgroundGraph as BackgroundGraph
