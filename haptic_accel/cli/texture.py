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

"""``haptic-accel texture``: build texture models, import, show and render them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_accel.cli.options import FILE, json_option, verb
from haptic_accel.cli.output import check_writable, save
from haptic_accel.cli.tables import Column, print_results, print_table
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, printable
from haptic_accel.core.resampling import checked_rate, resampled
from haptic_accel.core.surfaces.building import BAND, Built, HeldOut, Recording, Segment, build
from haptic_accel.core.surfaces.texture import Provenance, Texture, TextureModel
from haptic_accel.core.topics import CONTACT_FORCE, SLAVE, SLAVE_ARM_FORCE
from haptic_accel.devices.playback import bag_track, is_bag
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.foreign import import_texture
from haptic_accel.materials.recordings import FULL_SCALE, read_recording
from haptic_accel.materials.texture_files import read_texture, write_texture

MILLI = 1e-3

SOUND_RATE = 8000
"""Sampling rate of sound files, Hz: the lowest that every player takes."""

MOST_DRAWN, MOST_LISTED = 6, 8
"""Spectra in one plot, and groups of segments in the table of a report."""

HELD_OUT = (
    Column("speed (mm/s)", lambda each: each.speed / MILLI, ".0f"),
    Column("force (N)", "force", ".2f"),
    Column("s", "seconds", ".2f"),
    Column("distance (dB)", "distance", ".2f"),
    Column("RMS (m/s²)", "rms", ".2f"),
    Column("model's", "modelled_rms", ".2f"),
)
"""Columns of the table of segments that a model was built without."""

_model_argument = click.argument("model", metavar="NAME|FILE")
_csv_rate = click.option(
    "--rate",
    type=float,
    default=0.0,
    show_default=False,
    metavar="HZ",
    help="Samples per second of CSV files; others state their own.",
)
_new_file = click.option("--out", type=FILE, metavar="FILE", required=True, help="File to write.")


@verb(
    "haptic-accel texture build drag1.csv drag2.csv --rate 10000 --out wood.yaml",
    "haptic-accel texture build bags/plywood --out plywood.yaml --json report.json",
    name="build",
)
@click.argument("recordings", type=FILE, metavar="CSV|BAG...", nargs=-1, required=True)
@_csv_rate
@_new_file
@json_option
def build_texture(
    recordings: Sequence[Path], rate: float, out: Path, json_file: Path | None
) -> None:
    """Build a texture model from recordings of a tool dragged over a surface.

    A CSV file has columns speed (mm/s), force (N) and acceleration or accel (m/s^2); speed is
    along the surface and force normal to it. In a bag z is normal to the surface, and the force
    is that of the contact or, where it was not recorded, that of the slave's arm. Beside the
    model a plot is written: spectra, measured and modelled, and the plane of speed and force.
    """
    check_writable(out, "out")
    read = [_bag(path) if is_bag(str(path)) else _csv(path, rate) for path in recordings]
    source = f"built from {', '.join(path.name for path in recordings)}"
    built = build(out.stem, read, Provenance(source))
    write_texture(out, built.model)
    picture = out.with_name(f"{out.stem}_report.png")  # `show` draws the model as NAME.png
    _draw(built.model, built.held_out, built.segments).savefig(picture, dpi=150)
    _print(built)
    print(f"model: {out}; it states no licence yet", f"plot: {picture}", sep="\n")
    metrics = {
        "order": built.order,
        "nodes": len(built.model.speeds),
        "held_out_spectral_distance_db": built.distance,
        "coverage": built.coverage,
        "held_out": [
            {
                "speed_m_s": each.speed,
                "force_n": each.force,
                "seconds": each.seconds,
                "distance_db": each.distance,
                "rms_m_s2": each.rms,
                "model_rms_m_s2": each.modelled_rms,
            }
            for each in built.held_out
        ],
        "refused": [asdict(each) for each in built.refused],
    }
    save(metrics, json_file)


@verb(
    "haptic-accel texture import Wood.xml --out wood.yaml",
    "haptic-accel texture import buzz.ahap --calibration 5 --out buzz.yaml",
    name="import",
)
@click.argument("file", type=FILE, metavar="FILE")
@_csv_rate
@click.option(
    "--calibration",
    type=float,
    metavar="M/S^2",
    show_default=False,
    help="Acceleration at full scale, where values are relative.",
)
@_new_file
def import_file(file: Path, rate: float, calibration: float | None, out: Path) -> None:
    """Make a texture model of another program's file.

    That is an XML file of the Penn Haptic Texture Toolkit; an acceleration as WAV, CSV or NPZ; a
    filter of noise as JSON; or a pattern, AHAP or .haptic, whose frequencies and strengths become
    a texture. Patterns and WAV files of whole numbers need a calibration.
    """
    check_writable(out, "out")
    model = import_texture(file, rate, calibration)
    write_texture(out, model)
    loudest = _rms(model).max()
    print(f"{out}: order {model.lsf.shape[1]}, {model.rate:g} Hz, up to {loudest:.2f} m/s^2 RMS")
    print(f"licence: {model.provenance.licence or 'none stated: that of the file'}")


@verb("haptic-accel texture show plywood", "haptic-accel texture show wood.yaml --out wood.png")
@_model_argument
@click.option("--out", type=FILE, metavar="FILE", show_default="NAME.png", help="Plot to write.")
@json_option
def show(model: str, out: Path | None, json_file: Path | None) -> None:
    """Show a model's provenance, range and spectra."""
    found = read_texture(preset_file("texture", model))
    order, moving = found.lsf.shape[1], found.ma_lsf.shape[1]
    rms = _rms(found)
    about = {name: text for name, text in asdict(found.provenance).items() if text}
    orders = f"{order} and {moving}" if moving else f"{order}"
    print(f"{printable(found.name)}: order {orders}, {found.rate:g} Hz")
    print(*(f"{name}: {text}" for name, text in about.items()), sep="\n")
    _print_nodes(found, rms)
    picture = out or Path(f"{found.name}.png")
    check_writable(picture, "out")
    _draw(found).savefig(picture, dpi=150)
    print(f"plot: {picture}")
    metrics = {
        "name": found.name,
        "rate_hz": found.rate,
        "order": order,
        "moving_average_order": moving,
        "nodes": len(found.speeds),
        "largest_speed_m_s": float(found.speeds.max()),
        "largest_force_n": float(found.forces.max()),
        "largest_rms_m_s2": float(rms.max()),
        "provenance": about,
    }
    save(metrics, json_file)


@verb("haptic-accel texture render plywood --speed 80 --force 1 --out wood.wav")
@_model_argument
@click.option(
    "--speed",
    type=click.FloatRange(0),
    required=True,
    metavar="MM/S",
    help="Speed along the surface.",
)
@click.option(
    "--force", type=click.FloatRange(0), required=True, metavar="N", help="Normal force."
)
@click.option("--seconds", type=click.FloatRange(0.1, 600), default=5.0, help="Duration.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of the noise.")
@_new_file
def render(model: str, speed: float, force: float, seconds: float, seed: int, out: Path) -> None:
    """Write the acceleration of a texture as a sound file.

    Full scale is 5 g, as that of recordings that are read.
    """
    from scipy.io import wavfile

    check_writable(out, "out")
    found = read_texture(preset_file("texture", model))
    texture = Texture(found, found.rate, seed, FULL_SCALE)
    # The speed's low-pass has settled after a tenth of a second.
    before, samples = round(0.2 * found.rate), round(seconds * found.rate)
    constant = np.ones(before + samples)
    acceleration = texture.block(constant * speed * MILLI, constant * force)[before:]
    sound = resampled(acceleration, found.rate, SOUND_RATE)
    full = np.iinfo(np.int16).max
    wavfile.write(
        out, SOUND_RATE, np.clip(sound / FULL_SCALE * full, -full, full).astype(np.int16)
    )
    print(
        f"{out}: {seconds:g} s, {acceleration.std():.3g} m/s^2 RMS, saturated {texture.saturated}"
    )
    top_speed, top_force = found.speeds.max(), found.forces.max()
    if speed * MILLI > top_speed or force > top_force:
        print(
            f"the model ends at {top_speed / MILLI:.0f} mm/s and {top_force:.2f} N: rendered there"
        )


# Recordings


def _csv(path: Path, rate: float) -> Recording:
    """Return the recording in a CSV file."""
    if not rate:
        raise ParameterError(f"rate = 0: must be given for a CSV file such as {path}, in Hz")
    checked_rate("rate", rate)
    speed, force, acceleration = (
        read_recording(path, rate, rate, column) for column in ("speed", "force", None)
    )
    return Recording(str(path), rate, np.abs(speed) * MILLI, force, acceleration)


def _bag(path: Path) -> Recording:
    """Return what a bag has of the slave: by its contact force, or else its arm's."""
    from haptic_accel.bags.reading import read_bag

    bag = read_bag(path)
    contact = CONTACT_FORCE.name in bag.signals
    # On the grid of its samples, as its position would be.
    track = bag_track(bag, replace(SLAVE, position=CONTACT_FORCE if contact else SLAVE_ARM_FORCE))
    pressing = track.position[:, 2] * (1 if contact else -1)
    speed = np.hypot(track.velocity[:, 0], track.velocity[:, 1])
    return Recording(str(path), track.rate, speed, pressing, track.acceleration)


# Results


def _print(built: Built) -> None:
    """Print how well segments are predicted that the model was built without."""
    low, high = BAND
    title = f"least well predicted by a model of the other half, {low:g} to {high:g} Hz"
    worst = sorted(built.held_out, key=lambda each: -each.distance)[:MOST_LISTED]
    print_results(HELD_OUT, worst, left=0, title=title)
    print(
        f"order {built.order}, {len(built.segments)} segments, measured nodes: {built.measured},"
        f" log-spectral distance {built.distance:.2f} dB; they cover {100 * built.coverage:.0f} %"
        f" of the plane to {built.model.speeds.max() / MILLI:.0f} mm/s and"
        f" {built.model.forces.max():.2f} N"
    )
    for reason in dict.fromkeys(each.reason for each in built.refused):
        seconds = sum(each.end - each.begin for each in built.refused if each.reason == reason)
        print(f"not used: {seconds:.2f} s {reason}")


def _print_nodes(model: TextureModel, rms: FloatArray) -> None:
    rows = [
        (f"{speed / MILLI:.0f}", f"{force:.2f}", f"{value:.2f}")
        for speed, force, value in sorted(zip(model.speeds, model.forces, rms, strict=True))
    ]
    print_table(("speed (mm/s)", "force (N)", "RMS (m/s²)"), rows, left=0, title="nodes")


def _rms(model: TextureModel) -> FloatArray:
    """Return the root mean square of the acceleration at each node, m/s^2."""
    frequency = np.linspace(0.0, model.rate / 2, 2048)
    spectra = [
        model.spectrum(speed, force, frequency)
        for speed, force in zip(model.speeds.tolist(), model.forces.tolist(), strict=True)
    ]
    return np.asarray(np.sqrt(np.mean(spectra, axis=1) * model.rate / 2))


def _draw(
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
    nodes = plane.scatter(speeds, model.forces, c=_rms(model), cmap="viridis", zorder=3)
    figure.colorbar(nodes, ax=plane, label="RMS (m/s²)")
    places = np.array([(each.speed / MILLI, each.force) for each in segments]).reshape(-1, 2)
    plane.plot(*places.T, ".", color="#d55e00", markersize=3, label="segments")
    plane.set(xlabel="speed (mm/s)", ylabel="force (N)")
    return figure


def _draw_compared(panel: Axes, held_out: Sequence[HeldOut]) -> None:
    """Draw what was measured, and what a model of other segments has there."""
    for number, each in enumerate(sorted(held_out, key=lambda e: -e.seconds)[:MOST_DRAWN]):
        colour, label = f"C{number}", f"{each.speed / MILLI:.0f} mm/s, {each.force:.2f} N"
        panel.plot(each.frequency, each.measured, color=colour, linewidth=0.8, label=label)
        panel.plot(each.frequency, each.modelled, "--", color=colour)
    panel.set_title("left-out segments: measured, and modelled (dashed)", fontsize=9)


def _draw_spectra(panel: Axes, model: TextureModel) -> None:
    """Draw the model's spectra at its loudest nodes; those at rest have none."""
    frequency = np.linspace(1.0, model.rate / 2, 500)
    rms = _rms(model)
    loudest = np.argsort(-rms)[: min(MOST_DRAWN, np.count_nonzero(rms))]
    for node in loudest.tolist():
        speed, force = float(model.speeds[node]), float(model.forces[node])
        label = f"{speed / MILLI:.0f} mm/s, {force:.2f} N"
        panel.plot(frequency, model.spectrum(speed, force, frequency), label=label)
