"""Identification of the handle: excite it, estimate its response, fit models to that."""

from haptic_accel.core.identification.approximate import approximate_model, magnitude_error
from haptic_accel.core.identification.discrete import DiscreteModel, identify_discrete
from haptic_accel.core.identification.estimate import (
    FrequencyResponse,
    RecordingError,
    check_recording,
    dft_ratio,
    h1,
    h2,
)
from haptic_accel.core.identification.evaluation import (
    UNEXPLAINED,
    GripIdentification,
    Identification,
    centred,
    identify_handle,
)
from haptic_accel.core.identification.fit import (
    DEFAULT_FREE,
    MOUNT,
    HandleFit,
    fit_handle,
    sampled_response,
)
from haptic_accel.core.identification.sweep import (
    SAMPLES_MISSING,
    IdentificationTrial,
    SweepParameters,
    excitation,
    find_trials,
    kept_repeats,
    sweep,
)

__all__ = [
    "DEFAULT_FREE",
    "MOUNT",
    "SAMPLES_MISSING",
    "UNEXPLAINED",
    "DiscreteModel",
    "FrequencyResponse",
    "GripIdentification",
    "HandleFit",
    "Identification",
    "IdentificationTrial",
    "RecordingError",
    "SweepParameters",
    "approximate_model",
    "centred",
    "check_recording",
    "dft_ratio",
    "excitation",
    "find_trials",
    "fit_handle",
    "h1",
    "h2",
    "identify_discrete",
    "identify_handle",
    "kept_repeats",
    "magnitude_error",
    "sampled_response",
    "sweep",
]
