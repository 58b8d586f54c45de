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

"""Inverse controller that adapts to the user's grip."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.controllers.inverse import InverseController, InverseParameters
from haptic_accel.core.control.grip_estimation import (
    GRIP,
    AdaptationParameters,
    GripEstimator,
)
from haptic_accel.core.control.inversion.family import InverseFamily, design_family
from haptic_accel.core.control.learning import Learner
from haptic_accel.core.parameters import parameter

UNDESCRIBED = 0.2
"""Relative deviation of the response above which the grip estimate is frozen. A mode within its
band, for example, fits no grip and would make the estimate jump. Ordinary hands cause up to
0.1."""


@dataclass(frozen=True)
class AdaptiveParameters(InverseParameters):
    """Parameters of the inverse and of the grip estimator."""

    frozen: bool = parameter(False, "stop the grip estimation and keep the present grip")
    adaptation: AdaptationParameters = field(default_factory=AdaptationParameters)

    def family(self, loop: Loop) -> InverseFamily:
        """Return the inverse for all grips; takes a fraction of a second."""
        return design_family(loop.plant, loop.rate, self.goal(loop))


class AdaptiveController(InverseController):
    """f_a = a_hdes through the inverse for the estimated grip."""

    Parameters = AdaptiveParameters

    def __init__(self, parameters: AdaptiveParameters, loop: Loop) -> None:
        self._family = parameters.family(loop)
        self._estimator = GripEstimator(loop.plant, loop.rate, parameters.adaptation)
        self._grip = self._estimator.grip
        self._invert_by(self._family.bank(self._grip), parameters, loop)
        self._learner = Learner(self._family, loop.plant, loop.rate, parameters.goal(loop))
        self._applied = 0.0
        self.frozen = parameters.frozen

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force for the desired acceleration."""
        # The force applied one sample ago, and the acceleration measured then.
        self._estimator.observe(self._applied, measured_acceleration)
        self._learner.observe(desired_acceleration, self._applied, measured_acceleration)
        return super().force(desired_acceleration, measured_acceleration)

    def applied(self, actuator_force: float) -> None:
        """Store the force that drives the handle: the applied one minus friction compensation."""
        self._applied = actuator_force - self.friction_force

    def adapt(self) -> None:
        """Execute a part of the estimation; after its last part start to change the filter."""
        if self.frozen:
            return
        looked = self._estimator.update()
        if looked and self._learner.deviation < UNDESCRIBED:
            self._grip = self._estimator.grip
        if looked or self._learner.update(self._grip):
            self._excursion.replace(self._family.taps(self._grip) + self._learner.correction)

    def freeze(self, frozen: bool) -> None:
        """Freeze the present filter, or resume the adaptation to the grip."""
        self.frozen = frozen

    def reset(self) -> None:
        """Clear the filters and the estimated grip."""
        self._estimator.reset()
        self._grip = self._estimator.grip
        self._learner.reset()
        super().reset()
        self._applied = 0.0

    @property
    def warning(self) -> str:
        """Grip parameters at a bound of their range; empty if there are none."""
        ends = self._estimator.at_end
        # Report no grip if none fits.
        if not ends or self._learner.deviation >= UNDESCRIBED:
            return ""
        grip = dict(zip(GRIP, self._grip.tolist(), strict=True))
        parts = (
            f"{name} at its {end} end, {grip[name]:.4g} {GRIP[name]}" for name, end in ends.items()
        )
        return f"grip outside the range of adaptation: {', '.join(parts)}"

    def diagnostics(self) -> dict[str, str]:
        """Return the estimated grip."""
        grip = zip(GRIP.items(), self._grip.tolist(), strict=True)
        return {
            **{f"{name} ({unit})": f"{value:.4g}" for (name, unit), value in grip},
            "grip estimates": str(self._estimator.estimates),
            "designs learnt": str(self._learner.estimates),
            "frozen": str(self.frozen).lower(),
        }
