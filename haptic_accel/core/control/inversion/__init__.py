"""The exact inverse of an identified handle as one causal filter, its prediction and its bound.

`design_inverse` and `design_basis` make the filter, `predict` gives its error, force and travel,
and `causal_bound` the smallest error of any causal filter.
"""

from __future__ import annotations

from haptic_accel.core.control.inversion.bound import causal_bound
from haptic_accel.core.control.inversion.convolution import SampleConvolution
from haptic_accel.core.control.inversion.design import (
    InverseBasis,
    InverseFilter,
    design_basis,
    design_inverse,
    extension,
)
from haptic_accel.core.control.inversion.plant import (
    IdentifiedPlant,
    Plant,
    inverse_terms,
    travel_response,
)
from haptic_accel.core.control.inversion.prediction import Prediction, predict
from haptic_accel.core.control.inversion.spectrum import (
    PRIOR,
    TexturePrior,
    ToolSpectrum,
    measured_spectrum,
)

__all__ = [
    "PRIOR",
    "IdentifiedPlant",
    "InverseBasis",
    "InverseFilter",
    "Plant",
    "Prediction",
    "SampleConvolution",
    "TexturePrior",
    "ToolSpectrum",
    "causal_bound",
    "design_basis",
    "design_inverse",
    "extension",
    "inverse_terms",
    "measured_spectrum",
    "predict",
    "travel_response",
]
