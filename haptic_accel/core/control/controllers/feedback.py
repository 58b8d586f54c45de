# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feedforward and feedback of the handle's acceleration: the complete Fig. 2 of the paper."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.control import feedback_design
from haptic_accel.core.control.controllers import paper
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.controllers.inverse import InverseController, InverseParameters
from haptic_accel.core.control.feedback_design import MARGIN, FeedbackDesign, GripRange, Response
from haptic_accel.core.control.filters import inverse_of, section_response
from haptic_accel.core.handle.response import approximate_model
from haptic_accel.core.parameters import parameter
from haptic_accel.core.tick.control import FeedbackForce, SampleConvolution, SampleFilter

FADING = 5e-3
"""Duration of fading the feedback out and in, s; users would feel a step of force."""

REGAINED = 20e-3
"""Time of uninterrupted valid handle samples before the feedback is faded in again, s."""

FITTING = 2.0
"""Duration, in s of excitation, for which the response must match the plant model before feedback
is switched on again after sensor saturation. An unstable loop saturates the sensor repeatedly."""

INVERSE = "inverse"
"""Name of the feedforward with feedback of deviations from the model only."""


@dataclass(frozen=True)
class FeedbackParameters(InverseParameters):
    """Parameters of feedforward, stability margin and grip range."""

    feedforward: str = parameter(
        INVERSE,
        "feedforward controller, to whose force the feedback is added",
        choices=("none", "constant", "dynamic", INVERSE),
    )
    margin: float = parameter(
        MARGIN, "stability margin: distance of the open loop from -1", low=0.05, high=0.95
    )
    grips: GripRange = field(default_factory=GripRange)

    def granted_delay(self, rate: float) -> int:
        """Return the granted delay in samples; one for a feedforward of the paper."""
        return super().granted_delay(rate) if self.feedforward == INVERSE else 1

    def design(self, loop: Loop, feedforward: Response | None = None) -> FeedbackDesign:
        """Return feedback and feedforward response for a loop; takes about a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return feedback_design.design_feedback(
            loop.plant,
            loop.rate,
            feedforward or _feedforward(self, loop)[1],
            self.goal(loop),
            foreseen=self.feedforward == INVERSE,
            margin=self.margin,
            grips=self.grips,
        )


class FeedbackController(FeedbackForce, Controller):
    """Feedforward controller plus Q times the deviation of the handle from a reference.

    The reference depends on the feedforward. The inverse is already the best causal filter for its
    grip, considering travel and force. No feedback can reduce its remaining error. The reference
    is then the model's response, so that the feedback is zero at that grip. For the paper's
    controllers, whose errors feedback can reduce, the reference is the delayed desired
    acceleration. (At 4 kHz, with the inverse and a mount that resonates at 280 Hz, the mean error
    under the prior over the range of grips is 46.5 % without feedback, 44.7 % with the model as
    reference, and 46.5 % with the desired acceleration. With a rigid mount it is 32.1 %, and 25.8
    % in both cases.)

    The model receives the forces finally sent (`applied`). A limit or another controller's force
    thus does not appear as a deviation of the handle.

    While the measurement is missing, the feedback fades out and its filters receive their last
    input; a zero would be a step as large as gravity. The feedback is faded in again after valid
    samples for `REGAINED`. For the same reason the first measurement is used as the offset. A
    saturated sensor may result from an unstable loop. The feedback then stays off until the
    response has fitted the plant for `FITTING`.

    Attributes
    ----------
    design : FeedbackDesign
        Design of the feedback; its `summary` contains lines to print.
    """

    Parameters = FeedbackParameters
    reducible = True

    def __init__(self, parameters: FeedbackParameters, loop: Loop) -> None:
        feedforward, response = _feedforward(parameters, loop)
        self.design = design = parameters.design(loop, response)
        self.high_pass = SampleFilter(design.high_pass)
        self.model, self.answer = SampleConvolution(design.model), SampleConvolution(design.taps)
        foreseen, delay = parameters.feedforward == INVERSE, parameters.goal(loop).granted_delay
        fade = 1.0 / max(1.0, FADING * loop.rate)
        regained = max(1, round(REGAINED * loop.rate))
        super().__init__(feedforward, foreseen, delay + 1, fade, regained)

    def judged(self, fitting: float, fraction: float) -> None:
        """Accept the measurement again after the response has fitted the plant for long enough."""
        if fitting >= FITTING:
            self.distrusted = False

    def diagnostics(self) -> dict[str, str]:
        """Return gain and margin of the feedback, and the number of times it was switched off."""
        return {
            "feedback gain (N per m/s^2)": f"{self.share * self.design.gain:.3f}",
            "feedback margin": f"{self.design.tightest.margins.modulus:.2f}",
            "feedback off": str(self.gaps),
        }

    @property
    def warning(self) -> str:
        """Warning while the feedback is off; otherwise empty."""
        if self.distrusted:
            return (
                "feedback off: handle acceleration was saturated; it returns when the response has"
                f" fitted the plant for {FITTING:g} s"
            )
        if self.valid < self.regained:
            return "feedback off: handle acceleration stale"
        return ""


def _feedforward(parameters: FeedbackParameters, loop: Loop) -> tuple[Controller, Response]:
    """Return the feedforward for the identified handle, and its frequency response."""
    handle = loop.plant.handle
    if parameters.feedforward == INVERSE:
        inverse = InverseController(parameters, loop)
        return inverse, inverse.response
    if parameters.feedforward == "dynamic":
        model = approximate_model(handle)
        sections = inverse_of(model, loop.rate)
        dynamic = paper.DynamicController(model, loop)
        return dynamic, lambda f: section_response(sections, f, loop.rate)
    mass = handle.m_h if parameters.feedforward == "constant" else 0.0
    constant = paper.ConstantController(paper.ConstantParameters(mass), loop)
    return constant, lambda f: np.full(len(f), mass, np.complex128)
