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
from haptic_accel.core.identification.fit import (
    DEFAULT_FREE,
    MOUNT,
    HandleFit,
    fit_handle,
    sampled_response,
)
from haptic_accel.core.identification.sweep import (
    IdentificationTrial,
    SweepParameters,
    excitation,
    kept_repeats,
    run_identification,
    sweep,
)

__all__ = [
    "DEFAULT_FREE",
    "MOUNT",
    "DiscreteModel",
    "FrequencyResponse",
    "HandleFit",
    "IdentificationTrial",
    "RecordingError",
    "SweepParameters",
    "approximate_model",
    "check_recording",
    "dft_ratio",
    "excitation",
    "fit_handle",
    "h1",
    "h2",
    "identify_discrete",
    "kept_repeats",
    "magnitude_error",
    "run_identification",
    "sampled_response",
    "sweep",
]
