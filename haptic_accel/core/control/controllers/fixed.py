# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controllers that do not adapt: the paper's, the inverse, and the inverse with feedback.

The paper's conditions are no compensation, constant gain and approximate inverse. The inverse is
that of the complete identified handle, including hold, delay, mount and sensor. With feedback of
the handle's acceleration it is the complete Fig. 2 of the paper.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from haptic_accel.core.control import feedback_design, inversion
from haptic_accel.core.control.controllers.interface import Controller, Loop, NoParameters
from haptic_accel.core.control.feedback_design import MARGIN, FeedbackDesign, GripRange, Response
from haptic_accel.core.control.filters import inverse_of, section_response
from haptic_accel.core.handle.mechanics import approximate_model
from haptic_accel.core.model import ApproximateModel
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.control import (
    ConstantForce,
    ExcursionControl,
    FeedbackForce,
    FilterForce,
    Force,
    FrictionCompensation,
    InverseForce,
    SampleConvolution,
    SampleFilter,
)


class NoController(Controller):
    """Zero force: position coupling alone, the paper's first condition."""

    needs_plant = False

    force = Force.force

    def __init__(self, parameters: NoParameters, loop: Loop) -> None: ...


@dataclass(frozen=True)
class ConstantParameters(Checked):
    """Parameters of `ConstantController`."""

    mass: float = parameter(
        0.128, "gain of the controller: mass of handle and hand (m_h of Table I)", unit="kg", low=0
    )


class ConstantController(ConstantForce, Controller):
    """f_a = m_h a_hdes: the handle is assumed to be a mass, the paper's second condition."""

    Parameters = ConstantParameters
    needs_plant = False

    def __init__(self, parameters: ConstantParameters, loop: Loop) -> None:
        super().__init__(parameters.mass)


class DynamicController(FilterForce, Controller):
    """Inverse of the approximate handle model, from a_hdes to f_a: the paper's third condition."""

    Parameters = ApproximateModel

    def __init__(self, parameters: ApproximateModel, loop: Loop) -> None:
        super().__init__(inverse_of(parameters, loop.rate))


@dataclass(frozen=True)
class InverseParameters(Checked):
    """Delay and texture for the design of the inverse."""

    granted_time: float = parameter(
        inversion.GRANTED_TIME,
        "allowed delay of the handle behind the tool in addition to the latency, rounded to"
        " samples, at least one (paper: one at 1 kHz)",
        unit="s",
        low=0.0,
        high=inversion.LONGEST_GRANTED_TIME,
    )
    texture: inversion.TexturePrior = field(default_factory=inversion.TexturePrior)
    memory: float = parameter(
        inversion.CONVOLUTION_LENGTH, "length of the controller's impulse response", "s", 0.05, 0.4
    )

    def filter(self, loop: Loop) -> inversion.InverseFilter:
        """Return the inverse without travel reduction for a loop; takes a fraction of a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return inversion.design_inverse(loop.plant, loop.rate, self.goal(loop))

    def granted_delay(self, rate: float) -> int:
        """Return the granted delay at a rate in Hz, in samples."""
        return inversion.granted_samples(self.granted_time, rate)

    def goal(self, loop: Loop) -> inversion.Goal:
        """Return the design goal of the inverse, or of a family of inverses."""
        granted = loop.latency + self.granted_delay(loop.rate)
        corner = loop.high_pass_frequency
        return inversion.Goal(
            granted, self.memory, spectrum=self.texture, high_pass_frequency=corner
        )


class InverseController(InverseForce, Controller):
    """Causal inverse of eq. (3), hold, delay, mount and sensor, from a_hdes to f_a.

    Attributes
    ----------
    response : callable
        Force over desired acceleration, N per m/s^2, at frequencies in Hz.
    """

    Parameters = InverseParameters
    reducible = True

    def __init__(self, parameters: InverseParameters, loop: Loop) -> None:
        goal = parameters.goal(loop)
        bank = inversion.design_bank(loop.plant, loop.rate, goal)
        self.response = inversion.InverseFilter(
            bank.sections, bank.taps[0], loop.rate, goal
        ).response
        self._invert_by(bank, parameters, loop)

    def _invert_by(
        self, bank: inversion.InverseBank, parameters: InverseParameters, loop: Loop
    ) -> None:
        plant = loop.plant
        self._bank = bank
        limit = loop.travel_limit
        excursion = ExcursionControl(bank.taps, bank.motion, plant.handle, limit, loop.rate)
        # A force acts in the period before the sample that shows its effect.
        lag = parameters.granted_delay(loop.rate) - 0.5 - plant.delay * loop.rate
        friction = FrictionCompensation(plant.handle, plant.friction, loop.rate, lag)
        InverseForce.__init__(self, bank.sections, excursion, friction)

    def reset(self) -> None:
        """Reset the filters."""
        self.extension.reset()
        self.excursion.restart(self._bank.taps)
        self.friction.reset()
        self.friction_force = 0.0


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
        dynamic = DynamicController(model, loop)
        return dynamic, lambda f: section_response(sections, f, loop.rate)
    mass = handle.m_h if parameters.feedforward == "constant" else 0.0
    constant = ConstantController(ConstantParameters(mass), loop)
    return constant, lambda f: np.full(len(f), mass, np.complex128)
