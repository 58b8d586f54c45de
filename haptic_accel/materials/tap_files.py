"""Recorded taps as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.taps import TapModel
from haptic_accel.core.surfaces.texture import Provenance
from haptic_accel.materials.texture_files import read_npz

ARRAYS = ("speeds", "samples", "rate")
"""Impact speeds, m/s; a row of acceleration for each, m/s^2; samples per second."""


def read_taps(path: Path) -> TapModel:
    """Read taps recorded at several impact speeds, NPZ with `ARRAYS`.

    Raises
    ------
    ParameterError
        In one line: the file and what is wrong with it.
    """
    content = read_npz(path)
    try:
        speeds, samples, rate = (np.asarray(content[name], dtype=np.float64) for name in ARRAYS)
        return TapModel(
            speeds=speeds,
            samples=samples,
            rate=rate.item(),
            provenance=Provenance(source=path.name),
        )
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None
    except (KeyError, ValueError):
        raise ParameterError(f"{path}: must hold numbers {', '.join(ARRAYS)}") from None
