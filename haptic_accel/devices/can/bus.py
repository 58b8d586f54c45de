"""Opening a bus of python-can, and one line for whatever stands in the way."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices.can.parameters import CanParameters
from haptic_accel.devices.can.protocol import COMMAND_BITS, HIGHEST_ID, Frame
from haptic_accel.devices.interface import DeviceError

if TYPE_CHECKING:
    import can

# python-can is imported where it is needed: who has no CAN need not install it, nor wait for it.

DEFAULT_BITRATE = 1e6
"""bit/s, assumed where nobody says: the highest of classic CAN, which the paper's rate needs."""

NODE_MASK = HIGHEST_ID & ~((1 << COMMAND_BITS) - 1)
"""Bits of an id that are the node's."""

_REASONS = {
    errno.ENOENT: "there is no such channel",
    errno.ENODEV: "there is no such channel",
    errno.ENXIO: "there is no such channel",
    errno.EACCES: "no permission: join the group that owns it (ls -l; often dialout), log in anew",
    errno.EPERM: "no permission: it needs an administrator",
    errno.EBUSY: "busy: another program has it open",
    errno.ENETDOWN: "it is down: sudo ip link set CHANNEL up type can bitrate 1000000",
    errno.EAFNOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can)",
    errno.EPROTONOSUPPORT: "its driver is missing: this kernel has no CAN (sudo modprobe can_raw)",
}
"""Why a channel cannot be opened, by the system's error."""


def bus_configuration(parameters: CanParameters) -> dict[str, Any]:
    """Return what python-can is to open: given parameters over its own configuration.

    That is, first to last, the parameters, CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE and CAN_CONFIG
    in the environment, each with ``_<context>`` appended before each without, and can.conf, with
    its section ``[<context>]`` before ``[default]``.

    Raises
    ------
    DeviceError
        There is no python-can.
    ParameterError
        No interface is given, or there is none of that name.
    """
    try:
        import can.util
    except ImportError:
        raise DeviceError(
            "can: python-can is not installed: pip install python-can, or the package python3-can"
        ) from None
    given: dict[str, Any] = dict(parameters.settings)
    named = {"interface": parameters.interface, "channel": parameters.channel}
    given |= {name: value for name, value in named.items() if value}
    if parameters.bitrate:
        given["bitrate"] = parameters.bitrate
    known = ", ".join(sorted(can.VALID_INTERFACES))
    try:
        configuration = dict(can.util.load_config(config=given, context=parameters.context))
    except can.CanInterfaceNotImplementedError as error:
        # One of python-can's own configuration, or none.
        found = parameters.interface or ("" if '"None"' in str(error) else _line(error))
        raise ParameterError(
            f"can.interface = {found!r}: must be one of {known}, here or in python-can's own"
            " configuration"
        ) from None
    except (ValueError, TypeError) as error:
        raise ParameterError(f"can: python-can's configuration: {_line(error)}") from None
    return configuration


def bitrate_of(configuration: dict[str, Any]) -> float:
    """Return the bitrate of a configuration, bit/s, or the usual where it does not say."""
    try:
        return float(configuration["bitrate"])
    except (KeyError, TypeError, ValueError):
        return DEFAULT_BITRATE


def open_bus(configuration: dict[str, Any], nodes: list[int]) -> can.BusABC:
    """Open a bus.

    Parameters
    ----------
    configuration : dict
        As `bus_configuration` returns it.
    nodes : list of int
        Whose frames to receive; all if empty.

    Raises
    ------
    DeviceError
        It cannot be opened; one line with what to do about it.
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
        raise DeviceError(f"{what}: its driver is missing: {_line(error)}") from None
    # Drivers raise whatever they like, and a user can only be told.
    except Exception as error:
        if isinstance(error, TypeError) and not configuration.get("channel"):
            raise ParameterError(f"can.channel = '': {what} must have one") from None
        raise DeviceError(f"{what}: {_reason(error)}") from None


def frame_of(message: can.Message) -> Frame | None:
    """Return what was received, or None for an error frame or one with an extended id."""
    if message.is_error_frame or message.is_extended_id or message.is_fd:
        return None
    return Frame(message.arbitration_id, bytes(message.data), message.is_remote_frame)


def message_of(frame: Frame) -> can.Message:
    """Return what is to be sent, with a standard id: python-can's default is extended."""
    import can

    return can.Message(
        arbitration_id=frame.id,
        data=frame.data or None,
        is_remote_frame=frame.remote,
        is_extended_id=False,
        check=False,
    )


def _reason(error: BaseException) -> str:
    for each in _chain(error):
        number = getattr(each, "errno", None)
        if number in _REASONS:
            return _REASONS[number]
    if isinstance(error, (ImportError, NameError)):
        # Names that a driver would have from its library.
        return f"its driver is missing: {_line(error)}"
    return _line(error)


def _chain(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _line(error: BaseException) -> str:
    """Return an error's text in one line."""
    return " ".join(str(error).split()) or type(error).__name__
