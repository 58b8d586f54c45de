"""Feedforward and feedback on the handle's acceleration, Fig. 2 of the paper complete."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.control.controllers.constant import ConstantController, ConstantParameters
from haptic_accel.core.control.controllers.dynamic import DynamicController
from haptic_accel.core.control.controllers.interface import Controller, Loop, NoParameters
from haptic_accel.core.control.controllers.inverse import InverseController, InverseParameters
from haptic_accel.core.control.controllers.none import NoController
from haptic_accel.core.control.feedback_design import (
    MARGIN,
    FeedbackDesign,
    GripRange,
    Response,
    design_feedback,
)
from haptic_accel.core.control.filters import SampleFilter, inverse_of
from haptic_accel.core.control.inversion.convolution import SampleConvolution
from haptic_accel.core.control.inversion.plant import section_response
from haptic_accel.core.identification.approximate import approximate_model
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import parameter

FADING = 5e-3
"""How long the feedback takes to go and to come back, s: a step of force would be felt."""

REGAINED = 20e-3
"""How long the handle must be heard without a gap before the feedback comes back, s."""

INVERSE = "inverse"
"""The feedforward of which the feedback need only answer what it could not foresee."""


@dataclass(frozen=True)
class FeedbackParameters(InverseParameters):
    """The feedforward, and what the feedback must bear."""

    feedforward: str = parameter(
        INVERSE,
        "controller whose force the feedback is added to",
        choices=("none", "constant", "dynamic", INVERSE),
    )
    margin: float = parameter(
        MARGIN,
        "smallest distance of the loop from -1 at any grip of the range",
        low=0.05,
        high=0.95,
    )
    grips: GripRange = field(default_factory=GripRange)

    def design(self, loop: Loop) -> FeedbackDesign:
        """Return the feedback for a loop; about a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        _, response = _feedforward(self, loop)
        return _designed(self, loop, response)


class FeedbackController(Controller):
    """Any feedforward, and Q times what the handle did and was not to do.

    What is not to be done depends on the feedforward. The inverse is already the best causal
    filter, its travel and force weighed: what it leaves at the grip it was made for no feedback
    can take without harm, so that only what the model did not foresee is fed back, and at that
    grip there is nothing. The paper's controllers leave what a feedback can take: there the
    desired acceleration, delayed, is compared. (At 4 kHz, with the inverse and a mount that gives
    at 280 Hz, the prior's error is 46.5 % on average over the range of grips without feedback,
    44.7 % if the surprise is fed back, and 46.5 % if the desired acceleration is compared; with a
    rigid mount 32.1 % and twice 25.8 %.)

    The forces of all sources that were sent, `applied`, go through the model, so that a limit or
    another controller's force is not mistaken for the handle's doing.

    Where the measurement is missing the feedback fades out, and its filters are fed what they had
    last: a zero instead would be a step as large as gravity. It comes back when the measurement
    has been there for `REGAINED`. For the same reason all begins with the first measurement.

    Attributes
    ----------
    design : FeedbackDesign
        Its `summary` is fit to be printed.
    """

    Parameters = FeedbackParameters

    def __init__(self, parameters: FeedbackParameters, loop: Loop) -> None:
        self._feedforward, response = _feedforward(parameters, loop)
        self.design = _designed(parameters, loop, response)
        self._foreseen = parameters.feedforward == INVERSE
        self._high_pass = SampleFilter(self.design.high_pass)
        self._model = SampleConvolution(self.design.model)
        self._answer = SampleConvolution(self.design.taps)
        self._fade = 1.0 / max(1.0, FADING * loop.rate)
        self._regained = max(1, round(REGAINED * loop.rate))
        self._delay = parameters.granted_delay + 1
        self._gain = self.design.gain
        self._start()

    def _start(self) -> None:
        self._wanted = deque([0.0] * self._delay)
        self._expected = 0.0  # what the model said of the last tick, m/s^2
        self._surprise = 0.0  # the latest that is known, m/s^2
        self._first = math.nan  # gravity and all that was there before, m/s^2
        self._known = 0.0  # force whose effect is in what is wanted, N
        self._surplus = 0.0  # the last force beside that, N
        self._share, self._heard, self._gaps = 1.0, self._regained, 0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the feedforward's force and the feedback's."""
        force = self._feedforward.force(desired_acceleration, measured_acceleration)
        # The force of the last tick is seen at this one, whose sample is heard at the next.
        expected, self._expected = self._expected, self._model.sample(self._surplus)
        if not self._foreseen:
            self._wanted.append(desired_acceleration)
            expected += self._wanted.popleft()
        surprise = expected - measured_acceleration
        if math.isfinite(surprise):
            if math.isnan(self._first):
                self._first = surprise
            self._surprise = surprise - self._first
            self._heard += 1
        else:
            self._count_gap()
        self._share = self._faded()
        answer = self._answer.sample(self._high_pass.sample(self._surprise))
        self._known = 0.0 if self._foreseen else force
        force += self._share * answer
        self.applied(force)
        return force

    def applied(self, actuator_force: float) -> None:
        """Hear what was sent in the end: what friction leaves of it, the model is given."""
        taken = 0.0
        if isinstance(self._feedforward, InverseController):
            taken = self._feedforward.friction_force
        self._surplus = actuator_force - taken - self._known

    def status(self) -> dict[str, str]:
        """Return the feedback's gain, its margin, and how often it had to be switched off."""
        return {
            "feedback gain (N per m/s^2)": f"{self._share * self._gain:.3f}",
            "feedback margin": f"{self.design.tightest.margins.modulus:.2f}",
            "feedback off": str(self._gaps),
        }

    @property
    def warning(self) -> str:
        """Say so while the handle is not heard."""
        if self._heard < self._regained:
            return "feedback off: handle acceleration stale or saturated"
        return ""

    def reset(self) -> None:
        """Clear all filters, and take the handle for heard."""
        self._feedforward.reset()
        for part in (self._high_pass, self._model, self._answer):
            part.reset()
        self._start()

    def _count_gap(self) -> None:
        if self._heard >= self._regained:
            self._gaps += 1
        self._heard = 0

    def _faded(self) -> float:
        if self._heard >= self._regained:
            return min(1.0, self._share + self._fade)
        return max(0.0, self._share - self._fade)


def _designed(parameters: FeedbackParameters, loop: Loop, response: Response) -> FeedbackDesign:
    return design_feedback(
        loop.plant,
        loop.rate,
        response,
        foreseen=parameters.feedforward == INVERSE,
        granted_delay=parameters.granted_delay,
        margin=parameters.margin,
        grips=parameters.grips,
        spectrum=parameters.texture,
        high_pass_frequency=loop.high_pass_frequency,
    )


def _feedforward(parameters: FeedbackParameters, loop: Loop) -> tuple[Controller, Response]:
    """Return the feedforward for the handle as identified, and its response."""
    handle = loop.plant.handle
    if parameters.feedforward == "none":
        return NoController(NoParameters(), loop), lambda frequency: _flat(0.0, frequency)
    if parameters.feedforward == "constant":
        mass = ConstantParameters(mass=handle.m_h)
        return ConstantController(mass, loop), lambda frequency: _flat(handle.m_h, frequency)
    if parameters.feedforward == "dynamic":
        model = approximate_model(handle)
        sections = inverse_of(model, loop.rate)
        return DynamicController(model, loop), lambda frequency: section_response(
            sections, frequency, loop.rate
        )
    return InverseController(parameters, loop), parameters.filter(loop).response


def _flat(gain: float, frequency: FloatArray) -> ComplexArray:
    return np.full(len(frequency), gain, dtype=np.complex128)
