# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel texture``: build texture models, import, show and render them, with reports."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_accel import (
    FloatArray,
    ParameterError,
    Provenance,
    Texture,
    TextureModel,
    commands,
    preset_file,
    read_texture,
    resampled,
)
from haptic_accel.core import REDUCTIONS, records
from haptic_accel.core.parameters import printable, warn_once
from haptic_accel.core.topics import CONTACT_FORCE, SLAVE, SLAVE_ARM_FORCE
from haptic_accel.devices import bag_track, is_bag
from haptic_accel.kits.textures.building import BAND, Built, HeldOut, Recording, Segment, build
from haptic_accel.kits.textures.foreign import import_texture
from haptic_accel.materials import write_texture
from haptic_accel.materials.columns import COLUMNS, FORCE, SPEED, ColumnChoice, Wording
from haptic_accel.materials.recordings import AXES, FULL_SCALE, cleaned, read_columns, warn_unlike

MILLI = 1e-3

MOST_DRAWN, MOST_LISTED = 6, 8
"""Maximum number of spectra in a plot, and of groups of segments in a report's table."""

HELD_OUT = (
    commands.Column("speed_m_s", "speed", "mm/s", 0, lambda each: each.speed, 1 / MILLI),
    commands.Column("force_n", "force", "N", 2, lambda each: each.force),
    commands.Column("seconds", "s", digits=2),
    commands.Column("distance_db", "distance", "dB", 2, lambda each: each.distance),
    commands.Column("rms_m_s2", "RMS", "m/s²", 2, lambda each: each.rms),
    commands.Column("model_rms_m_s2", "model's", "", 2, lambda each: each.modelled_rms),
)
"""Columns of the table of held-out segments."""

NODES = (
    commands.Column("speed_m_s", "speed", "mm/s", 0, factor=1 / MILLI),
    commands.Column("force_n", "force", "N", 2),
    commands.Column("rms_m_s2", "RMS", "m/s²", 2),
)
"""Columns of the table of a model's nodes."""


def held_out_table(built: Built) -> commands.ResultTable:
    """Return the prediction errors of held-out segments, the largest first."""
    low, high = BAND
    title = f"least well predicted by a model of the other half, {low:g} to {high:g} Hz"
    worst = sorted(built.held_out, key=lambda each: -each.distance)[:MOST_LISTED]
    return commands.ResultTable.of(HELD_OUT, worst, title=title, left=0)


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


def nodes_table(model: TextureModel) -> commands.ResultTable:
    """Return the nodes of a model."""
    nodes = sorted(zip(model.speeds, model.forces, model.rms, strict=True))
    rows = [dict(zip((each.key for each in NODES), node, strict=True)) for node in nodes]
    return commands.ResultTable.of(NODES, rows, title="nodes", left=0)


def draw(
    model: TextureModel, held_out: Sequence[HeldOut] = (), segments: Sequence[Segment] = ()
) -> Figure:
    """Draw the spectra, and the plane of speed and force with its triangles."""
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


SOUND_RATE = 8000
"""Sampling rate of sound files, Hz: the lowest that every player supports."""

_model_argument = click.argument("model", metavar="NAME|FILE")
_csv_rate = click.option(
    "--rate",
    type=float,
    default=0.0,
    show_default=False,
    metavar="HZ",
    help="Sampling rate of CSV files without a column of times, Hz; other files state theirs.",
)
_new_file = click.option(
    "--out", type=commands.FILE, metavar="FILE", required=True, help="File to write."
)


@commands.verb(
    "haptic-accel texture build drag1.csv drag2.csv --rate 10000 --out wood.yaml",
    "haptic-accel texture build bags/plywood --out plywood.yaml --json report.json",
    name="build",
)
@click.argument("recordings", type=commands.FILE, metavar="CSV|BAG...", nargs=-1, required=True)
@_csv_rate
@click.option(
    "--axes",
    type=commands.listed_words,
    default="",
    show_default=False,
    metavar="X,Y,Z",
    help="Columns of CSV files with the acceleration in three axes, in place of one column.",
)
@click.option(
    "--reduction",
    type=click.Choice([*REDUCTIONS]),
    default=next(iter(REDUCTIONS)),
    help="Reduction of the three axes to one signal; dft321 keeps the power of all of them.",
)
@_new_file
@commands.json_option
def build_texture(
    recordings: Sequence[Path],
    rate: float,
    axes: Sequence[str],
    reduction: str,
    out: Path,
    json_file: Path | None,
) -> None:
    """Build a texture model from recordings of a tool dragged over a surface.

    A CSV file has columns speed (mm/s), force (N) and acceleration or accel (m/s^2), or another
    unit in the title, such as force [mN]; speed is along the surface and force normal to it; with
    --axes, the three columns named there are reduced to one signal. In a bag z is normal to the
    surface, and the force is that of the contact or, where it was not recorded, that of the
    slave's arm. Glitches of sensors are counted and replaced. Beside the model a plot is written:
    spectra, measured and modelled, and the plane of speed and force.
    """
    commands.check_writable(out, "out")
    if all(is_bag(str(path)) for path in recordings):
        for name, given in (("rate", f"{rate:g}" if rate else ""), ("axes", ",".join(axes))):
            if given:
                raise ParameterError(f"{name} = {given}: a bag states its own: leave it out")
    if axes and len(set(axes)) != AXES:
        raise ParameterError(f"axes = {','.join(axes)}: must be {AXES} different columns")
    read = [
        _bag(path) if is_bag(str(path)) else _csv(path, rate, axes, REDUCTIONS[reduction])
        for path in recordings
    ]
    names = ", ".join(each.name for each in recordings)
    built = build(out.stem, read, Provenance(f"built from {names}"))
    write_texture(out, built.model)
    picture = out.with_name(f"{out.stem}_report.png")  # `show` draws the model as NAME.png
    draw(built.model, built.held_out, built.segments).savefig(picture, dpi=150)
    commands.print_table(held_out_table(built))
    print(*described(built), sep="\n")
    print(f"model: {out}, without a licence so far", f"plot: {picture}", sep="\n")
    metrics = {
        "order": built.order,
        "nodes": len(built.model.speeds),
        "held_out_spectral_distance_db": built.distance,
        "coverage": built.coverage,
        "following": asdict(built.following),
        "follows_speed_and_force": built.following.better,
        "held_out": records(HELD_OUT, built.held_out),
        "refused": [asdict(each) for each in built.refused],
    }
    commands.save(metrics, json_file)
    print(_rendering(built.model, out))


def _rendering(model: TextureModel, file: Path) -> str:
    """Return the line with the command that plays a model in the middle of its range."""
    speed, force = f"{np.median(model.speeds) / MILLI:.3g}", f"{np.median(model.forces):.3g}"
    words = (str(file), "--speed", speed, "--force", force, "--out", str(file.with_suffix(".wav")))
    return commands.next_command("texture", "render", *words)


@commands.verb(
    "haptic-accel texture import Wood.xml --out wood.yaml",
    "haptic-accel texture import buzz.ahap --calibration 5 --out buzz.yaml",
    name="import",
)
@click.argument("file", type=commands.FILE, metavar="FILE")
@_csv_rate
@click.option(
    "--calibration",
    type=float,
    metavar="M/S^2",
    show_default=False,
    help="Acceleration at full scale, m/s^2, for a file with relative values.",
)
@_new_file
def import_file(file: Path, rate: float, calibration: float | None, out: Path) -> None:
    """Make a texture model of another program's file.

    That is an XML file of the Penn Haptic Texture Toolkit; an acceleration as WAV, CSV or NPZ; a
    filter of noise as JSON; or a pattern, AHAP or .haptic, whose frequencies and strengths become
    a texture. Patterns and WAV files of whole numbers need a calibration.
    """
    commands.check_writable(out, "out")
    model = import_texture(file, rate, calibration)
    write_texture(out, model)
    loudest = model.rms.max()
    print(f"{out}: order {model.lsf.shape[1]}, {model.rate:g} Hz, at most {loudest:.2f} m/s^2 RMS")
    print(f"licence: {model.provenance.licence or 'none stated: that of the file'}")
    print(_rendering(model, out))


@commands.verb(
    "haptic-accel texture show plywood", "haptic-accel texture show wood.yaml --out wood.png"
)
@_model_argument
@click.option(
    "--out", type=commands.FILE, metavar="FILE", show_default="NAME.png", help="Plot to write."
)
@commands.json_option
def show(model: str, out: Path | None, json_file: Path | None) -> None:
    """Show a model's provenance, range and spectra."""
    found = read_texture(preset_file("texture", model))
    order, moving = found.lsf.shape[1], found.ma_lsf.shape[1]
    about = {name: text for name, text in asdict(found.provenance).items() if text}
    orders = f"{order} and {moving}" if moving else f"{order}"
    print(f"{printable(found.name)}: order {orders}, {found.rate:g} Hz")
    print(*(f"{name}: {text}" for name, text in about.items()), sep="\n")
    commands.print_table(nodes_table(found))
    picture = out or Path(f"{found.name}.png")
    commands.check_writable(picture, "out")
    draw(found).savefig(picture, dpi=150)
    print(f"plot: {picture}")
    metrics = {
        "name": found.name,
        "rate_hz": found.rate,
        "order": order,
        "moving_average_order": moving,
        "nodes": len(found.speeds),
        "largest_speed_m_s": float(found.speeds.max()),
        "largest_force_n": float(found.forces.max()),
        "largest_rms_m_s2": float(found.rms.max()),
        "provenance": about,
    }
    commands.save(metrics, json_file)


@commands.verb("haptic-accel texture render plywood --speed 80 --force 1 --out wood.wav")
@_model_argument
@click.option(
    "--speed",
    type=click.FloatRange(0),
    required=True,
    metavar="MM/S",
    help="Speed along the surface, mm/s.",
)
@click.option(
    "--force", type=click.FloatRange(0), required=True, metavar="N", help="Normal force, N."
)
@click.option("--seconds", type=click.FloatRange(0.1, 600), default=5.0, help="Duration, s.")
@_new_file
def render(model: str, speed: float, force: float, seconds: float, out: Path) -> None:
    """Write the acceleration of a texture as a sound file.

    Full scale is 5 g, as that of recordings that are read.
    """
    from scipy.io import wavfile

    commands.check_writable(out, "out")
    found = read_texture(preset_file("texture", model))
    texture = Texture(found, found.rate, 0, FULL_SCALE)
    # The low-pass of the speed settles within a tenth of a second.
    before, samples = round(0.2 * found.rate), round(seconds * found.rate)
    constant = np.ones(before + samples)
    acceleration = texture.block(constant * speed * MILLI, constant * force)[before:]
    sound = resampled(acceleration, found.rate, SOUND_RATE)
    scaled = np.clip(sound / FULL_SCALE, -1, 1) * np.iinfo(np.int16).max
    wavfile.write(out, SOUND_RATE, scaled.astype(np.int16))
    rms = acceleration.std()
    print(f"{out}: {seconds:g} s, {rms:.3g} m/s^2 RMS, saturated {texture.saturated}")
    top_speed, top_force = found.speeds.max(), found.forces.max()
    if speed * MILLI > top_speed or force > top_force:
        print(f"rendered at the model's limits: {top_speed / MILLI:.0f} mm/s, {top_force:.2f} N")


# Recordings


def _csv(
    path: Path, rate: float, axes: Sequence[str], reduced: Callable[[FloatArray], FloatArray]
) -> Recording:
    """Return the recording in a CSV file; three axes are reduced to one."""
    columns = [ColumnChoice(("speed",), SPEED), ColumnChoice(("force",), FORCE)]
    columns += [ColumnChoice((name,)) for name in axes] or [ColumnChoice(COLUMNS)]
    samples, own_rate = read_columns(path, rate, columns, Wording("rate", "--axes X,Y,Z"))
    speed, force, *found = samples.T
    warn_unlike({f"{path}: {name}": each for name, each in zip(axes, found, strict=False)})
    if -force.min() > force.max():
        warn_once(f"{path}: force is negative in contact: taken as pressing")
        force = -force
    acceleration = reduced(np.column_stack(found)) if axes else found[0]
    return Recording(str(path), own_rate, speed, force, acceleration)


def _bag(path: Path) -> Recording:
    """Return the slave's recording in a bag, with the contact force or else the arm force."""
    from haptic_accel.bags import read_bag_with_warnings

    bag = read_bag_with_warnings(path)
    contact = CONTACT_FORCE.name in bag.signals
    # Put the force on the grid of its samples, as a position would be.
    track = bag_track(bag, replace(SLAVE, position=CONTACT_FORCE if contact else SLAVE_ARM_FORCE))
    pressing = track.position[:, 2] * (1 if contact else -1)
    speed = np.hypot(track.velocity[:, 0], track.velocity[:, 1])
    columns = {"speed": speed, "force": pressing, "acceleration": track.acceleration}
    signals = (cleaned(f"{path}: {name}", each, track.rate) for name, each in columns.items())
    return Recording(str(path), track.rate, *signals)
