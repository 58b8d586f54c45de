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

"""Report of an identification: a page with parameters, models and plots."""

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
from haptic_accel.core.handle.discrete import DiscreteModel
from haptic_accel.core.identification.evaluation import UNEXPLAINED, Identification
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.tables import DASH, ResultTable, number
from haptic_accel.pages import write

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file to which the page refers."""

POOLED = "all grips"
"""Heading of the fit to all trials of several grips."""

KNOWN = "known"
"""Text for the standard error of a parameter that was not fitted."""

MICROSECONDS = 1e6
"""Microseconds per second."""


@dataclass(frozen=True)
class ModelError:
    """Largest errors of a model's response over a band.

    Attributes
    ----------
    magnitude_db : float
        Largest magnitude error, dB.
    phase_deg : float
        Largest phase error, degrees.
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
    """Write a page with the parameters, models and plots of an identification to a folder.

    Parameters
    ----------
    found : Identification
        Result of the identification.
    sweep : SweepParameters
        Excitation of the handle.
    folder : Path
        Folder, created if necessary. The page refers to a file ``handle.yaml`` in it.
    settings : mapping of str to str
        Arguments of the run, shown as a table.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    errors : mapping of str to ModelError
        Errors by model, ``discrete`` and ``physical``; empty if the true response is unknown.
    band : tuple of float
        Band of the errors, Hz.
    notes : sequence of str
        Paragraphs below the heading, warnings first.

    Returns
    -------
    Path
        Page ``folder/index.html``, which is self-contained. The plots are also saved beside it as
        ``fig4_sweep.png``, ``fig5_models.png`` and ``coherence.png``.
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
_CSS_DPI = 96  # pixels per inch of a page
_DIGITS = 5  # significant digits of a value with unknown error
_MOST_DIGITS = 7  # for a very small error
_ERROR_DIGITS = 2  # of a standard error


def _picture(figure: Figure, path: Path) -> dict[str, Any]:
    """Write a figure; return its address for a page and its size in pixels."""
    figure.savefig(path, dpi=_DPI)
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    width, height = (round(_CSS_DPI * inches) for inches in figure.get_size_inches())
    return {"source": f"data:image/png;base64,{encoded}", "width": width, "height": height}


# Contents of the page


@dataclass(frozen=True)
class Row:
    """Row of the parameter table: true value, and for each fit value and error."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


def fits_by_column(found: Identification) -> list[tuple[str, HandleFit]]:
    """Return the fit of each grip and, if there are several, of all together."""
    fits = [(name, grip.fit) for name, grip in found.grips.items()]
    return fits if len(fits) == 1 else [*fits, (POOLED, found.fit)]


def _quantities() -> Iterator[tuple[str, str, str, float]]:
    """Yield name, text, unit, and the factor to that unit, for all possible fitted quantities."""
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
    """Return the table of fitted and known parameters.

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


def parameter_table(found: Identification, truth: HandleParameters | None) -> ResultTable:
    """Return the parameters as a table for a terminal."""
    left = ("name", "unit", "true") if truth else ("name", "unit")
    rows = []
    for row in parameter_rows(found, truth):
        cells = [
            f"{value} ± {error}" if error[0].isdigit() else f"{value} {error}"
            for value, error in row.cells
        ]
        rows.append([*(getattr(row, name) for name in left), *cells])
    headings = ("", *left[1:], *(name for name, _ in fits_by_column(found)))
    return ResultTable(headings, rows, "the handle, with standard errors", left=len(left))


def _cell(value: float, error: float | None, factor: float) -> tuple[str, str]:
    """Return a value, rounded to the last digit of its standard error, and that error."""
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
    """Return the number of decimals that gives a value a number of significant digits."""
    return max(0, digits - 1 - math.floor(math.log10(abs(value))))


def _number(value: float | None) -> str:
    """Return a number as text, or a dash if there is none."""
    if value is None or not math.isfinite(value):
        return DASH
    return f"{value:.{_DIGITS}g}".replace("-", "\N{MINUS SIGN}")


def explained(found: Identification) -> str:
    """Return a sentence on the residual of the fit."""
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
    """Return the number of poles; a first-order section has no z^-2 in its denominator."""
    return int(2 * len(model.sections) - np.count_nonzero(model.sections[:, 5] == 0.0))
