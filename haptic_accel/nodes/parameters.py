# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Parameters of a node by its schema, checked at the start and at each change."""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from haptic_accel.core.parameters import (
    ParameterError,
    Specification,
    allowed_values,
    checked,
    read_decimal,
    shown,
)
from haptic_accel.setup.files import check_reached
from haptic_accel.setup.former_names import FORMER, present_values
from haptic_accel.setup.node_parameters import (
    NODES,
    USE_SIM_TIME,
    check_clock,
    node_parameters,
    node_schema,
)

_OF_EVERY_NODE = (USE_SIM_TIME, "start_type_description_service")
"""Parameters that rclpy gives every node."""

_LARGEST = sys.float_info.max


class DeclaredParameters:
    """Parameters of a node, declared from its schema.

    Parameters
    ----------
    node : Node
        It has declared what command line and files give.
    executable : str
        Key of the schema.
    changeable : collection of str
        Parameters that can be changed while the node runs.
    change : callable
        Applies new, checked values of changeable parameters by name, or raises a ParameterError.
    note : callable
        Notes an exception of a callback by its name; returns a line.

    Attributes
    ----------
    own
        The node's own parameters, checked.
    options : dict
        Parameters of its possible parts (devices, controllers), by name.
    schema : mapping
        Default and specification by dotted name.

    Raises
    ------
    ParameterError
        A parameter has a value that is not allowed.
    """

    def __init__(
        self,
        node: Node,
        executable: str,
        changeable: Collection[str],
        change: Callable[[dict[str, Any]], None],
        note: Callable[[str, Exception], str],
    ) -> None:
        self._node, self._apply, self._note = node, change, note
        self._changeable = changeable
        self.schema = node_schema(executable)
        given = self._given()
        self.own, self.options = node_parameters(executable, given)
        self._declare(given)
        node.add_on_set_parameters_callback(self._change)

    @property
    def services(self) -> dict[type, Callable[..., Any]]:
        """Callbacks of the services that set parameters, in place of rclpy's, by their type."""
        return {SetParameters: self._serve, SetParametersAtomically: self._serve_atomically}

    def new(self, parameters: Iterable[Parameter]) -> list[Parameter]:
        """Return those that differ from their present values, in the types of the schema.

        Raises
        ------
        ParameterError
            One has no such value, or is fixed.
        """
        return [each for each in map(self._checked, parameters) if not self._holds(each)]

    def _serve(
        self, request: SetParameters.Request, response: SetParameters.Response
    ) -> SetParameters.Response:
        """Set all parameters of a request or none; rclpy would set the valid ones."""
        response.results = [self._set(request.parameters)] * len(request.parameters)
        return response

    def _serve_atomically(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response
    ) -> SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        """Set the parameters of a request, all or none; the result holds any failure."""
        try:
            return self._node.set_parameters_atomically([_parameter(each) for each in messages])
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            reason = self._note("set_parameters", error)
            return SetParametersResult(successful=False, reason=reason)

    def _checked(self, parameter: Parameter) -> Parameter:
        """Return a parameter with its value in the type of the schema."""
        name, value = parameter.name, parameter.value
        if name == USE_SIM_TIME:
            check_clock(value)
        if name in _OF_EVERY_NODE:
            return parameter
        if name not in self.schema:
            raise ParameterError(f"{shown(name)}: {self._node.get_name()} has no such parameter")
        default, specification = self.schema[name]
        value = _as_meant(value, default)
        return Parameter(name, value=checked(name, value, default, specification))

    def _holds(self, parameter: Parameter) -> bool:
        """Return whether a parameter has its value already; refuse to change a fixed one."""
        value = self._node.get_parameter(parameter.name).value
        if parameter.value == value:
            return True
        if parameter.name in self.schema and parameter.name not in self._changeable:
            raise ParameterError(
                f"{parameter.name} = {parameter.value}: must stay {value} while the node runs"
            )
        return False

    def _change(self, parameters: list[Parameter]) -> SetParametersResult:
        """Apply new, checked values, or refuse them."""
        values = {each.name: each.value for each in parameters if each.name in self._changeable}
        try:
            if values:
                self._apply(values)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _given(self) -> dict[str, Any]:
        """Return the values of the command line and of files, and undeclare them."""
        check_clock(self._node.get_parameter(USE_SIM_TIME).value)
        for path in _parameter_files():
            check_reached(path, self._node.get_fully_qualified_name())
        given = {
            name: parameter.value
            for name, parameter in self._node.get_parameters_by_prefix("").items()
            if name not in _OF_EVERY_NODE
        }
        for name in given:
            self._node.undeclare_parameter(name)
            # A file may set in all nodes (/**) what only some have.
            if not any(name in {*node_schema(each), *FORMER.get(each, ())} for each in NODES):
                raise ParameterError(f"{name}: no such parameter")
        return present_values(given, given.get("rate"), self._node.get_logger().warning)

    def _declare(self, given: dict[str, Any]) -> None:
        """Declare all parameters with their descriptors and checked values.

        All are read-only except those that can be changed while the node runs.
        """
        for name, (default, specification) in self.schema.items():
            value = checked(name, given.get(name, default), default, specification)
            descriptor = _descriptor(default, specification)
            descriptor.read_only = name not in self._changeable
            # ROS would take the value as given: 300 is no double to it.
            self._node.declare_parameter(name, value, descriptor, ignore_override=True)


def _parameter_files() -> Iterator[Path]:
    """Yield the parameter files of the command line, which ROS has read."""
    words, for_ros = iter(sys.argv[1:]), False
    for word in words:
        if word in ("--ros-args", "--"):
            for_ros = word == "--ros-args"
        elif for_ros and word == "--params-file":
            yield Path(next(words))


def _parameter(message: ParameterMessage) -> Parameter:
    """Return the parameter in a request's message.

    Raises
    ------
    ParameterError
        The type is unknown, or not the value's type.
    """
    name, kind = shown(message.name), message.value.type
    try:
        return Parameter.from_parameter_msg(message)
    except (TypeError, ValueError):
        raise ParameterError(f"{name}: type = {kind}: must be one of 1 to 9") from None


def _as_meant(value: Any, default: Any) -> Any:
    """Convert a value to its type in the file.

    ``ros2 param load`` passes on 9e-06 as text, and the text 0.6 as a number.
    """
    if isinstance(value, str) and isinstance(default, float):
        with suppress(ValueError):
            return read_decimal(value)
    if isinstance(value, (int, float)) and isinstance(default, str):
        return str(value)
    return value


def _descriptor(default: Any, specification: Specification) -> ParameterDescriptor:
    """Return a parameter's descriptor: text with unit and allowed values, and the range."""
    unit = f" [{specification.unit}]" if specification.unit else ""
    low, high = specification.low, specification.high
    descriptor = ParameterDescriptor(
        description=specification.text + unit,
        additional_constraints=allowed_values(default, specification),
    )
    if low is None and high is None:
        return descriptor
    whole = isinstance(default, int)
    kind, least, most = (int, 0, 2**63 - 1) if whole else (float, -_LARGEST, _LARGEST)
    low, high = kind(least if low is None else low), kind(most if high is None else high)
    if whole:
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
    else:
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return descriptor
