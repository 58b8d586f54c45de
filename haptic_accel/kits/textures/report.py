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

"""Reports of texture models: prediction errors, nodes, and spectra."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_accel.core.surfaces.texture import TextureModel
from haptic_accel.core.tables import Column, ResultTable
from haptic_accel.kits.textures.building import BAND, Built, HeldOut, Segment

MILLI = 1e-3

MOST_DRAWN, MOST_LISTED = 6, 8
"""Spectra in one plot, and groups of segments in the table of a report."""

HELD_OUT = (
    Column("speed_m_s", "speed", "mm/s", 0, lambda each: each.speed, 1 / MILLI),
    Column("force_n", "force", "N", 2, lambda each: each.force),
    Column("seconds", "s", digits=2),
    Column("distance_db", "distance", "dB", 2, lambda each: each.distance),
    Column("rms_m_s2", "RMS", "m/s²", 2, lambda each: each.rms),
    Column("model_rms_m_s2", "model's", "", 2, lambda each: each.modelled_rms),
)
"""Columns of the table of segments that a model was built without."""

NODES = (
    Column("speed_m_s", "speed", "mm/s", 0, factor=1 / MILLI),
    Column("force_n", "force", "N", 2),
    Column("rms_m_s2", "RMS", "m/s²", 2),
)
"""Columns of the table of a model's nodes."""


def held_out_table(built: Built) -> ResultTable:
    """Return prediction errors of segments held out of the model, the largest first."""
    low, high = BAND
    title = f"least well predicted by a model of the other half, {low:g} to {high:g} Hz"
    worst = sorted(built.held_out, key=lambda each: -each.distance)[:MOST_LISTED]
    return ResultTable.of(HELD_OUT, worst, title=title, left=0)


def described(built: Built) -> Iterator[str]:
    """Yield order, coverage and errors of a model, and the unused parts of recordings."""
    yield (
        f"order {built.order}, {len(built.segments)} segments, measured nodes: {built.measured},"
        f" log-spectral distance {built.distance:.2f} dB; they cover {100 * built.coverage:.0f} %"
        f" of the plane to {built.model.speeds.max() / MILLI:.0f} mm/s and"
        f" {built.model.forces.max():.2f} N"
    )
    own = built.following
    yield (
        f"single segments, left out: RMS off by {100 * own.rms_error:.0f} %, spectrum by"
        f" {own.distance:.1f} dB; with the mean spectrum by {100 * own.constant_rms_error:.0f} %"
        f" and {own.constant_distance:.1f} dB"
    )
    if not own.better:
        yield (
            "does not follow speed and force: no better than the mean spectrum; record strokes at"
            " more varied speeds and forces"
        )
    for reason in dict.fromkeys(each.reason for each in built.refused):
        seconds = sum(each.end - each.begin for each in built.refused if each.reason == reason)
        yield f"not used: {seconds:.2f} s {reason}"


def nodes_table(model: TextureModel) -> ResultTable:
    """Return the nodes of a model."""
    nodes = sorted(zip(model.speeds, model.forces, model.rms, strict=True))
    rows = [dict(zip((each.key for each in NODES), node, strict=True)) for node in nodes]
    return ResultTable.of(NODES, rows, title="nodes", left=0)


def draw(
    model: TextureModel, held_out: Sequence[HeldOut] = (), segments: Sequence[Segment] = ()
) -> Figure:
    """Draw spectra, and the plane of speed and force with its triangles."""
    figure = Figure(figsize=(11, 4.6), layout="constrained", facecolor="white")
    spectra, plane = figure.subplots(1, 2)
    if held_out:
        _draw_compared(spectra, held_out)
    else:
        _draw_spectra(spectra, model)
    spectra.set(xlabel="frequency (Hz)", ylabel="power density ((m/s²)²/Hz)", yscale="log")
    spectra.set_xlim(0, model.rate / 2)
    spectra.grid(alpha=0.3)
    spectra.legend(fontsize=7)
    speeds = model.speeds / MILLI
    plane.triplot(speeds, model.forces, model.triangles, color="#bbbbbb", linewidth=0.8)
    nodes = plane.scatter(speeds, model.forces, c=model.rms, cmap="viridis", zorder=3)
    figure.colorbar(nodes, ax=plane, label="RMS (m/s²)")
    positions = np.array([(each.speed / MILLI, each.force) for each in segments]).reshape(-1, 2)
    plane.plot(*positions.T, ".", color="#d55e00", markersize=3, label="segments")
    plane.set(xlabel="speed (mm/s)", ylabel="force (N)")
    return figure


def _draw_compared(panel: Axes, held_out: Sequence[HeldOut]) -> None:
    """Draw measured spectra, and predictions from other segments."""
    for number, each in enumerate(sorted(held_out, key=lambda e: -e.seconds)[:MOST_DRAWN]):
        colour, label = f"C{number}", f"{each.speed / MILLI:.0f} mm/s, {each.force:.2f} N"
        panel.plot(each.frequency, each.measured, color=colour, linewidth=0.8, label=label)
        panel.plot(each.frequency, each.modelled, "--", color=colour)
    panel.set_title("left-out segments: measured, and modelled (dashed)", fontsize=9)


def _draw_spectra(panel: Axes, model: TextureModel) -> None:
    """Draw the model's spectra at its loudest nodes; nodes at rest have none."""
    frequency = np.linspace(1.0, model.rate / 2, 500)
    rms = model.rms
    loudest = np.argsort(-rms)[: min(MOST_DRAWN, np.count_nonzero(rms))]
    for node in loudest.tolist():
        speed, force = float(model.speeds[node]), float(model.forces[node])
        label = f"{speed / MILLI:.0f} mm/s, {force:.2f} N"
        panel.plot(frequency, model.spectrum(speed, force, frequency), label=label)
