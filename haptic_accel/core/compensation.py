"""From tool acceleration to actuator force: high-pass, controller, the actuator's limit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from haptic_accel.core.controllers import CONTROLLERS, Controller
from haptic_accel.core.filters import HIGH_PASS_FREQUENCY, SampleFilter, high_pass
from haptic_accel.core.parameters import Checked, ParameterError, parameter

PEAK_FORCE = 6.6
"""Peak force of the paper's voice coil, H2W NCM02-05-005-4JB, in N."""

LARGEST_ACCELERATION = 1.0e4
"""Above anything an accelerometer of a hand tool gives, m/s^2: a thousand g."""


@dataclass(frozen=True)
class CompensationParameters(Checked):
    """What surrounds every controller."""

    controller: str = parameter("dynamic", "which controller", choices=tuple(CONTROLLERS))
    high_pass_frequency: float = parameter(
        HIGH_PASS_FREQUENCY,
        "corner of the 4th-order Butterworth high-pass (paper)",
        unit="Hz",
        low=0.1,
        high=1000.0,
    )
    peak_force: float = parameter(
        PEAK_FORCE, "limit of the actuator's force", unit="N", low=0, high=100.0
    )


def build_controller(name: str, rate: float, parameters: Checked | None = None) -> Controller:
    """Build a controller by its name.

    Parameters
    ----------
    name : str
        A key of `CONTROLLERS`.
    rate : float
        Samples per second.
    parameters : optional
        An instance of the controller's own parameters; the defaults otherwise.

    Raises
    ------
    ParameterError
        No controller has this name.
    """
    if name not in CONTROLLERS:
        raise ParameterError(f"controller = {name!r}: must be one of {', '.join(CONTROLLERS)}")
    controller = CONTROLLERS[name]
    return controller(parameters if parameters is not None else controller.Parameters(), rate)


def check_rate(parameters: CompensationParameters, rate: float) -> None:
    """Refuse a rate in Hz that is too low for the high-pass.

    Raises
    ------
    ParameterError
        The corner lies above half the rate.
    """
    if not rate > 2 * parameters.high_pass_frequency:
        raise ParameterError(
            f"rate = {rate:g}: must be above twice high_pass_frequency"
            f" = {parameters.high_pass_frequency:g} Hz"
        )


class Compensation:
    """High-pass, controller and limit as one object that takes one sample at a time.

    Parameters
    ----------
    parameters : CompensationParameters
        Which controller, corner, limit.
    rate : float
        Samples per second; more than twice the high-pass' corner.
    controllers : mapping, optional
        Parameters of controllers by controller name, where not the defaults.

    Attributes
    ----------
    saturated : int
        Samples whose force was cut at the limit.
    rejected : int
        Samples that were no acceleration and were taken for zero.

    Raises
    ------
    ParameterError
        The rate is too low for the high-pass.
    """

    def __init__(
        self,
        parameters: CompensationParameters,
        rate: float,
        controllers: Mapping[str, Checked] | None = None,
    ) -> None:
        check_rate(parameters, rate)
        name = parameters.controller
        self._high_pass = SampleFilter(high_pass(parameters.high_pass_frequency, rate))
        self._controller = build_controller(name, rate, (controllers or {}).get(name))
        self._peak_force = parameters.peak_force
        self.saturated = 0
        self.rejected = 0

    def sample(self, tool_acceleration: float, handle_acceleration: float) -> tuple[float, float]:
        """Take one sample of tool and handle acceleration along the actuator's axis.

        Parameters
        ----------
        tool_acceleration, handle_acceleration : float
            m/s^2, as measured. A value that is not finite or beyond `LARGEST_ACCELERATION`
            counts as zero, so that one bad sample cannot poison the filters or hold the
            actuator at its limit for seconds.

        Returns
        -------
        desired_acceleration : float
            m/s^2.
        actuator_force : float
            N, within the actuator's limit and always finite.
        """
        desired = self._high_pass.sample(self._plausible(tool_acceleration))
        force = self._controller.force(desired, self._plausible(handle_acceleration))
        if not (math.isfinite(desired) and math.isfinite(force)):
            # A controller's own instability: a filter that holds infinity never recovers.
            self.reset()
            return 0.0, 0.0
        return desired, self._limited(force)

    def reset(self) -> None:
        """Return to the state of a compensation that has always seen zero."""
        self._high_pass.reset()
        self._controller.reset()

    def _plausible(self, acceleration: float) -> float:
        if abs(acceleration) <= LARGEST_ACCELERATION:  # false for NaN too
            return acceleration
        self.rejected += 1
        return 0.0

    def _limited(self, force: float) -> float:
        if abs(force) <= self._peak_force:
            return force
        self.saturated += 1
        return math.copysign(self._peak_force, force)
