# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.graph.domain import sole_graph as sole_graph
from haptic_accel.graph.networked import (RelayError as RelayError, RelayProcess as RelayProcess,
    networked_graph as networked_graph)
from haptic_accel.graph.relaying import (RELAY_PRIORITY as RELAY_PRIORITY,
    RelayArguments as RelayArguments, open_relay as open_relay, serve_relay as serve_relay)
from haptic_accel.graph.stop_signal import (PendingStop as PendingStop, hurry as hurry,
    own_domain as own_domain)
from haptic_accel.graph.supervisor import BackgroundGraph as BackgroundGraph
