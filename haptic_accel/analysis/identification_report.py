# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes the report of an identification: a page with its parameters, models and plots."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from haptic_accel.analysis.identification_plots import coherence_plot, model_plot, sweep_plot
from haptic_accel.analysis.plots import DASH, number
from haptic_accel.core.handle.discrete import DiscreteModel
from haptic_accel.core.identification.evaluation import UNEXPLAINED, Identification
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import own_schema
from haptic_accel.pages import write

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file to which the page refers."""

POOLED = "all grips"
"""Heading of the fit to all trials of several grips."""

KNOWN = "known"
"""Placeholder for the standard error of a parameter that was not fitted."""

MICROSECONDS = 1e6
"""Microseconds in a second."""


@dataclass(frozen=True)
class ModelError:
    """Largest differences of a model's response from the true one over a band.

    Attributes
    ----------
    magnitude_db : float
        Largest difference of the magnitude, dB.
    phase_deg : float
        Largest difference of the phase, degrees.
    """

    magnitude_db: float
    phase_deg: float


def write_identification_report(
    found: Identification,
    sweep: SweepParameters,
    folder: Path,
    *,
    settings: Mapping[str, str],
    truth: HandleParameters | None,
    errors: Mapping[str, ModelError],
    band: tuple[float, float],
    notes: Sequence[str] = (),
) -> Path:
    """Write a page with the parameters, models and plots of an identification into a folder.

    Parameters
    ----------
    found : Identification
        Result of the identification.
    sweep : SweepParameters
        Excitation of the handle.
    folder : Path
        Folder, made if it does not exist. The page refers to ``handle.yaml`` there.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    errors : mapping of str to ModelError
        Errors by model, ``discrete`` and ``physical``; empty where there is no truth.
    band : tuple of float
        Band of the errors, Hz.
    notes : sequence of str
        Paragraphs shown under the heading, warnings first.

    Returns
    -------
    Path
        The page, ``folder/index.html``, which needs no other file to be shown. Beside it lie
        its plots ``fig4_sweep.png``, ``fig5_models.png`` and ``coherence.png``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    identified = next(iter(found.grips.values()))
    plots = {
        "fig4_sweep.png": sweep_plot(identified.trials[0], sweep),
        "fig5_models.png": model_plot(found),
        "coherence.png": coherence_plot(found),
    }
    index = folder / "index.html"
    write(
        index,
        "identification.html.j2",
        found=found,
        settings=settings,
        notes=notes,
        columns=[name for name, _ in fits_by_column(found)],
        parameters=parameter_rows(found, truth),
        simulated=truth is not None,
        explained=explained(found),
        order=_order(found.discrete),
        errors=errors,
        band=band,
        number=number,
        parameter_file=PARAMETER_FILE,
        pictures={name: _picture(figure, folder / name) for name, figure in plots.items()},
    )
    return index


_DPI = 130  # pixels per inch
_CSS_DPI = 96  # a page's pixels per inch
_DIGITS = 5  # that count, of a value whose error is not known
_MOST_DIGITS = 7  # of one whose error is very small
_ERROR_DIGITS = 2  # of a standard error


def _picture(figure: Figure, path: Path) -> dict[str, Any]:
    """Write a figure, and return its address for a page and its size in pixels."""
    figure.savefig(path, dpi=_DPI)
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    width, height = (round(_CSS_DPI * inches) for inches in figure.get_size_inches())
    return {"source": f"data:image/png;base64,{encoded}", "width": width, "height": height}


# Contents of the page


@dataclass(frozen=True)
class Row:
    """A line of the table of parameters: true value, and of each fit its value and error."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


def fits_by_column(found: Identification) -> list[tuple[str, HandleFit]]:
    """Return the fit of each grip and, where there are several, of all of them."""
    fits = [(name, grip.fit) for name, grip in found.grips.items()]
    return fits if len(fits) == 1 else [*fits, (POOLED, found.fit)]


def _quantities() -> Iterator[tuple[str, str, str, float]]:
    """Yield name, text, unit, and the factor to that unit, of all that a fit may find."""
    for name, (_, given) in own_schema(HandleParameters).items():
        yield name, given.text, given.unit, 1.0
    yield "friction", "dry friction of the actuator's bearing", "N", 1.0
    yield (
        "delay",
        "delay of the hardware, in addition to latency, hold and one sample",
        "µs",
        MICROSECONDS,
    )
    for name, (_, given) in own_schema(MountParameters).items():
        yield f"mount_{name}", "mount of the accelerometer", given.unit or "1", 1.0


def parameter_rows(found: Identification, truth: HandleParameters | None) -> list[Row]:
    """Return the table of the fitted and known parameters.

    Parameters
    ----------
    found : Identification
        Result of the identification; a row has a cell for each of `fits_by_column`.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    """
    fits = [fit for _, fit in fits_by_column(found)]
    of_handle = own_schema(HandleParameters)
    rows = []
    for name, text, unit, factor in _quantities():
        fitted = any(name in fit.standard_errors for fit in fits)
        if fitted or name in of_handle:
            cells = [
                _cell(fit.value(name), fit.standard_errors.get(name), factor)
                if name in fit.standard_errors or name in of_handle
                else (DASH, DASH)
                for fit in fits
            ]
            label = name if name in of_handle else name.replace("_", " ")
            rows.append(Row(label, text, unit, _number(getattr(truth, name, None)), cells))
    return rows


def _cell(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """Return a value, to the last digit of its standard error, and that error."""
    value *= factor
    if error is None:
        return _number(value), KNOWN
    error *= factor
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return _number(value), _number(error)
    decimals = _decimals(error, _ERROR_DIGITS)
    own = min(decimals, _decimals(value, _MOST_DIGITS)) if value else decimals
    return number(value, own), number(error, decimals)


def _decimals(value: float, digits: int) -> int:
    """Return the number of decimals with which a value has so many digits that count."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def _number(value: float | None) -> str:
    """Return a number for a reader, a dash where there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:.{_DIGITS}g}".replace("-", "\N{MINUS SIGN}")


def explained(found: Identification) -> str:
    """Explain the residual of the fit in a sentence."""
    residual = found.fit.residual
    if len(found.grips) > 1:
        return (
            "The pooled fit is a compromise between the grips. Its residual is"
            f" {100 * found.fit.relative_residual:.2g} % of the response (root mean square), and"
            " its standard errors show the difference between the grips, not the noise."
        )
    sentence = (
        f"The residual of the fit is {residual:.3g} times the scatter of the data, or"
        f" {100 * found.fit.relative_residual:.2g} % of the response (root mean square)."
    )
    if residual <= UNEXPLAINED:
        return (
            f"{sentence} Noise alone gives about 1: the data shows no significant deviation from"
            " the model."
        )
    sentence += " Noise alone gives about 1, so the handle deviates from the model"
    if "friction" in found.fit.standard_errors:
        return f"{sentence}. The standard errors include that."
    return f"{sentence}, for example by dry friction. The standard errors do not include that."


def _order(model: DiscreteModel) -> int:
    """Return the number of poles: a section of first order has no z^-2 below."""
    return int(2 * len(model.sections) - np.count_nonzero(model.sections[:, 5] == 0.0))
