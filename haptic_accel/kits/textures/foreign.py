# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Import of texture models from files of other programs.

Only the spectrum of a recording, filter or pattern is used. The texture is the same at all speeds
and forces, except for its amplitude. Patterns are those of phones and controllers: AHAP and
``.haptic`` files.
"""

from __future__ import annotations

import itertools
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from haptic_accel import FloatArray, ParameterError, Provenance, TextureModel, core
from haptic_accel.core.document import Document, read_json_document
from haptic_accel.core.parameters import Specification, checked, shown, warn_once
from haptic_accel.core.sampling import HIGHEST_RATE, LOWEST_RATE
from haptic_accel.kits.textures.building import FRAME, LARGEST_ORDER, RENDER_RATE
from haptic_accel.materials import columns, read_npz
from haptic_accel.materials.columns import LARGEST_VALUE
from haptic_accel.materials.recordings import UNCALIBRATED, check_rate, read_samples

DULLEST, SHARPEST = 65.0, 300.0
"""Frequencies for sharpness 0 and 1, Hz, as in the reference encoder of MPEG-I haptics."""

TRANSIENT = 0.03
"""Duration of a transient, s."""

TRANSIENT_DECAY = 150.0
"""Decay rate of a transient, 1/s: to a hundredth within its duration."""

LONGEST_PATTERN = 60.0
"""Maximum duration of a pattern, s."""

MOST_EVENTS = 10_000
"""Maximum number of events in a pattern; most have a hundred."""

LONGEST_IN_ALL = 1200.0
"""Maximum total duration of the events in a pattern, s: twenty at once during the longest
pattern."""

_INTENSITY, _SHARPNESS = 1.0, 0.5  # defaults of events
_SECONDS = Specification("time", "s", 0.0, LONGEST_PATTERN)
_RELATIVE = Specification("relative value", "", -1.0, 1.0)


@dataclass(frozen=True, eq=False)
class _Envelope:
    """Values between points of increasing time; `before` applies ahead of the first point."""

    before: float
    times: FloatArray = field(default_factory=lambda: np.empty(0))
    values: FloatArray = field(default_factory=lambda: np.empty(0))
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def through(cls, before: float, points: Iterable[tuple[float, float]]) -> _Envelope:
        times, values = np.array(sorted(points)).reshape(-1, 2).T
        return cls(before, times, values)

    def at(self, time: FloatArray) -> FloatArray:
        found = np.full(len(time), self.before)
        if len(self.times):
            found = np.interp(time, self.times, self.values, left=self.before)
        return np.asarray(self.factor * found + self.offset)


@dataclass(frozen=True)
class _Event:
    """Vibration with envelopes of relative intensity and sharpness."""

    start: float
    duration: float
    decay: float
    intensity: _Envelope
    sharpness: _Envelope


def read_pattern(path: Path, rate: float) -> FloatArray:
    """Return the waveform of an AHAP or ``.haptic`` file.

    Continuous events are sinusoids, transients decay, and sharpness determines the frequency.
    Sounds and keys of other programs are ignored.

    Parameters
    ----------
    path : Path
        File; its suffix gives the format.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (n,)
        Waveform; 1 is an event of full intensity.

    Raises
    ------
    ParameterError
        The file cannot be read, or a value is invalid; the message is one line.
    """
    read = _haptic_events if path.suffix.lower() == ".haptic" else _ahap_events
    events = list(itertools.islice(read(read_json_document(path)), MOST_EVENTS + 1))
    if len(events) > MOST_EVENTS:
        raise ParameterError(f"{path}: must have at most {MOST_EVENTS} events")
    if (total := sum(event.duration for event in events)) > LONGEST_IN_ALL:
        raise ParameterError(
            f"{path}: its events take {total:g} s together: must be at most {LONGEST_IN_ALL:g} s"
        )
    end = max((event.start + event.duration for event in events), default=0.0)
    time = np.arange(math.ceil(end * rate)) / rate
    wave = np.zeros(len(time))
    for event in events:
        span = slice(round(event.start * rate), round((event.start + event.duration) * rate))
        wave[span] += _vibration(event, time[span], rate)
    if not wave.any():
        raise ParameterError(f"{path}: is silent: must have an event of intensity above 0")
    return wave


def _vibration(event: _Event, time: FloatArray, rate: float) -> FloatArray:
    share = np.clip(event.sharpness.at(time), 0, 1)
    phase = 2 * np.pi * np.cumsum(DULLEST + (SHARPEST - DULLEST) * share) / rate
    amplitude = np.clip(event.intensity.at(time), 0, 1) * np.exp(
        -event.decay * (time - event.start)
    )
    return np.asarray(amplitude * np.sin(phase))


def _ahap_events(file: Document) -> Iterator[_Event]:
    items = list(file.at("Pattern").items())
    curves = [item.at("ParameterCurve") for item in items if "ParameterCurve" in item]
    control = {
        kind: _Envelope.through(neutral, _control_points(curves, f"Haptic{kind}Control"))
        for kind, neutral in (("Intensity", 1.0), ("Sharpness", 0.0))
    }
    for event in (item.at("Event") for item in items if "Event" in item):
        kind = event.at("EventType").text()
        if kind not in ("HapticTransient", "HapticContinuous"):
            continue
        brief = kind == "HapticTransient"
        own = _parameters(event)
        yield _Event(
            event.at("Time").number(_SECONDS),
            TRANSIENT if brief else event.at("EventDuration").number(_SECONDS),
            TRANSIENT_DECAY if brief else 0.0,
            replace(control["Intensity"], factor=own.get("Intensity", _INTENSITY)),
            replace(control["Sharpness"], offset=own.get("Sharpness", _SHARPNESS)),
        )


def _parameters(event: Document) -> Mapping[str, float]:
    """Return an event's values by the names of their kind, without "Haptic"."""
    listed = event.at("EventParameters").items() if "EventParameters" in event else ()
    return {
        each.at("ParameterID").text().removeprefix("Haptic"): each.at("ParameterValue").number(
            _RELATIVE
        )
        for each in listed
        if each.at("ParameterID").text() in ("HapticIntensity", "HapticSharpness")
    }


def _control_points(curves: Iterable[Document], kind: str) -> Iterator[tuple[float, float]]:
    for curve in curves:
        if curve.at("ParameterID").text() == kind:
            start = curve.at("Time").number(_SECONDS)
            for point in curve.at("ParameterCurveControlPoints").items():
                time = start + point.at("Time").number(_SECONDS)
                yield time, point.at("ParameterValue").number(_RELATIVE)


def _haptic_events(file: Document) -> Iterator[_Event]:
    envelopes = file.at("signals", "continuous", "envelopes")
    points = list(envelopes.at("amplitude").items())
    amplitude = _breakpoints(points, "amplitude", 0.0)
    frequency = _breakpoints(
        envelopes.at("frequency").items() if "frequency" in envelopes else (),
        "frequency",
        _SHARPNESS,
    )
    end = float(amplitude.times.max(initial=0.0))
    yield _Event(0.0, end, 0.0, amplitude, frequency)
    for point in points:
        if "emphasis" in point:
            emphasis = point.at("emphasis")
            yield _Event(
                point.at("time").number(_SECONDS),
                TRANSIENT,
                TRANSIENT_DECAY,
                _Envelope(emphasis.at("amplitude").number(_RELATIVE)),
                _Envelope(emphasis.at("frequency").number(_RELATIVE)),
            )


def _breakpoints(points: Iterable[Document], key: str, before: float) -> _Envelope:
    pairs = ((each.at("time").number(_SECONDS), each.at(key).number(_RELATIVE)) for each in points)
    return _Envelope.through(before, pairs)


REFERENCE = np.array([0.08, 1.0])
"""Speed, m/s, and force, N, at which an imported texture has its original amplitude, for files
without both: an ordinary stroke."""

PATTERN_RATE = 2000.0
"""Sampling rate of patterns, Hz: more than six times their highest frequency."""

FLOOR = 1e-6
"""Power density, relative to the mean, below which a spectrum is not modelled: -60 dB."""

NPZ_ARRAYS = ("data", "sample_rate", "channel_names")
"""Arrays of an NPZ file that are read."""

WORDING = columns.Wording("rate", "")
"""Name of the rate in messages; the column has a fixed name."""

MOST_COEFFICIENTS = 1000
"""Maximum number of filter coefficients."""

_RATE = Specification("sampling rate", "Hz", LOWEST_RATE, HIGHEST_RATE)
_COEFFICIENT = Specification("coefficient of a filter", "", -1e9, 1e9)


def import_texture(
    path: Path, rate: float = 0.0, calibration: float | None = None
) -> TextureModel:
    """Create a texture model from another program's file.

    Parameters
    ----------
    path : Path
        File, with the format given by its suffix: ``.xml`` of the Penn Haptic Texture Toolkit;
        ``.wav`` or ``.csv``, an acceleration; ``.npz`` with data, sample_rate and channel_names;
        ``.json``, a filter for unit white noise with sample_rate, b and a; ``.ahap`` or
        ``.haptic``, a pattern.
    rate : float
        Sampling rate of a CSV file without times, Hz; must be 0 or that in any other file.
    calibration : float, optional
        Acceleration in m/s^2 for a value of 1, or for an integer's full scale. Required for
        patterns and WAV files; CSV and XML files have units.

    Raises
    ------
    ParameterError
        The message is one line with the file and its error, or the missing calibration.
    """
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise ParameterError(f"{path}: must be one of *{', *'.join(_READERS)}")
    if calibration is not None:
        allowed = Specification("calibration", "m/s^2", 0.0, LARGEST_VALUE, above=True)
        checked("calibration", calibration, 1.0, allowed)
        if path.suffix.lower() in (".xml", ".csv"):
            raise ParameterError(f"calibration = {calibration:g}: {path} has units: leave it out")
    return read(path, rate, calibration)


def _from_hatt(path: Path, rate: float, _calibration: float | None) -> TextureModel:
    model = read_hatt(path)
    check_rate(str(path), model.rate, rate, WORDING)
    return model


def _from_recording(path: Path, rate: float, calibration: float | None) -> TextureModel:
    samples, rate = read_samples(path, rate, full_scale=calibration, wording=WORDING)
    return _from_signals(path, samples[np.newaxis], rate, calibration)


def _from_pattern(path: Path, rate: float, calibration: float | None) -> TextureModel:
    if rate:
        raise ParameterError(f"rate = {rate:g}: {path} has no sampling rate: leave it out")
    if calibration is None:
        raise ParameterError(f"{path}: {UNCALIBRATED}")
    wave = calibration * read_pattern(path, PATTERN_RATE)
    return _from_signals(path, wave[np.newaxis], PATTERN_RATE, calibration)


def _from_npz(path: Path, rate: float, calibration: float | None) -> TextureModel:
    file = read_npz(path)
    data, names = _channels(path, file)
    own_rate = file.at("sample_rate").number(_RATE)
    check_rate(str(path), own_rate, rate, WORDING)
    if unread := [name for name, _ in file.members() if name not in NPZ_ARRAYS]:
        warn_once(f"{path}: {shown(', '.join(unread))}: not read")
    own = [index for index, name in enumerate(names) if "acc" in name.lower()]
    others = [index for index, name in enumerate(names) if index not in own]
    for index in others:
        location, where = f"{path}: channel", "sample {}".format
        columns.rate_of_times(location, names[index], data[index], where, own_rate, "sample_rate")
    left = [names[index] for index in others if not columns.is_time(names[index], data[index])]
    own = own or _only_channel(path, left, names)
    stated = [names[index] for index in own if columns.ACCELERATION.parsed(names[index])[1]]
    if stated and calibration is not None:
        raise ParameterError(
            f"calibration = {calibration:g}: {path} has units, {shown(stated[0])}: leave it out"
        )
    factors = np.array(
        [columns.factor_of(str(path), names[index], columns.ACCELERATION) for index in own]
    )
    signals = (calibration or 1.0) * factors[:, np.newaxis] * data[own]
    if not (own and np.all(np.abs(signals) <= LARGEST_VALUE)):
        raise ParameterError(
            f"{path}: data: must be numbers from {-LARGEST_VALUE:g} to {LARGEST_VALUE:g}"
        )
    return _from_signals(path, signals, own_rate, calibration)


def _only_channel(path: Path, left: list[str], names: list[str]) -> list[int]:
    """Return the index of the only channel except times, if none is named acceleration."""
    if len(left) > 1:
        raise ParameterError(
            f"{path}: channel_names {shown(', '.join(left))}: must be one channel beside times, or"
            " have acc in the name of each acceleration"
        )
    for name in left:
        warn_once(f"{path}: channel {shown(name)}: taken as the acceleration")
    return [names.index(name) for name in left]


def _channels(path: Path, file: Document) -> tuple[FloatArray, list[str]]:
    """Return the signals in an NPZ file, a row each, and their names."""
    signals, titles = file.at("data"), np.atleast_1d(file.at("channel_names").value)
    if titles.size > columns.MOST_CHANNELS:
        raise ParameterError(
            f"{path}: channel_names: {titles.size} channels: must be at most"
            f" {columns.MOST_CHANNELS}"
        )
    data, names = np.atleast_2d(signals.array()), [str(name) for name in titles.tolist()]
    if data.shape[1] == len(names) != data.shape[0]:
        data = data.T
    if data.ndim != 2 or not data.size or len(data) != len(names):
        raise ParameterError(
            f"{path}: data of shape {data.shape}: must be one row per channel_names, {len(names)}"
        )
    return data, names


def _from_signals(
    path: Path, signals: FloatArray, rate: float, calibration: float | None
) -> TextureModel:
    """Return the texture of signals of shape (axes, n), whose powers are added (DFT321)."""
    own = [core.without_hand_motion(each, core.HIGH_PASS_FREQUENCY, rate) for each in signals]
    length = signals.shape[1]
    power = sum(np.abs(np.fft.rfft(each, 2 * length)) ** 2 for each in own)
    return _texture(path, path.stem, power * 2 / (rate * length), rate, calibration)


def _from_filter(path: Path, rate: float, calibration: float | None) -> TextureModel:
    file = read_json_document(path)
    own_rate = file.at("sample_rate").number(_RATE)
    check_rate(str(path), own_rate, rate, WORDING)
    b, a = (_coefficients(path, file, name) for name in ("b", "a"))
    with np.errstate(all="ignore"):  # an overflow is rejected below
        proper = bool(np.isfinite(a / a[0]).all())
    if not proper or np.any(np.abs(np.roots(a)) >= 1):
        raise ParameterError(f"{path}: a: must have its roots inside the unit circle")
    delay = np.exp(-1j * np.linspace(0.0, np.pi, 4097))
    response = (calibration or 1.0) * np.polyval(b[::-1], delay) / np.polyval(a[::-1], delay)
    name = file.at("name").text() if "name" in file else path.stem
    return _texture(path, name, np.abs(response) ** 2 * 2 / own_rate, own_rate, calibration)


def _coefficients(path: Path, file: Document, name: str) -> FloatArray:
    found = np.array([each.number(_COEFFICIENT) for each in file.at(name).items()])
    if not 1 <= len(found) <= MOST_COEFFICIENTS or not found.any():
        raise ParameterError(
            f"{path}: {name}: must be 1 to {MOST_COEFFICIENTS} coefficients that are not all 0"
        )
    return found


def _texture(
    path: Path, name: str, density: FloatArray, rate: float, calibration: float | None
) -> TextureModel:
    """Return the texture for a power density, (m/s^2)^2/Hz, from 0 to half a rate."""
    lower = min(rate, RENDER_RATE)
    kept = density[: round((len(density) - 1) * lower / rate) + 1]
    if not kept.any():
        raise ParameterError(
            f"{path}: is silent from {core.HIGH_PASS_FREQUENCY:g} to {lower / 2:g} Hz"
        )
    followed = np.maximum(kept, FLOOR * kept.mean())
    covariance = np.fft.irfft(followed * lower / 2)
    polynomial, variances = core.levinson(covariance[: LARGEST_ORDER + 1])
    speeds, forces = (FRAME * REFERENCE).T
    scale = "m/s^2, as in the file" if calibration is None else f"{calibration:g} m/s^2 at 1"
    return TextureModel(
        name,
        lower,
        speeds,
        forces,
        lsf=np.tile(core.from_polynomial(polynomial), (len(FRAME), 1)),
        deviation=np.where(FRAME.all(axis=1), np.sqrt(variances[-1]), 0.0),
        provenance=Provenance(source=path.name, calibration=scale),
    )


_READERS: dict[str, Callable[[Path, float, float | None], TextureModel]] = {
    **{".xml": _from_hatt, ".npz": _from_npz, ".json": _from_filter},
    **dict.fromkeys((".wav", ".csv"), _from_recording),
    **dict.fromkeys((".ahap", ".haptic"), _from_pattern),
}


# XML of the Penn Haptic Texture Toolkit (Culbertson and others 2014). Its licence permits
# non-profit research, but no redistribution; users provide the files.

MILLIMETRE = 1e-3
"""Metres per millimetre."""

UNITS = {"SpeedUnits": "mm/s", "ForceUnits": "N"}
"""Units in the toolkit's files; accelerations are in m/s^2."""

PROVENANCE = Provenance(
    source="Penn Haptic Texture Toolkit",
    licence="non-profit research only, no redistribution",
    author="H. Culbertson, J. J. Lopez Delgado, K. J. Kuchenbecker",
    calibration="m/s^2, as in the file",
)


def read_hatt(path: Path) -> TextureModel:
    """Read a texture model, autoregressive or with a moving average.

    The file's triangles are ignored; the model's own are equal or better.

    Raises
    ------
    ParameterError
        The file cannot be read, has another format, or contains no valid model; the message is one
        line.
    """
    with core.located(path, "not XML"):
        model_set = core.read_xml(path)
    with core.located(path):
        return _model(model_set, path.stem)


def _model(model_set: ElementTree.Element, name: str) -> TextureModel:
    if model_set.tag != "modelSet":
        raise ParameterError(f"{shown(model_set.tag)}: must be a modelSet")
    for tag, unit in UNITS.items():
        found = model_set.findtext(tag, unit).strip()
        if found != unit:
            raise ParameterError(f"{tag} = {shown(found)}: must be {unit}")
    nodes = model_set.findall("model")
    friction = model_set.findtext("mu")
    return TextureModel(
        name=model_set.findtext("material", name).strip(),
        rate=_number(model_set, "SampleRate"),
        speeds=np.array([_number(node, "speedMod") for node in nodes]) * MILLIMETRE,
        forces=np.array([_number(node, "forceMod") for node in nodes]),
        lsf=_rows(nodes, "ARlsf"),
        deviation=np.sqrt([_number(node, "var", low=0.0) for node in nodes]),
        ma_lsf=_rows(nodes, "MAlsf"),
        gain=np.array([_number(node, "gain", default="1") for node in nodes]),
        coulomb_friction=None if friction is None else _float("mu", friction),
        provenance=PROVENANCE,
    )


def _rows(nodes: list[ElementTree.Element], tag: str) -> FloatArray:
    """Return the frequencies of each node below a tag; none if it is absent."""
    rows = [[_float(tag, value.text) for value in node.iterfind(f"{tag}/value")] for node in nodes]
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ParameterError(f"{tag}: {lengths[0]} to {lengths[-1]} values: must be one order")
    return np.array(rows, dtype=float)


def _number(
    parent: ElementTree.Element, tag: str, default: str | None = None, low: float = -np.inf
) -> float:
    text = parent.findtext(tag, default)
    if text is None:
        raise ParameterError(f"{tag}: missing in {parent.tag}")
    number = _float(tag, text)
    if number < low:
        raise ParameterError(f"{tag} = {number:g}: must be at least {low:g}")
    return number


def _float(tag: str, text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        raise ParameterError(f"{tag} = {shown(repr(text))}: must be a number") from None
