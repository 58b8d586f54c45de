# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Damaged files of other programs: imported or refused in one line, within 2 s and 500 MB."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from kits.textures.hatt_file import hatt_file
from scipy.io import wavfile

from damaged_files import ANY_BYTES, NOISE, other_arrays, text, written, zipped
from fuzzing import accepted, fuzz_few, measured, mutated, without_programs
from haptic_accel.kits.textures.foreign import import_texture

AXES = {"data": NOISE.reshape(2, -1), "sample_rate": 1000, "channel_names": ["acc_x", "acc_y"]}
FILTER = {"name": "oak", "sample_rate": 1000.0, "b": [0.5], "a": [1.0, -0.5]}
STRENGTH = [{"ParameterID": "HapticIntensity", "ParameterValue": 0.5}]
SHARPENED = [{"Time": 0.1, "ParameterValue": 0.3}]
CURVE = {"ParameterID": "HapticSharpnessControl", "ParameterCurveControlPoints": SHARPENED}
TAP = {"Time": 0.0, "EventType": "HapticTransient", "EventParameters": STRENGTH}
HELD = {**TAP, "Time": 0.1, "EventType": "HapticContinuous", "EventDuration": 0.3}
AHAP = {"Pattern": [{"Event": HELD}, {"Event": TAP}, {"ParameterCurve": CURVE}]}
POINT = {"time": 0.2, "amplitude": 0.4, "emphasis": {"amplitude": 0.9, "frequency": 0.9}}
FREQUENCY = {"time": 0.0, "frequency": 0.5}
ENVELOPES = {"amplitude": [{"time": 0.0, "amplitude": 0.5}, POINT], "frequency": [FREQUENCY]}
HAPTIC = {"signals": {"continuous": {"envelopes": ENVELOPES}}}


def wav(dtype: str) -> bytes:
    file = io.BytesIO()
    wavfile.write(file, 20, (50 * NOISE if dtype == "int16" else NOISE / 4).astype(dtype))
    return file.getvalue()


WAVES = [wav("int16"), wav("float32")]
ROWS = [b"%g,%f\n" % (place / 20, value) for place, value in enumerate(NOISE)]
KINDS: dict[str, tuple[str, st.SearchStrategy[bytes]]] = {
    "acceleration, NPZ": ("a.npz", zipped(AXES) | other_arrays(AXES)),
    "texture, XML": ("a.xml", text(hatt_file((4, 2), 12).encode())),
    "filter, JSON": ("a.json", written(FILTER)),
    "pattern, AHAP": ("a.ahap", written(AHAP)),
    "pattern, haptic": ("a.haptic", written(HAPTIC)),
    "acceleration, CSV": ("a.csv", text(b"t,acc\n" + b"".join(ROWS))),
    "acceleration, WAV": ("a.wav", mutated(st.sampled_from(WAVES), ANY_BYTES)),
}


@pytest.mark.parametrize("kind", KINDS)
@fuzz_few
@given(st.data())
def test_any_damage_is_refused_in_one_line(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    name, contents = KINDS[kind]
    path = tmp_path / name
    path.write_bytes(data.draw(contents))
    full_scale = None if path.suffix in (".xml", ".csv") else 5.0
    with measured(), without_programs():
        accepted(lambda: import_texture(path, 20.0, full_scale))
