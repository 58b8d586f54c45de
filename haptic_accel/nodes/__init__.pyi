# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.nodes.compensator import Compensator as Compensator
from haptic_accel.nodes.coupler import (ARM_TOPICS as ARM_TOPICS, CouplingNode as CouplingNode,
    MotionSynchronizer as MotionSynchronizer)
from haptic_accel.nodes.graph_requests import (SETTINGS as SETTINGS,
    set_controller as set_controller, set_gain as set_gain)
from haptic_accel.nodes.graph_view import GraphView as GraphView
from haptic_accel.nodes.joined_view import (JoinedView as JoinedView,
    open_joined_view as open_joined_view)
from haptic_accel.nodes.loop_runner import join as join
from haptic_accel.nodes.master_device import build_master_device as build_master_device
from haptic_accel.nodes.scheduling import (POLL_PERIOD as POLL_PERIOD, TEARDOWN as TEARDOWN,
    Signals as Signals, run_nodes as run_nodes, run_process as run_process)
from haptic_accel.nodes.service_client import RequestError as RequestError
from haptic_accel.nodes.signals import Samples as Samples
from haptic_accel.nodes.slave_device import build_slave_device as build_slave_device
