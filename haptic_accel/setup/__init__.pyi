# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

# fmt: off
from haptic_accel.setup.arguments import (SIMULATED as SIMULATED, SURFACES as SURFACES,
    check_both_arms as check_both_arms)
from haptic_accel.setup.files import (EVERY_NODE as EVERY_NODE, note_step as note_step,
    noted_steps as noted_steps, parameter_paths as parameter_paths,
    parameter_text as parameter_text, read_parameter_file as read_parameter_file,
    teleop_command as teleop_command, update_parameter_file as update_parameter_file)
from haptic_accel.setup.node_parameters import (SAFETY as SAFETY,
    LinkNodeParameters as LinkNodeParameters, build_device as build_device,
    build_parameters as build_parameters, check_peer as check_peer, node_schema as node_schema)
from haptic_accel.setup.processes import graph as graph
from haptic_accel.setup.setup import (RECORDER as RECORDER, Parameters as Parameters,
    known_arguments as known_arguments)
from haptic_accel.setup.words import (assigned_keys as assigned_keys,
    parse_assignments as parse_assignments)
