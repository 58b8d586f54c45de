# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""LeRobot plug-ins: a leader that renders, and a follower that observes, gripper vibration.

This package does not import LeRobot. Two small distributions in the folder ``plugins``, which
LeRobot finds by their names, add its base classes to the public classes of this package. A LeRobot
device is wrapped together with the fast path.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.core import VIBRATION
from haptic_accel.core.parameters import one_line
from haptic_accel.kits.lerobot import fast_path
from haptic_accel.setup.arguments import SIMULATED


class PassedOn:
    """Descriptor of an attribute or method that is passed on to the wrapped device."""

    def __set_name__(self, owner: type, name: str) -> None:
        """Store the attribute's name in the class."""
        self._name = name

    def __get__(self, device: Any, owner: type) -> Any:
        """Return the attribute of the wrapped device."""
        return self if device is None else getattr(device.wrapped, self._name)


CHOICE = "get_choice_class", "get_choice_name", "default_choice_name"
"""Members of a choice of configurations, in addition to `get_known_choices`."""


def others(registry: Any, own: str) -> Any:
    """Return the choice of a registry's configurations except one, as the type of a field.

    If a configuration were among the choices of its own field, every LeRobot program would expand
    the field without end.
    """

    def known() -> dict[str, Any]:
        return {name: each for name, each in registry.get_known_choices().items() if name != own}

    members = {name: getattr(registry, name) for name in CHOICE}
    return type("Others", (), {**members, "get_known_choices": staticmethod(known)})


def wrapped(make: Callable[[Any], Any], config: Any, name: str) -> Any:
    """Return the device that LeRobot makes from the field `name` of the plug-in's configuration.

    Raises
    ------
    SystemExit
        The package of the device's motors, an extra of LeRobot, is not installed.
    """
    try:
        return make(config)
    except ImportError as error:
        hint = "install the extra of its motors, as in: pip install 'lerobot[feetech]'"
        raise SystemExit(f"{name}: {one_line(error)}; {hint}") from None


LOG = logging.getLogger(__name__)


class Wrapping:
    """Device that forwards all calls to another one, and runs the fast path while connected.

    Parameters
    ----------
    wrapped
        Device of LeRobot.
    arguments : str
        Arguments of the fast path, ``key:=value``, as for ``haptic-accel teleop``.

    Raises
    ------
    ParameterError
        An argument is not allowed.
    """

    action_features = PassedOn()
    is_calibrated = PassedOn()
    calibrate = PassedOn()
    configure = PassedOn()

    def __init__(self, wrapped: Any, arguments: str) -> None:
        self.wrapped = wrapped
        self._arguments = fast_path.read_arguments(arguments)
        self._path: fast_path.FastPath | None = None

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that only the wrapped device has."""
        if name.startswith("_") or name == "wrapped":  # not set before __init__
            raise AttributeError(name)
        return getattr(self.wrapped, name)

    @property
    def is_connected(self) -> bool:
        """True if the wrapped device is connected, even after the end of the fast path."""
        return self._path is not None and bool(self.wrapped.is_connected)

    def connect(self, calibrate: bool = True) -> None:
        """Start or join the fast path and connect the wrapped device; on failure, do neither.

        Raises
        ------
        ParameterError, DeviceError
            The fast path does not start, or runs with other arguments.
        """
        with ExitStack() as opened:
            # First the fast path: an arm that is connected and disconnected again would fall.
            path = fast_path.join(self._arguments)
            opened.callback(fast_path.leave, path)
            self.wrapped.connect(calibrate)
            opened.pop_all()
        self._path = path
        LOG.info("fast path: %s", path.remarks)
        if SIMULATED in (self._arguments.master, self._arguments.slave):
            LOG.warning("fast path: simulated; a sound card needs master:=none slave:=none")

    def disconnect(self) -> None:
        """Leave the fast path and disconnect the wrapped device, even if one of them fails."""
        path, self._path = self._path, None
        with ExitStack() as closing:
            closing.callback(self.wrapped.disconnect)
            if path:
                closing.callback(fast_path.leave, path)

    def tell_problem(self) -> None:
        """Log a failure of the fast path once, because it must not stop an arm."""
        path = self._path
        if path and not path.is_told and (problem := path.problem):
            path.is_told = True
            LOG.warning("fast path: %s; the arms go on without vibration", problem)


VALID = f"{VIBRATION}.valid"
"""Key of an observation: 1 if the vibration was measured, 0 if the fast path has failed."""


class VibrationRobot(Wrapping):
    """Robot of LeRobot that also observes vibration, to be joined with LeRobot's base class.

    LeRobot's programs accept numbers, which become ``observation.state``, and images, but no other
    arrays. Each sample of the window therefore has a separate key; `vibration` is the window as an
    array.

    Parameters
    ----------
    wrapped
        Robot of LeRobot.
    arguments : str
        See `Wrapping`; the same as the leader's.
    fps : int
        Frames per second of LeRobot's loop or dataset.

    Raises
    ------
    ParameterError
        An argument is not allowed, or the rate is no whole multiple of `fps`.
    """

    send_action = PassedOn()

    def __init__(self, wrapped: Any, arguments: str, fps: int) -> None:
        super().__init__(wrapped, arguments)
        self._size = fast_path.samples_per_frame(self._arguments.rate, fps)
        self._axes = fast_path.tool_axes(self._arguments)
        self._keys = self._axes.sample_names(self._size)

    @property
    def cameras(self) -> Any:
        """Cameras of the follower; empty if it has none."""
        return getattr(self.wrapped, "cameras", {})

    @property
    def observation_features(self) -> dict[str, Any]:
        """Keys and types of the follower's observation, and of the vibration, oldest first."""
        return {**self.wrapped.observation_features, **dict.fromkeys([*self._keys, VALID], float)}

    def vibration(self) -> FloatArray:
        """Return the gripper's acceleration in the frame before now.

        Returns
        -------
        ndarray, shape (n, axes)
            Acceleration, m/s^2, the newest last, at the fast path's rate; zero after a failure of
            the fast path, which is logged once: NaN would move an arm whose policy reads it.
        """
        return self._measured()[0]

    def _measured(self) -> tuple[FloatArray, bool]:
        """Return the vibration, and whether it was measured."""
        self.tell_problem()
        found = self._path.window(self._size) if self._path else None
        samples = np.zeros((self._size, 3)) if found is None else found
        return samples[:, self._axes.indices], found is not None

    def get_observation(self) -> dict[str, Any]:
        """Return the follower's observation, with the vibration in the frame before the call."""
        felt, is_valid = self._measured()  # first, because cameras may take time
        observed = self.wrapped.get_observation()
        values = [*felt.T.ravel().tolist(), float(is_valid)]
        return {**observed, **dict(zip([*self._keys, VALID], values, strict=True))}


class FeltTeleoperator(Wrapping):
    """Teleoperator of LeRobot with a coil in its handle, to be joined with LeRobot's base class.

    The coil moves while actions are requested. If the fast path ends meanwhile, the arm continues.
    Parameters are as for `Wrapping`.
    """

    feedback_features = PassedOn()
    send_feedback = PassedOn()

    def get_action(self) -> dict[str, Any]:
        """Return the leader's action, and let the coil move until the next."""
        self.tell_problem()
        if self._path:
            self._path.feel()
        return dict(self.wrapped.get_action())
