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

"""Open a bus of python-can; errors are explained in one line."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING, Any

from haptic_accel.core.parameters import ParameterError, one_line
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.devices.can.protocol import COMMAND_BITS, HIGHEST_ID, Frame
from haptic_accel.devices.connection import explained
from haptic_accel.devices.interface import DeviceError

if TYPE_CHECKING:
    import can

# python-can is imported where it is needed, so that users without CAN need not install it.

DEFAULT_BITRATE = 1e6
"""Default bit rate, bit/s: the highest of classic CAN, needed at 1 kHz."""

NODE_MASK = HIGHEST_ID & ~((1 << COMMAND_BITS) - 1)
"""Bits of an id that hold the node."""

_MISSING = "there is no such channel"
_REASONS = {
    errno.ENOENT: _MISSING,
    errno.ENODEV: _MISSING,
    errno.ENXIO: _MISSING,
    errno.EACCES: "no permission: join the group that owns it (ls -l; often dialout), and log in",
    errno.EPERM: "no permission: it needs an administrator",
    errno.EBUSY: "busy: another program has it open",
    errno.ENETDOWN: "it is down: sudo ip link set CHANNEL up type can bitrate 1000000",
    errno.EAFNOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can)",
    errno.EPROTONOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can_raw)",
}
"""Reason why a channel cannot be opened, by errno."""


def bus_configuration(parameters: CanParameters) -> dict[str, Any]:
    """Return python-can's configuration, in which the given parameters take precedence.

    Precedence: the parameters; the environment's CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE and
    CAN_CONFIG, first with ``_<context>`` appended, then without; can.conf, first its section
    ``[<context>]``, then ``[default]``.

    Raises
    ------
    DeviceError
        python-can is not installed.
    ParameterError
        The interface is missing or unknown.
    """
    try:
        import can.util
    except ImportError:
        raise DeviceError(
            "can: python-can is not installed: pip install python-can, or the package python3-can"
        ) from None
    given: dict[str, Any] = dict(parameters.settings)
    named = {name: getattr(parameters, name) for name in ("interface", "channel", "bitrate")}
    given |= {name: value for name, value in named.items() if value}
    known = ", ".join(sorted(can.VALID_INTERFACES))
    try:
        return dict(can.util.load_config(config=given, context=parameters.context))
    except can.CanInterfaceNotImplementedError as error:
        # The interface comes from python-can's configuration, or is missing.
        found = parameters.interface or ("" if '"None"' in str(error) else one_line(error))
        raise ParameterError(
            f"can.interface = {found!r}: must be one of {known}, here or in python-can's own"
            " configuration"
        ) from None
    except (ValueError, TypeError) as error:
        raise ParameterError(f"can: python-can's configuration: {one_line(error)}") from None


def bitrate_of(configuration: dict[str, Any]) -> float:
    """Return a configuration's bit rate, bit/s; the default if it has none."""
    return float(configuration.get("bitrate") or DEFAULT_BITRATE)


def open_bus(configuration: dict[str, Any], nodes: list[int]) -> can.BusABC:
    """Open a bus.

    Parameters
    ----------
    configuration : dict
        As `bus_configuration` returns it.
    nodes : list of int
        Nodes whose frames to receive; all if empty.

    Raises
    ------
    DeviceError
        The bus cannot be opened; one line with a remedy.
    ParameterError
        A channel must be given.
    """
    import can

    filters: list[Any] = [
        {"can_id": node << COMMAND_BITS, "can_mask": NODE_MASK, "extended": False}
        for node in nodes
    ]
    what = f"can: {configuration.get('interface')} {configuration.get('channel') or ''}".strip()
    try:
        return can.Bus(ignore_config=True, can_filters=filters or None, **configuration)
    except can.CanInterfaceNotImplementedError as error:
        raise DeviceError(f"{what}: its driver is missing: {one_line(error)}") from None
    # Drivers raise any kind of exception.
    except Exception as error:
        if isinstance(error, TypeError) and not configuration.get("channel"):
            raise ParameterError(f"can.channel = '': {what} must have one") from None
        missing = isinstance(error, (ImportError, NameError))
        reason = "its driver is missing: " * missing + one_line(error)
        raise DeviceError(f"{what}: {explained(error, _REASONS) or reason}") from None


def frame_of(message: can.Message) -> Frame | None:
    """Return a received frame; None for an error frame or an extended id."""
    if message.is_error_frame or message.is_extended_id or message.is_fd:
        return None
    return Frame(message.arbitration_id, bytes(message.data), message.is_remote_frame)


def message_of(frame: Frame) -> can.Message:
    """Return a frame's message with a standard id; python-can defaults to extended."""
    import can

    return can.Message(
        arbitration_id=frame.id,
        data=frame.data or None,
        is_remote_frame=frame.remote,
        is_extended_id=False,
        check=False,
    )
