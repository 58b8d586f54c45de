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

"""Results of an identification with any number of coils: what all have, and their tables."""

from __future__ import annotations

import base64
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from matplotlib.figure import Figure

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.identification.evaluation import Identification
from haptic_accel.core.identification.fit import HandleFit
from haptic_accel.core.identification.sweep import SweepParameters
from haptic_accel.core.identification.three_axes import ThreeAxisIdentification
from haptic_accel.core.model import HandleParameters, MountParameters
from haptic_accel.core.parameters import own_schema
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.tables import DASH, ResultTable, number
from haptic_accel.pages import write

PARAMETER_FILE = "handle.yaml"
"""Name of the parameter file to which the page refers."""

MODEL_FILE = "identification.json"
"""Name of a file of metrics that the compensator reads."""

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


Found = TypeVar("Found", Identification, ThreeAxisIdentification)


@dataclass(frozen=True)
class Result(ABC, Generic[Found]):
    """Result of an identification.

    Attributes
    ----------
    found : Identification or ThreeAxisIdentification
    actuator : ActuatorParameters
        Actuator of each axis as known before the identification.
    latency : int
        Latency of the recordings, samples.
    doubts : sequence of str
        Reasons to doubt the fits, one line each.
    truth : HandleParameters or None
        Parameters of a simulated handle with one coil, if known.
    errors : mapping of ModelError
        Errors by model; empty if the true response is unknown.
    """

    found: Found
    actuator: ActuatorParameters
    latency: int
    doubts: Sequence[str]
    truth: HandleParameters | None = None
    errors: Mapping[str, ModelError] = field(default_factory=dict)

    template: ClassVar[str]
    """Template of the page."""

    model_file = ""
    """Name of a file of metrics that the parameter file names; empty without one."""

    @property
    def notes(self) -> list[str]:
        """Warnings to the reader of the metrics."""
        return [*self.doubts, *self.found.outliers]

    @property
    @abstractmethod
    def fits(self) -> Mapping[str, HandleFit]:
        """Fits by column of a table."""

    @property
    @abstractmethod
    def explained(self) -> str:
        """Sentence on the residual of the fit."""

    @property
    @abstractmethod
    def heading(self) -> str:
        """First lines of a parameter file."""

    @property
    def moving_mass(self) -> float | None:
        """Mass of the handle without the actuator, kg; None for several axes."""
        return None

    @abstractmethod
    def beside_truth(
        self, rig: RigParameters, sweep: SweepParameters, on_arrival: bool
    ) -> Result[Found]:
        """Return the result with its errors against the simulated rig that was identified.

        Parameters
        ----------
        rig : RigParameters
        sweep : SweepParameters
            Excitation of the comparison.
        on_arrival : bool
            True if forces took effect on arrival. Their age adds to the rig's own delay and is
            part of the models, so the identified delay is used as the true one.
        """

    @abstractmethod
    def sentences(self) -> Iterator[str]:
        """Yield errors against the true response, and the delay of the hardware."""

    @abstractmethod
    def parameters(self, age: float, model: Path) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node that describe the handle.

        The compensator reports the doubts as a warning.

        Parameters
        ----------
        age : float
            Age of forces applied on arrival, s. A controller compensates it, as part of the delay,
            but it is not part of the simulated handle's own delay.
        model : Path
            File of the metrics, of which the compensator of several axes reads its plant.
        """

    @abstractmethod
    def metrics(self) -> dict[str, Any]:
        """Return the metrics for a JSON file."""

    @abstractmethod
    def figures(self, sweep: SweepParameters) -> dict[str, Figure]:
        """Return the figures of the page by the names of their files."""

    def write_report(
        self, folder: Path, sweep: SweepParameters, settings: Mapping[str, str]
    ) -> Path:
        """Write a self-contained page with parameters, models and plots; return its path.

        Parameters
        ----------
        folder : Path
            Folder, created if necessary. The page refers to a file ``handle.yaml`` in it. The
            plots are also saved beside it.
        sweep : SweepParameters
            Excitation of the handle.
        settings : mapping of str to str
            Arguments of the run, shown as a table.
        """
        folder.mkdir(parents=True, exist_ok=True)
        index = folder / "index.html"
        write(
            index,
            self.template,
            result=self,
            found=self.found,
            settings=settings,
            columns=list(self.fits),
            parameters=parameter_rows(self.fits, self.truth),
            simulated=self.truth is not None,
            number=number,
            parameter_file=PARAMETER_FILE,
            pictures=pictures(self.figures(sweep), folder),
        )
        return index


# Tables


@dataclass(frozen=True)
class Row:
    """Row of the parameter table: true value, and for each fit value and error."""

    name: str
    text: str
    unit: str
    true: str
    cells: list[tuple[str, str]]


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


def parameter_rows(
    by_column: Mapping[str, HandleFit], truth: HandleParameters | None
) -> list[Row]:
    """Return the table of fitted and known parameters.

    Parameters
    ----------
    by_column : mapping of str to HandleFit
        Fits, each with a cell in a row.
    truth : HandleParameters or None
        Parameters of a simulated handle, if known.
    """
    fits = list(by_column.values())
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


def parameter_table(
    by_column: Mapping[str, HandleFit], truth: HandleParameters | None
) -> ResultTable:
    """Return the parameters as a table for a terminal."""
    left = ("name", "unit", "true") if truth else ("name", "unit")
    rows = []
    for row in parameter_rows(by_column, truth):
        cells = [
            f"{value} ± {error}" if error[0].isdigit() else f"{value} {error}"
            for value, error in row.cells
        ]
        rows.append([*(getattr(row, name) for name in left), *cells])
    headings = ("", *left[1:], *by_column)
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


def fit_metrics(fit: HandleFit) -> dict[str, Any]:
    """Return the parameters of a fit with standard errors for a JSON file."""
    return {
        "parameters": {
            name: {
                "value": fit.value(name),
                "standard_error": fit.standard_errors.get(name),
                "unit": given.unit,
            }
            for name, (_, given) in own_schema(HandleParameters).items()
        },
        "delay_s": fit.delay,
        "delay_us": fit.delay * 1e6,
        "delay_standard_error_s": fit.standard_errors.get("delay"),
        "friction_n": fit.bearing.friction,
        "friction_standard_error_n": fit.standard_errors.get("friction"),
        "mount": asdict(fit.mount),
        "mount_standard_errors": {
            name: fit.standard_errors.get(f"mount_{name}") for name in asdict(fit.mount)
        },
        "residual": fit.residual,
    }


def plain(values: Mapping[str, Any]) -> dict[str, float]:
    """Return numbers rounded to six digits for a parameter file."""
    return {name: float(f"{value:.6g}") for name, value in values.items()}


# Figures of a page

_DPI = 130  # pixels per inch
_CSS_DPI = 96  # pixels per inch of a page
_DIGITS = 5  # significant digits of a value with unknown error
_MOST_DIGITS = 7  # for a very small error
_ERROR_DIGITS = 2  # of a standard error


def pictures(figures: Mapping[str, Figure], folder: Path) -> dict[str, dict[str, Any]]:
    """Write figures to a folder; return by name their addresses for a page and sizes in pixels."""
    return {name: _picture(figure, folder / name) for name, figure in figures.items()}


def _picture(figure: Figure, path: Path) -> dict[str, Any]:
    """Write a figure; return its address for a page and its size in pixels."""
    figure.savefig(path, dpi=_DPI)
    encoded = base64.b64encode(path.read_bytes()).decode("ascii")
    width, height = (round(_CSS_DPI * inches) for inches in figure.get_size_inches())
    return {"source": f"data:image/png;base64,{encoded}", "width": width, "height": height}
