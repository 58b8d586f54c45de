# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Textures from other programs' files: their spectrum in m/s^2, and what each file must have."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kits.textures.hatt_file import hatt_file
from scipy import signal
from scipy.io import wavfile

from fuzzing import fuzz_few, measured
from haptic_accel.core.model import GRAVITY, FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.texture import Texture, TextureModel, is_ordered, to_polynomial
from haptic_accel.kits.textures import foreign
from nightly import rest_slow

PATTERN_RATE = 2000.0


def pattern_file(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def event(kind: str, time: float, intensity: float, sharpness: float, **more: float) -> Any:
    parameters = [
        {"ParameterID": "HapticIntensity", "ParameterValue": intensity},
        {"ParameterID": "HapticSharpness", "ParameterValue": sharpness},
    ]
    own = {"Time": time, "EventType": f"Haptic{kind}", "EventParameters": parameters, **more}
    return {"Event": own}


def curve(kind: str, *points: tuple[float, float]) -> Any:
    listed = [{"Time": time, "ParameterValue": value} for time, value in points]
    own = {"ParameterID": kind, "Time": 0.0, "ParameterCurveControlPoints": listed}
    return {"ParameterCurve": own}


def frequency(wave: FloatArray) -> float:
    """Return the frequency of the strongest line, Hz."""
    spectrum = np.abs(np.fft.rfft(wave * np.hanning(len(wave)), 1 << 16))
    return float(np.argmax(spectrum)) * PATTERN_RATE / (1 << 16)


def amplitude(wave: FloatArray) -> float:
    return float(np.sqrt(2 * np.mean(wave**2)))


def part(wave: FloatArray, begin: float, end: float) -> FloatArray:
    return wave[round(begin * PATTERN_RATE) : round(end * PATTERN_RATE)]


def test_an_ahap_has_its_events_and_curves(tmp_path: Path) -> None:
    pattern = [
        event("Transient", 0.0, 0.8, 0.0),
        event("Continuous", 0.5, 0.6, 0.5, EventDuration=1.0),
        curve("HapticIntensityControl", (0.4, 1.0), (1.0, 1.0), (1.01, 0.5)),
        curve("HapticSharpnessControl", (0.4, 0.0), (1.0, 0.0), (1.01, 0.5)),
        {"Event": {"Time": 0.0, "EventType": "AudioCustom"}},
    ]
    file = pattern_file(tmp_path / "a.ahap", {"Version": 1.0, "Pattern": pattern})
    wave = foreign.read_pattern(file, PATTERN_RATE)
    assert len(wave) == 1.5 * PATTERN_RATE
    assert 0.4 < np.abs(part(wave, 0.0, 0.02)).max() < 0.8
    assert not part(wave, 0.1, 0.5).any()
    middle = (foreign.DULLEST + foreign.SHARPEST) / 2
    assert amplitude(part(wave, 0.5, 1.0)) == pytest.approx(0.6, rel=0.01)
    assert frequency(part(wave, 0.5, 1.0)) == pytest.approx(middle, abs=1.0)
    assert amplitude(part(wave, 1.05, 1.5)) == pytest.approx(0.3, rel=0.01)
    assert frequency(part(wave, 1.05, 1.5)) == pytest.approx(foreign.SHARPEST, abs=1.0)


def haptic(amplitudes: list[Any], frequencies: list[Any]) -> Any:
    envelopes = {"amplitude": amplitudes, "frequency": frequencies}
    return {"version": {"major": 1}, "signals": {"continuous": {"envelopes": envelopes}}}


def test_a_haptic_file_has_its_envelopes_and_emphasis(tmp_path: Path) -> None:
    amplitudes = [
        {"time": 0.0, "amplitude": 0.4},
        {"time": 0.5, "amplitude": 0.4},
        {"time": 0.51, "amplitude": 0.0, "emphasis": {"amplitude": 1.0, "frequency": 0.0}},
        {"time": 1.0, "amplitude": 0.0},
    ]
    content = haptic(amplitudes, [{"time": 0.0, "frequency": 1.0}])
    wave = foreign.read_pattern(pattern_file(tmp_path / "a.haptic", content), PATTERN_RATE)
    assert amplitude(part(wave, 0.0, 0.5)) == pytest.approx(0.4, rel=0.01)
    assert frequency(part(wave, 0.0, 0.5)) == pytest.approx(foreign.SHARPEST, abs=1.0)
    assert np.abs(part(wave, 0.51, 0.53)).max() > 0.4
    assert not part(wave, 0.55, 1.0).any()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], "Pattern = nothing"),
        ({"Pattern": {}}, r"Pattern = {}: must be a list"),
        ({"Pattern": []}, "silent"),
        ({"Pattern": [event("Continuous", 0.0, 1.0, 0.5)]}, r"Event.EventDuration = nothing"),
        (
            {"Pattern": [event("Transient", -1.0, 1.0, 0.5)]},
            r"Time = -1.0: must be from 0 to 60 s",
        ),
        ({"Pattern": [event("Transient", 0.0, 9.0, 0.5)]}, r"ParameterValue = 9.0: must be from"),
        *((text, "must be JSON: ") for text in (b"{", b"\xff", b"[" * 100_000)),
    ],
)
def test_a_wrong_pattern_is_refused_in_one_line(tmp_path: Path, content: Any, words: str) -> None:
    path = tmp_path / "wrong.ahap"
    path.write_bytes(content) if isinstance(content, bytes) else pattern_file(path, content)
    with pytest.raises(ParameterError, match=rf"^{path}: .*{words}") as raised:
        foreign.read_pattern(path, PATTERN_RATE)
    assert str(raised.value).isprintable()


SPEED, FORCE = (float(value) for value in foreign.REFERENCE)
BAND = np.linspace(40.0, 450.0, 200)

# Resonances at 120 and 300 Hz of a filter at 1 kHz.
RESONANCES = np.array([0.95 * np.exp(2j * np.pi * 0.12), 0.9 * np.exp(2j * np.pi * 0.3)])
A = np.poly(np.concatenate([RESONANCES, RESONANCES.conj()])).real


def noise(rate: float, seconds: float = 30.0, seed: int = 3) -> FloatArray:
    """Return white noise through the filter, at a rate that is a multiple of 1 kHz."""
    white = np.random.default_rng(seed).standard_normal(round(seconds * 1000))
    wave = np.asarray(signal.lfilter([0.5], A, white))
    return np.asarray(signal.resample(wave, round(len(wave) * rate / 1000)))


def level(density: FloatArray) -> FloatArray:
    return 10 * np.log10(density)


def theory(scale: float = 1.0) -> FloatArray:
    """Return the one-sided power density of the filter's output, (m/s^2)^2/Hz."""
    _, response = signal.freqz([0.5 * scale], A, BAND, fs=1000.0)
    return np.asarray(np.abs(response) ** 2 * 2 / 1000.0)


def distance(model: TextureModel, density: FloatArray) -> float:
    """Return the log-spectral distance within the band, dB."""
    own = model.spectrum(SPEED, FORCE, BAND)
    return float(np.sqrt(np.mean((level(own) - level(density)) ** 2)))


def write_filter(path: Path, **changed: Any) -> Path:
    content = {"name": "oak", "method": "lpc", "sample_rate": 1000.0, "b": [0.5], "a": A.tolist()}
    path.write_text(json.dumps({**content, **changed}))
    return path


def test_a_filter_is_taken_exactly(tmp_path: Path) -> None:
    model = foreign.import_texture(write_filter(tmp_path / "f.json"))
    assert (model.name, model.rate) == ("oak", 1000.0)
    assert model.provenance.source == "f.json"
    assert distance(model, theory()) < 0.01
    louder = foreign.import_texture(tmp_path / "f.json", calibration=3.0)
    assert distance(louder, theory(3.0)) < 0.01
    assert louder.provenance.calibration == "3 m/s^2 at 1"


def test_a_filter_with_zeros_is_followed(tmp_path: Path) -> None:
    b = np.poly([0.8 * np.exp(1j), 0.8 * np.exp(-1j), 1.2]).real
    model = foreign.import_texture(write_filter(tmp_path / "f.json", b=b.tolist()))
    _, response = signal.freqz(b, A, BAND, fs=1000.0)
    assert distance(model, np.abs(response) ** 2 * 2 / 1000.0) < 0.3


@pytest.mark.parametrize("rate", [1000.0, 8000.0])
def test_a_csv_file_has_its_spectrum_in_metres(tmp_path: Path, rate: float) -> None:
    path = tmp_path / "drag.csv"
    rows = "\n".join(f"{value:.6g}" for value in noise(rate))
    path.write_text(f"acceleration\n{rows}\n")
    model = foreign.import_texture(path, rate=rate)
    assert model.rate == 1000.0
    assert distance(model, theory()) < 1.0


def test_a_wav_file_is_calibrated(tmp_path: Path) -> None:
    wave = noise(8000.0)
    peak = float(np.abs(wave).max())
    path = tmp_path / "drag.wav"
    whole, exact = np.int16(wave / peak * 30000), np.float32(wave / peak)
    for samples, full_scale in ((whole, peak * 32768 / 30000), (exact, peak)):
        wavfile.write(path, 8000, samples)
        with pytest.raises(ParameterError, match=rf"^{path}: calibration = nothing: .*m/s\^2"):
            foreign.import_texture(path)
        assert distance(foreign.import_texture(path, calibration=full_scale), theory()) < 1.0


def three_axes(path: Path, names: list[str], **others: Any) -> Path:
    axes = [0.6 * noise(2000.0, seed=1), 0.8 * noise(2000.0, seed=2)]
    data = np.array([*axes, np.arange(len(axes[0])) / 2000.0])
    np.savez(path, data=data, **{"sample_rate": 2000, "channel_names": names, **others})
    return path


def test_units_of_the_channels_of_an_npz_file_are_converted(tmp_path: Path) -> None:
    path = three_axes(tmp_path / "drag.npz", ["acc_x [g]", "acc_y [g]", "t"])
    assert distance(foreign.import_texture(path), theory(9.80665)) < 1.0
    with pytest.raises(ParameterError, match=r"^calibration = 2: .*has units, acc_x \[g\]"):
        foreign.import_texture(path, calibration=2.0)
    three_axes(path, ["acc_x [V]", "acc_y", "t"])
    with pytest.raises(ParameterError, match=r"column acc_x \[V\] is in V: must be in"):
        foreign.import_texture(path)


def test_times_of_an_npz_file_must_agree_with_its_rate(tmp_path: Path) -> None:
    path = three_axes(tmp_path / "drag.npz", ["acc_x", "acc_y", "t"], sample_rate=4000)
    match = "channel t says 2000 Hz, sample_rate = 4000: must agree"
    with pytest.raises(ParameterError, match=match):
        foreign.import_texture(path)


def test_other_arrays_of_an_npz_file_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = three_axes(tmp_path / "drag.npz", ["acc_x", "acc_y", "t"], units="g", gain=3.0)
    foreign.import_texture(path)
    assert caplog.messages == [f"{path}: units, gain: not read"]


def test_a_rate_that_contradicts_that_of_a_file_is_refused(tmp_path: Path) -> None:
    npz = three_axes(tmp_path / "drag.npz", ["acc_x", "acc_y", "t"])
    wavfile.write(tmp_path / "drag.wav", 2000, np.zeros(4000, np.int16))
    xml = written(tmp_path / "slate.xml", hatt_file())
    json_file = write_filter(tmp_path / "f.json")
    for path, rate in ((npz, 2000), (tmp_path / "drag.wav", 2000), (xml, 1000), (json_file, 1000)):
        calibration = 5.0 if path.suffix == ".wav" else None
        with pytest.raises(ParameterError, match=f"rate = 500: must be 0 or {rate} Hz as {path}"):
            foreign.import_texture(path, 500.0, calibration)
    with pytest.raises(ParameterError, match="has no sampling rate: leave it out"):
        foreign.import_texture(tmp_path / "buzz.ahap", 500.0, 5.0)


def test_only_one_channel_of_an_npz_file_is_acceleration_without_its_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = three_axes(tmp_path / "drag.npz", ["speed", "load", "t"])
    with pytest.raises(ParameterError, match="channel_names speed, load: must be one channel"):
        foreign.import_texture(path)
    np.savez(path, data=noise(2000.0), sample_rate=2000, channel_names=["x"])
    assert distance(foreign.import_texture(path), theory()) < 1.0
    assert caplog.messages == [f"{path}: channel x: taken as the acceleration"]


def test_a_pattern_becomes_a_texture_of_its_frequency_and_strength(tmp_path: Path) -> None:
    pattern = [event("Continuous", 0.0, 1.0, 1.0, EventDuration=1.0)]
    path = pattern_file(tmp_path / "buzz.ahap", {"Pattern": pattern})
    with pytest.raises(ParameterError, match="calibration = nothing"):
        foreign.import_texture(path)
    model = foreign.import_texture(path, calibration=4.0)
    frequency = np.linspace(1.0, 499.0, 5000)
    density = model.spectrum(SPEED, FORCE, frequency)
    assert frequency[np.argmax(density)] == pytest.approx(300.0, abs=2.0)
    power = float(density.mean()) * 500.0
    assert np.sqrt(power) == pytest.approx(4.0 / np.sqrt(2), rel=0.05)


def test_the_texture_grows_with_speed_and_force_to_its_own_strength(tmp_path: Path) -> None:
    model = foreign.import_texture(write_filter(tmp_path / "f.json"))
    levels = {
        (speed, force): float(np.sqrt(np.mean(model.spectrum(speed, force, BAND))))
        for speed in (0.0, 0.5 * SPEED, SPEED, 3 * SPEED)
        for force in (0.0, 0.5 * FORCE, FORCE, 3 * FORCE)
    }
    full = float(np.sqrt(np.mean(theory())))
    assert levels[SPEED, FORCE] == pytest.approx(full, rel=1e-3)
    assert levels[3 * SPEED, 3 * FORCE] == pytest.approx(full, rel=1e-3)
    assert 0 < levels[0.5 * SPEED, 0.5 * FORCE] < full
    assert levels[0.0, FORCE] == levels[SPEED, 0.0] == 0.0
    samples = Texture(model, 1000.0, seed=1).block(np.full(20000, SPEED), np.full(20000, FORCE))
    power = float(np.var(signal.lfilter([0.5], A, np.eye(1, 4000)[0]))) * 4000
    assert np.std(samples[1000:]) == pytest.approx(np.sqrt(power), rel=0.1)


ONE = {"sample_rate": 1000, "channel_names": ["x"]}


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("f.json", {"a": [1.0, -1.01]}, "a: must have its roots inside the unit circle"),
        ("f.json", {"a": [0.0, 1.0]}, "a: must have its roots"),
        ("f.json", {"a": [5e-324, 1e9]}, "a: must have its roots"),
        ("f.json", {"b": []}, "b: must be 1 to"),
        ("f.json", {"b": [0.0]}, "b: .*not all 0"),
        ("f.json", {"b": "x"}, "b = 'x': must be a list"),
        ("f.json", {"b": [None]}, r"b.0 = None: must be from"),
        ("f.json", {"b": [1e200]}, r"b.0 = 1e\+200: must be from -1e\+09 to"),
        ("f.json", {"sample_rate": 1}, "sample_rate = 1: must be from 10"),
        ("a.npz", {}, "data = nothing: must be given"),
        ("a.npz", {**ONE, "data": np.ones((3, 9))}, r"data of shape \(3, 9\)"),
        ("a.npz", {**ONE, "data": []}, r"data = .*: must be numbers"),
        ("a.npz", {**ONE, "data": np.ones(9), "sample_rate": 0}, "sample_rate = 0"),
        ("a.npz", {**ONE, "data": np.zeros(99)}, "is silent"),
        ("a.npz", {**ONE, "data": [1.0, 1e200]}, "data: must be num"),
        ("a.npz", {**ONE, "data": [1.0, np.nan]}, "data: must be num"),
        (
            "a.npz",
            {**ONE, "channel_names": ["acc"] * 65, "data": []},
            "65 channels: must be at most",
        ),
        ("a.mp3", None, r"must be one of \*.xml, "),
        *((f"none.{kind}", None, "No such file") for kind in ("xml", "npz", "json", "ahap")),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, name: str, content: Any, words: str) -> None:
    path = tmp_path / name
    if name == "f.json":
        write_filter(path, **content)
    elif content is not None:
        np.savez(path, **content)
    with pytest.raises(ParameterError, match=rf"^{path}: .*{words}"):
        foreign.import_texture(path, calibration=5.0 if name == "none.ahap" else None)


def test_a_wrong_calibration_is_refused(tmp_path: Path) -> None:
    for name, value, words in (
        ("a.csv", 2.0, "has units: leave it out"),
        ("a.wav", 0.0, "above 0"),
    ):
        with pytest.raises(ParameterError, match=rf"^calibration = {value:g}.*{words}"):
            foreign.import_texture(tmp_path / name, calibration=value)


SHAPES = {
    "arma": ((14, 12), 25, 1000.0),
    "large arma": ((20, 18), 57, 1000.0),
    "ar": ((20, 0), 40, 10000.0),
}
"""Orders, nodes and rate of the toolkit's files."""


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_file_is_read_in_si_units(tmp_path: Path) -> None:
    model = foreign.read_hatt(written(tmp_path / "slate.xml", hatt_file((14, 12), 25)))
    assert (model.name, model.rate, model.coulomb_friction) == ("Slate", 1000.0, 0.25)
    assert (model.lsf.shape, model.ma_lsf.shape) == ((25, 14), (25, 12))
    assert (model.speeds.max(), model.forces.max()) == (0.3, 4.0)
    assert np.all(model.gain > 0)
    assert np.all((model.deviation == 0) == ((model.speeds == 0) | (model.forces == 0)))
    assert "no redistribution" in model.provenance.licence


def test_a_file_without_moving_average_is_autoregressive(tmp_path: Path) -> None:
    text = hatt_file((20, 0), 40, 10000.0).replace("<numMACoeff>0</numMACoeff>", "")
    model = foreign.read_hatt(written(tmp_path / "slate.xml", text))
    assert (model.rate, model.ma_lsf.shape) == (10000.0, (40, 0))
    assert model.gain.tolist() == [1.0] * 40


@pytest.mark.parametrize(
    ("found", "given", "message"),
    [
        ("</modelSet>", "", "not XML"),
        ("modelSet", "model", "model: must be a modelSet"),
        ("mm/s", "in/s", "SpeedUnits = in/s: must be mm/s"),
        ("<SampleRate>1000</SampleRate>", "", "SampleRate: missing in modelSet"),
        ("<SampleRate>1000", "<SampleRate>0", "rate = 0.0: must be above 0 Hz"),
        ("<SampleRate>1000", "<SampleRate>fast", "SampleRate = 'fast': must be a number"),
        ("<var>", "<var>-", "var = -.*: must be at least 0"),
        ("<gain>", "<gain>nan ", "gain = 'nan .*': must be a number"),
        ('<ARlsf type="array">', "<ARlsf><value>4</value>", "lsf: must increase within 0 to pi"),
        ("model>", "texture>", "nodes = 0: must be three or more"),
    ],
)
def test_a_wrong_file_is_refused_by_name(
    tmp_path: Path, found: str, given: str, message: str
) -> None:
    path = written(tmp_path / "slate.xml", hatt_file().replace(found, given))
    with pytest.raises(ParameterError, match=message) as refused:
        foreign.read_hatt(path)
    assert str(refused.value).startswith(f"{path}: ")
    assert "\n" not in str(refused.value)


def test_nodes_of_different_orders_are_refused(tmp_path: Path) -> None:
    text = hatt_file().replace('<ARlsf type="array">', "<ARlsf><value>0.001</value>", 1)
    with pytest.raises(ParameterError, match="ARlsf: 14 to 15 values: must be one order"):
        foreign.read_hatt(written(tmp_path / "slate.xml", text))


def are_stable(polynomials: np.ndarray) -> bool:
    """Return True if all reflection coefficients are below 1, by the recursion backwards."""
    while polynomials.shape[1] > 1:
        reflection = polynomials[:, -1:]
        if not np.all(np.abs(reflection) < 1):
            return False
        reversed_ = polynomials[:, ::-1]
        polynomials = ((polynomials - reflection * reversed_) / (1 - reflection**2))[:, :-1]
    return True


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", rest_slow([1000, 100_000]))
def test_a_texture_is_stable_at_every_point_and_along_every_path(
    shape: str, count: int, tmp_path: Path
) -> None:
    orders, nodes, rate = SHAPES[shape]
    model = foreign.read_hatt(written(tmp_path / "slate.xml", hatt_file(orders, nodes, rate)))
    random = np.random.default_rng(1)
    places = model.locate(random.uniform(0, 0.4, count), random.uniform(0, 6, count))
    assert places.weights.min() >= 0
    assert places.weights.sum(axis=1) == pytest.approx(1.0)
    for lsf in (places.interpolate(model.lsf), places.interpolate(model.ma_lsf)):
        assert is_ordered(lsf)
        assert are_stable(to_polynomial(lsf))
    # Half of the path jumps, half creeps; a fifth of it is out of contact.
    for held in (1, 100):
        texture = Texture(model, rate, seed=1)
        drawn = (random.uniform(*range_, count // held) for range_ in ((0, 0.4), (-1, 4.5)))
        speeds, forces = (np.repeat(each, held) for each in drawn)
        samples = texture.block(speeds, np.maximum(forces, 0.0))
        assert np.all(np.abs(samples) <= 100.0)
        assert texture.saturated == np.sum(np.abs(samples) == 100.0)
        assert np.abs(texture.block(np.zeros(2_000), np.zeros(2_000))[-1]) < 1e-3


def test_a_pattern_of_many_events_is_refused(tmp_path: Path) -> None:
    for count, seconds, says in ((15_000, 0.01, "at most 10000 events"), (100, 60, "6000 s")):
        pattern = [event("Continuous", 0.0, 0.5, 0.5, EventDuration=seconds)] * count
        path = pattern_file(tmp_path / "a.ahap", {"Pattern": pattern})
        with measured(), pytest.raises(ParameterError, match=says):
            foreign.import_texture(path, calibration=1.0)


RATE = 500.0
TIME = np.arange(600) / RATE
SIGNAL = 20.0 * np.sin(2 * np.pi * 170.0 * TIME)
SIGNAL += 2.0 * np.random.default_rng(5).normal(size=len(TIME))
"""Acceleration, m/s^2."""


@cache
def texture() -> TextureModel:
    """Return the texture of the signal, from a CSV file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        np.savetxt(path, SIGNAL, header="acceleration", comments="")
        return foreign.import_texture(path, RATE)


@fuzz_few
@given(
    st.sampled_from(["acc", "acc_z [g]", "Acceleration (mm/s^2)", "acc_mg"]),
    st.lists(st.sampled_from(["t", "force", "time [ms]"]), unique=True, max_size=3),
    st.booleans(),
    st.booleans(),
    st.sampled_from([np.float64, np.float32]),
)
def test_an_npz_file_is_read_alike_in_any_form(
    tmp_path: Path, name: str, others: Sequence[str], turned: bool, small: bool, kind: type
) -> None:
    factors = {"acc_z [g]": GRAVITY, "Acceleration (mm/s^2)": 1e-3, "acc_mg": GRAVITY / 1000}
    made = {"t": TIME, "force": np.ones(len(TIME)), "time [ms]": 1e3 * TIME}
    rows = np.array([*(made[each] for each in others), SIGNAL / factors.get(name, 1.0)], kind)
    write = np.savez_compressed if small else np.savez
    path = tmp_path / "a.npz"
    data = rows.T if turned else rows
    write(path, data=data, sample_rate=RATE, channel_names=[*others, name])
    found = foreign.import_texture(path)
    rounding = 1e-9 if kind is np.float64 else 1e-4
    assert found.deviation == pytest.approx(texture().deviation, rel=rounding)
    assert found.lsf == pytest.approx(texture().lsf, rel=rounding)
