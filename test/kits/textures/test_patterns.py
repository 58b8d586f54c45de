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

"""Patterns of phones and controllers: their level and frequency over time, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.textures.patterns import DULLEST, SHARPEST, read_pattern

RATE = 2000.0


def written(path: Path, content: Any) -> Path:
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
    return float(np.argmax(spectrum)) * RATE / (1 << 16)


def amplitude(wave: FloatArray) -> float:
    return float(np.sqrt(2 * np.mean(wave**2)))


def part(wave: FloatArray, begin: float, end: float) -> FloatArray:
    return wave[round(begin * RATE) : round(end * RATE)]


def test_an_ahap_has_its_events_and_curves(tmp_path: Path) -> None:
    pattern = [
        event("Transient", 0.0, 0.8, 0.0),
        event("Continuous", 0.5, 0.6, 0.5, EventDuration=1.0),
        curve("HapticIntensityControl", (0.4, 1.0), (1.0, 1.0), (1.01, 0.5)),
        curve("HapticSharpnessControl", (0.4, 0.0), (1.0, 0.0), (1.01, 0.5)),
        {"Event": {"Time": 0.0, "EventType": "AudioCustom"}},
    ]
    wave = read_pattern(written(tmp_path / "a.ahap", {"Version": 1.0, "Pattern": pattern}), RATE)
    assert len(wave) == 1.5 * RATE
    assert 0.4 < np.abs(part(wave, 0.0, 0.02)).max() < 0.8
    assert not part(wave, 0.1, 0.5).any()
    middle = (DULLEST + SHARPEST) / 2
    assert amplitude(part(wave, 0.5, 1.0)) == pytest.approx(0.6, rel=0.01)
    assert frequency(part(wave, 0.5, 1.0)) == pytest.approx(middle, abs=1.0)
    assert amplitude(part(wave, 1.05, 1.5)) == pytest.approx(0.3, rel=0.01)
    assert frequency(part(wave, 1.05, 1.5)) == pytest.approx(SHARPEST, abs=1.0)


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
    wave = read_pattern(written(tmp_path / "a.haptic", content), RATE)
    assert amplitude(part(wave, 0.0, 0.5)) == pytest.approx(0.4, rel=0.01)
    assert frequency(part(wave, 0.0, 0.5)) == pytest.approx(SHARPEST, abs=1.0)
    assert np.abs(part(wave, 0.51, 0.53)).max() > 0.4
    assert not part(wave, 0.55, 1.0).any()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], "Pattern = nothing"),
        ({"Pattern": {}}, r"Pattern = {}: must be a list"),
        ({"Pattern": []}, "silent"),
        (
            {"Pattern": [event("Continuous", 0.0, 1.0, 0.5)]},
            r"Pattern.0.Event.EventDuration = noth",
        ),
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
    path.write_bytes(content) if isinstance(content, bytes) else written(path, content)
    with pytest.raises(ParameterError, match=rf"^{path}: .*{words}") as raised:
        read_pattern(path, RATE)
    assert str(raised.value).isprintable()
