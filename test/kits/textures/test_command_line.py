# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Building, showing and rendering textures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from scipy.io import wavfile

from haptic_accel.bags.writing import write_trial
from haptic_accel.core.parameters import from_flat, warn_once
from haptic_accel.core.rig.slave_rig import SlaveRigParameters, SurfaceParameters
from haptic_accel.core.simulated_rig import RigParameters
from haptic_accel.core.trial import run_trial
from haptic_accel.materials.folders import config_folder
from haptic_accel.materials.recordings import read_recording
from haptic_accel.materials.texture_files import read_texture
from haptic_accel.setup.files import surface_parameters
from refusals import assert_refused, rows, written
from verbs import ODD_NAMES, next_command, output_of, refusal, status_of

pytestmark = pytest.mark.usefixtures("here")

RATE = 1000.0
SHIPPED = config_folder() / "textures"


def write_drag(path: Path, force: float) -> None:
    """Write a recording at two speeds of a texture whose acceleration grows with speed."""
    random = np.random.default_rng(round(100 * force))
    speed = np.repeat([60.0, 120.0], 1500)
    pole = 0.95 * np.exp(2j * np.pi * 100 / RATE)
    polynomial = np.poly([pole, pole.conj()]).real
    noise = random.standard_normal(len(speed)) * speed / 60 * force
    texture = signal.lfilter([1.0], polynomial, noise)
    rows = np.column_stack([speed, np.full(len(speed), force), texture])
    np.savetxt(path, rows, delimiter=",", header="speed,force,accel", comments="", fmt="%.6f")


@pytest.mark.smoke
def test_a_model_is_built_from_files_with_a_report(tmp_path: Path) -> None:
    for force in (0.5, 1.0):
        write_drag(tmp_path / f"{force}.csv", force)
    words = ("0.5.csv", "1.0.csv", "--rate", "1000", "--out", "wood.yaml", "--json", "report.json")
    assert status_of(*next_command(output_of("texture", "build", *words))) == 0
    assert (tmp_path / "wood.wav").is_file()
    model = read_texture(tmp_path / "wood.yaml")
    assert model.name == "wood"
    assert model.provenance.source == "built from 0.5.csv, 1.0.csv"
    # Columns are in mm/s and N.
    assert (model.speeds.max(), model.forces.max()) == (0.12, 1.0)
    frequency = np.linspace(20.0, 450.0, 100)
    assert frequency[model.spectrum(0.12, 1.0, frequency).argmax()] == pytest.approx(100, abs=5)
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["order"], report["nodes"]) == (model.lsf.shape[1], len(model.speeds))
    assert report["held_out_spectral_distance_db"] < 1.5
    assert report["coverage"] == pytest.approx(0.25, abs=0.01)
    assert report["refused"] == []
    assert report["follows_speed_and_force"] is True
    assert report["following"]["rms_error"] < report["following"]["constant_rms_error"]
    picture = (tmp_path / "wood_report.png").read_bytes()
    assert len(picture) > 10_000
    assert status_of("texture", "show", "wood.yaml") == 0
    assert (tmp_path / "wood_report.png").read_bytes() == picture
    assert (tmp_path / "wood.png").read_bytes() != picture


def test_signs_of_speed_and_force_do_not_change_a_model(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    warn_once.cache_clear()
    write_drag(tmp_path / "drag.csv", 1.0)
    rows = np.loadtxt(tmp_path / "drag.csv", delimiter=",", skiprows=1)
    rows[:, 0] *= np.repeat([1.0, -1.0], len(rows) // 2)  # forth and back
    rows[:, 1] *= -1.0
    np.savetxt(tmp_path / "back.csv", rows, "%.6f", ",", header="speed,force,accel", comments="")
    for name in ("drag", "back"):
        words = (f"{name}.csv", "--rate", "1000", "--out", f"{name}.yaml")
        assert status_of("texture", "build", *words) == 0
    one, other = (read_texture(tmp_path / f"{name}.yaml") for name in ("drag", "back"))
    assert np.array_equal(one.deviation, other.deviation)
    assert np.array_equal(one.forces, other.forces)
    assert caplog.messages == ["back.csv: force is negative in contact: taken as pressing"]


def test_three_axes_are_reduced_to_one_with_the_power_of_all(tmp_path: Path) -> None:
    write_drag(tmp_path / "one.csv", 1.0)
    rows = np.loadtxt(tmp_path / "one.csv", delimiter=",", skiprows=1)
    # The same vibration along a slanted direction, whose first two components cancel in a sum.
    three = np.column_stack([rows[:, :2], np.outer(rows[:, 2], [0.48, -0.48, 0.73])])
    header = "speed,force,ax,ay,az"
    np.savetxt(tmp_path / "three.csv", three, delimiter=",", header=header, comments="")
    axes = ("--axes", "ax,ay,az")
    for name, words in (
        ("one", ()),
        ("three", axes),
        ("along", (*axes, "--reduction", "principal")),
        ("sum", (*axes, "--reduction", "sum")),
    ):
        file = "one.csv" if name == "one" else "three.csv"
        given = (file, *words, "--rate", "1000", "--out", f"{name}.yaml")
        assert status_of("texture", "build", *given) == 0
    names = ("one", "three", "along", "sum")
    rms = {name: read_texture(tmp_path / f"{name}.yaml").rms.max() for name in names}
    assert rms["three"] == pytest.approx(rms["one"], rel=0.02)
    assert rms["along"] == pytest.approx(rms["one"], rel=0.02)
    assert rms["sum"] == pytest.approx(0.73 * rms["one"], rel=0.02)


def test_a_recording_that_shows_no_change_with_speed_and_force_is_called_so(
    tmp_path: Path,
) -> None:
    noise = np.random.default_rng(0).normal(size=3000)
    rows = np.column_stack([np.tile([100.0, 1.0], (3000, 1)), noise])
    np.savetxt(tmp_path / "one.csv", rows, delimiter=",", header="speed,force,accel", comments="")
    words = ("one.csv", "--rate", "1000", "--out", "one.yaml", "--json", "one.json")
    shown = output_of("texture", "build", *words)
    assert "does not follow speed and force: no better than" in shown
    assert json.loads((tmp_path / "one.json").read_text())["follows_speed_and_force"] is False


def test_a_glitch_of_the_force_sensor_does_not_change_the_model(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    warn_once.cache_clear()
    for force in (0.5, 1.0):
        write_drag(tmp_path / f"{force}.csv", force)
    words = ("--rate", "1000", "--out")
    assert status_of("texture", "build", "0.5.csv", "1.0.csv", *words, "good.yaml") == 0
    assert not caplog.messages
    lines = (tmp_path / "1.0.csv").read_text().splitlines()
    speed, _, acceleration = lines[1200].split(",")
    lines[1200] = f"{speed},36870,{acceleration}"
    (tmp_path / "bad.csv").write_text("\n".join(lines))
    assert status_of("texture", "build", "0.5.csv", "bad.csv", *words, "bad.yaml") == 0
    outlier = "bad.csv: force: 1 of 3000 samples are outliers: replaced by interpolation"
    assert caplog.messages == [outlier]
    good, bad = (read_texture(tmp_path / name) for name in ("good.yaml", "bad.yaml"))
    assert np.array_equal(good.deviation, bad.deviation)
    assert np.array_equal(good.forces, bad.forces)


def test_silence_is_rendered_as_silence(tmp_path: Path) -> None:
    words = ("plywood", "--speed", "0", "--force", "1", "--out", "ply.wav", "--seconds", "2")
    assert status_of("texture", "render", *words) == 0
    sound = read_recording(tmp_path / "ply.wav", 0.0, RATE)
    assert len(sound) == 2 * RATE
    assert not sound.any()


def test_a_model_is_shown(tmp_path: Path) -> None:
    assert "licence: Apache-2.0" in output_of("texture", "show", "vinyl", "--json", "vinyl.json")
    about = json.loads((tmp_path / "vinyl.json").read_text())
    assert about["name"] == "vinyl"
    assert about["largest_rms_m_s2"] > 1.0
    assert (tmp_path / "vinyl.png").stat().st_size > 10_000


def test_a_bag_is_a_recording(tmp_path: Path) -> None:
    surface = from_flat(SurfaceParameters, surface_parameters("plywood"), "simulated.surface.")
    rig = RigParameters(slave=SlaveRigParameters(surface=surface))
    write_trial(tmp_path / "ply", run_trial("none", rig, duration=4.0), {}, 0)
    assert status_of("texture", "build", "ply", "--out", "ply.yaml", "--json", "ply.json") == 0
    model, built = read_texture(tmp_path / "ply.yaml"), read_texture(SHIPPED / "plywood.yaml")
    # The scripted hand strokes at 0.1 m/s.
    assert 0.1 < model.speeds.max() < 0.13
    band = np.linspace(20, 450, 500)
    rms = [np.sqrt(each.spectrum(0.09, 1.0, band).mean()) for each in (model, built)]
    assert rms[0] == pytest.approx(rms[1], rel=0.3)
    refused = json.loads((tmp_path / "ply.json").read_text())["refused"]
    assert "out of contact" in {each["reason"] for each in refused}


@pytest.mark.parametrize("name", ["plywood", "text", "vinyl"])
def test_shipped_textures_state_their_licence_and_are_small(name: str) -> None:
    file = SHIPPED / f"{name}.yaml"
    assert file.stat().st_size < 60_000
    about = read_texture(file).provenance
    assert about.licence == "Apache-2.0"
    assert about.source
    assert about.author
    assert about.calibration


def test_what_was_rendered_is_imported_with_its_strength(tmp_path: Path) -> None:
    words = ("plywood", "--speed", "110", "--force", "1", "--seconds", "10", "--out", "ply.wav")
    assert status_of("texture", "render", *words) == 0
    missing = "calibration = nothing: must be"
    assert missing in refusal("texture", "import", "ply.wav", "--out", "a.yaml")
    words = ("ply.wav", "--calibration", str(5 * 9.80665), "--out", "again.yaml")
    assert "licence: none stated" in output_of("texture", "import", *words)
    frequency = np.linspace(40.0, 450.0, 200)
    first, again = (
        read_texture(path).spectrum(0.11, 1.0, frequency)
        for path in (config_folder() / "textures" / "plywood.yaml", tmp_path / "again.yaml")
    )
    assert np.sqrt(np.mean((10 * np.log10(again / first)) ** 2)) < 2.0


def test_names_in_files_are_escaped(here: Path) -> None:  # the figure is named as the texture
    hostile = "\x1b]0;title\x07\x1b[2J\x9b31m\u202egnp.exe\u2066\r\udcff"
    content = {"name": hostile, "sample_rate": 1000.0, "b": [1.0], "a": [1.0]}
    (here / "f.json").write_text(json.dumps(content))
    assert status_of("texture", "import", here / "f.json", "--out", here / "f.npz") == 0
    said = output_of("texture", "show", here / "f.npz")
    assert said.startswith(r"\x1b]0;title\x07\x1b[2J\x9b31m\u202egnp.exe\u2066\r?: order ")
    assert said.replace("\n", "").isprintable()


@pytest.mark.parametrize("name", ODD_NAMES)
def test_a_wave_is_written_to_a_folder_of_an_odd_name(here: Path, name: str) -> None:
    render = ("texture", "render", "plywood", "--speed", "80", "--force", "1")
    (here / name).mkdir()
    assert status_of(*render, "--out", here / name / "wood.wav") == 0
    assert (here / name / "wood.wav").stat().st_size


SAMPLES = "".join(f"{index},60,1,{index % 7}\n" for index in range(2000))

FILES = {
    "axis.csv": f"t [ms],speed,force,ax [g]\n{SAMPLES}",
    "drag.csv": f"index,speed,force,accel\n{SAMPLES}",
    "numbers.csv": "60,1,0.5\n" * 2000,
    "slow.csv": "force,accel\n1,2\n",
    "timed.csv": f"t [ms],speed,force,accel\n{SAMPLES}",
}
"""Text of files in the working folder."""

REFUSED = {
    "texture build drag.csv --out a.yaml": "rate = 0: must be given for a CSV file ...",
    "texture build text --rate 500 --out a.yaml": "rate = 500: a bag states its own: leave ...",
    "texture build text --axes x,y,z --out a.yaml": "axes = x,y,z: a bag states its own: ...",
    "texture build no.csv --rate 1000 --out a.yaml": "no.csv: No such file or directory, ...",
    "texture build drag.csv --rate 100 --out a.yaml": "...must be at least 500 Hz...",
    "texture build drag.csv --rate 1000": "Missing option ...--out...",
    "texture build drag.csv --rate 1000 --out no/a.yaml": "out = 'no/a.yaml': No such file ...",
    "texture build drag.csv --rate 1000 --axes a,b --out a.yaml": "axes = a,b: must be 3 ...",
    "texture build drag.wav --out a.yaml": "drag.wav: is a WAV file, must be a CSV file ...",
    "texture build timed.csv --rate 2000 --out a.yaml": (
        "timed.csv: column t [ms] says 1000 Hz, rate = 2000: must agree"
    ),
    "texture import axis.csv --out a.yaml": (
        "axis.csv: column = acceleration or ...: no such column; there are t [ms], ..., ax [g]"
    ),
    "texture build axis.csv --out a.yaml": (
        "axis.csv: ...there are t [ms], speed, force, ax [g]; choose one with --axes X,Y,Z"
    ),
    "texture build slow.csv --rate 1000 --out a.yaml": (
        "slow.csv: column = speed: no such column; there are force, accel"
    ),
    "texture build numbers.csv --rate 1000 --out a.yaml": (
        "numbers.csv: has no titles, but columns 1, 2, 3: add titles"
    ),
    "texture show oak": "texture = 'oak': must be one of plywood, text, vinyl, ...",
    "texture render vinyl --speed -1 --force 1 --out a.wav": "...--speed...: -1.0 is not in ...",
}
"""Line of each command line, in which ... stands for any text."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the command lines name."""
    folder = written(tmp_path_factory.mktemp("folder"), FILES)
    wavfile.write(folder / "drag.wav", 1000, np.zeros(2000))
    return folder


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
