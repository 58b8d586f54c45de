# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reading, resampling and looping of recorded accelerations."""

from __future__ import annotations

import cProfile
import io
import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.io import wavfile

from fuzzing import ODD_TEXTS, accepted, fuzz, measured, mutated, without_programs
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import crossfaded, resampled
from haptic_accel.materials import recordings as recording
from haptic_accel.materials.recordings import FULL_SCALE, FloatArray, read_recording
from recordings import write_recording, write_wav

LFS = "version https://git-lfs.github.com/spec/v1"

# One folder serves all examples of a test: each writes its files again.
untimed = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=200
)


def tone(frequency: float, rate: float, seconds: float = 3.0) -> FloatArray:
    return np.sin(2 * np.pi * frequency * np.arange(round(rate * seconds)) / rate)


def inner(samples: FloatArray) -> FloatArray:
    """Return the middle half, away from where the signal begins and ends at once."""
    return samples[len(samples) // 4 : -len(samples) // 4]


def write_csv(
    path: Path, columns: dict[str, FloatArray], delimiter: str = ",", end: str = "\n"
) -> Path:
    rows = [delimiter.join(columns)]
    rows += [delimiter.join(map(repr, map(float, row))) for row in zip(*columns.values())]  # noqa: B905
    path.write_text(end.join(rows) + end, newline="")
    return path


def refusal(path: Path | str, *arguments: object, **options: object) -> str:
    """Return the one line that a file or a parameter is refused with."""
    with pytest.raises(ParameterError) as raised:
        read_recording(path, *arguments, **options)
    message = str(raised.value)
    assert message.isprintable()
    assert len(message) < 1500
    return message


# Resampling

RATES = [(10_000, 1000), (44_100, 1000), (48_000, 5000), (1000, 4000), (800, 1000), (3000, 2000)]


@pytest.mark.parametrize(("before", "after"), RATES)
@pytest.mark.parametrize("fraction", [0.01, 0.2, 0.5, 0.85])
def test_a_tone_in_the_pass_band_keeps_amplitude_and_phase(
    before: int, after: int, fraction: float
) -> None:
    frequency = fraction * min(before, after) / 2
    result = resampled(tone(frequency, before), before, after)
    assert inner(result) == pytest.approx(inner(tone(frequency, after)), abs=1e-3)


@pytest.mark.parametrize(("before", "after"), [pair for pair in RATES if pair[0] > pair[1]])
@pytest.mark.parametrize("fraction", [1.001, 1.1, 1.37])
def test_a_tone_above_the_new_nyquist_frequency_is_gone(
    before: int, after: int, fraction: float
) -> None:
    result = resampled(tone(fraction * after / 2, before), before, after)
    assert np.abs(inner(result)).max() < 10 ** (-60 / 20)


@pytest.mark.parametrize("fraction", [0.3, 0.85])
def test_a_higher_rate_brings_no_image(fraction: float) -> None:
    result = resampled(tone(fraction * 500.0, 1000), 1000, 4000)
    spectrum = np.abs(np.fft.rfft(result * np.blackman(len(result))))
    frequency = np.fft.rfftfreq(len(result), 1 / 4000)
    assert spectrum[frequency > 501.0].max() < 10 ** (-60 / 20) * spectrum.max()


@pytest.mark.parametrize(("before", "after"), RATES)
def test_an_offset_and_a_drift_stay_to_the_very_ends(before: int, after: int) -> None:
    drift = np.linspace(9.0, 11.0, 2 * before, endpoint=False)
    expected = np.linspace(9.0, 11.0, 2 * after, endpoint=False)
    assert resampled(drift, before, after) == pytest.approx(expected, abs=1e-2)


@settings(max_examples=30, deadline=None)
@given(st.floats(10.0, 1e4), st.floats(10.0, 1e4))
def test_any_two_rates_give_about_the_right_length(before: float, after: float) -> None:
    result = resampled(np.ones(300), before, after)
    assert len(result) == pytest.approx(300 * after / before, rel=2e-4, abs=1.0)
    assert result == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("rate", [0.0, -1.0, 1e7, math.nan, math.inf])
def test_unfit_rates_are_refused(rate: float) -> None:
    with pytest.raises(ParameterError, match=r"^recording_rate = .*: must be from 10 to 1e"):
        resampled(np.ones(9), rate, 1000.0)
    with pytest.raises(ParameterError, match=r"^rate = .*: must be from 10 to 1e"):
        resampled(np.ones(9), 1000.0, rate)
    with pytest.raises(ParameterError, match=r"^rate = "):
        crossfaded(np.ones(9), rate)


# CSV


def test_default_column_is_the_first_of_the_known_names(tmp_path: Path) -> None:
    columns = {"a": np.full(100, 4.0), "accel": np.full(100, 2.0), "acc": np.full(100, 3.0)}
    path = write_csv(tmp_path / "a.csv", columns)
    assert read_recording(path, 100.0, 100.0)[0] == 2.0
    assert read_recording(path, 100.0, 100.0, "")[0] == 2.0
    assert read_recording(path, 100.0, 100.0, "acc")[0] == 3.0


def test_three_columns_are_x_y_and_z(tmp_path: Path) -> None:
    columns = {"t": np.arange(100) / 100.0, "ax [g]": np.ones(100)}
    columns |= {"ay": np.full(100, 2.0), "az": np.full(100, 3.0)}
    path = write_csv(tmp_path / "a.csv", columns)
    found = read_recording(path, 0.0, 100.0, "az,ax, ay", most_columns=3)
    assert found == pytest.approx(np.tile((3.0, 9.80665, 2.0), (100, 1)))
    assert "column = az,ax,ay: must be one column here" in refusal(path, 0.0, 100.0, "az,ax,ay")
    samples = np.array([[2**14, 0, -(2**14)]] * 100, dtype=np.int16)
    wavfile.write(tmp_path / "a.wav", 100, samples)
    found = read_recording(tmp_path / "a.wav", 0.0, 100.0, "3,2,1", 2.0, most_columns=3)
    assert found == pytest.approx(np.tile((-1.0, 0.0, 1.0), (100, 1)))


@pytest.mark.parametrize("column", ["ax,ay", "ax,,az", "ax,ay,az,ax", "ax,ay,aw", ","])
def test_another_number_of_columns_is_refused(tmp_path: Path, column: str) -> None:
    path = write_csv(tmp_path / "a.csv", {name: np.zeros(100) for name in ("ax", "ay", "az")})
    message = refusal(path, 100.0, 100.0, column)
    assert (
        "no such column; there are ax, ay, az; choose one with recording_column:=NAME" in message
    )
    assert message.endswith(", or x, y and z with NAME,NAME,NAME") == (column != "ax,ay,aw")


def test_only_the_wanted_column_must_be_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("note,accel\n" + "start,1\n" * 100)
    assert read_recording(path, 100.0, 100.0).tolist() == [1.0] * 100


def test_a_result_too_long_is_refused_before_it_is_made(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", {"accel": np.zeros(1000)})
    message = refusal(path, 10.0, 1e6)
    assert message == f"{path}: 100 s are 1e+08 samples at 1e+06 Hz, must be at most 20000000"


@pytest.mark.parametrize("suffix", ["csv", "wav"])
def test_glitches_are_replaced_and_counted_in_one_line(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, suffix: str
) -> None:
    true = tone(30.0, 1000.0)
    damaged = true.copy()
    damaged[[700, 1500, 1501, 1502]] = -400.0
    path = tmp_path / f"a.{suffix}"
    if suffix == "wav":
        true, damaged = true * FULL_SCALE / 500, damaged * FULL_SCALE / 500
        wavfile.write(path, 1000, damaged / FULL_SCALE)
    else:
        write_csv(path, {"accel": damaged})
    assert read_recording(path, 1000.0, 1000.0) == pytest.approx(true, abs=0.1)
    assert caplog.messages == [
        f"{path}: 4 of 3000 samples are outliers: replaced by interpolation"
    ]


NOISE = np.random.default_rng(6).normal(size=4000)
EIGHT_BITS = np.round(40 * NOISE) / 127
MADE = {
    "tone": (tone(30.0, 1000.0), []),
    "steps of a converter": (np.round(20 * tone(31.7, 1000.0)), []),
    "quiet": (np.round(0.6 * NOISE), []),
    "taps": (np.where(np.arange(4000) % 40 < 30, NOISE, 0.0), []),
    "8 bits": (EIGHT_BITS, []),
    "clipped": (np.clip(NOISE, -2.0, 1.5), ["88 samples at -2", "283 samples at 1.5"]),
    "clipped, 8 bits": (np.minimum(EIGHT_BITS, 0.5), ["samples at 0.5"]),
    "held": (np.repeat(NOISE, 2), ["held for 2 samples", "about 500 Hz, not 1000 Hz"]),
    "held unevenly": (NOISE[np.arange(9000) * 2 // 5], ["held for 2.5 samples"]),
}


@pytest.mark.parametrize("kind", MADE)
def test_a_recording_shows_the_limits_of_its_sensor(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, kind: str
) -> None:
    samples, words = MADE[kind]
    read_recording(write_csv(tmp_path / "a.csv", {"accel": samples}), 1000.0, 1000.0)
    told = " ".join(caplog.messages).replace(" are at the extreme ", " at ")
    assert all(each in told for each in words), told
    assert bool(words) == bool(told)


def test_axes_that_do_not_work_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write_csv(tmp_path / "a.csv", {"x": NOISE, "y": NOISE[::-1] / 20, "z": 0 * NOISE})
    read_recording(path, 1000.0, 1000.0, "x,y,z", most_columns=3)
    (told,) = caplog.messages
    assert told.startswith(f"{path}: z: has a standard deviation of 0 m/s^2, another axis 1")


def test_a_recording_full_of_glitches_is_refused(tmp_path: Path) -> None:
    samples = tone(30.0, 1000.0)
    samples[20::70] = 1e5
    path = write_csv(tmp_path / "a.csv", {"accel": samples})
    assert f"{path}: accel: 43 of 3000 samples are outliers: must be at most 1 %" in refusal(
        path, 1000.0, 1000.0, "accel"
    )


# Times, units and decimal signs


def with_times(path: Path, title: str, times: FloatArray, form: str = "%.9g") -> Path:
    table = np.column_stack([times, tone(30.0, 2000.0, len(times) / 2000.0)])
    np.savetxt(path, table, form, ",", header=f"{title},acceleration", comments="")
    return path


TIMES = {"time": 1.0, "t [ms]": 1e-3, "timestamp_us": 1e-6, "Stamp (ns)": 1e-9, "%time": 1e-9}
OTHER_TIMES = {
    **{"Zeit (s)": 1.0, "X_Value": 1.0, "micros": 1e-6, "epoc (ms)": 1e-3, "Temps [Sec]": 1.0}
}
TIMES |= OTHER_TIMES


@pytest.mark.parametrize("title", TIMES)
def test_times_give_the_rate_and_must_agree_with_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, title: str
) -> None:
    times = np.arange(4000) / 2000.0 / TIMES[title]
    path = with_times(tmp_path / "a.csv", title, times)
    assert len(read_recording(path, 2000.0, 1000.0)) == 2000
    says = f"{path}: column {title} says 2000 Hz, recording_rate = 4000: must agree"
    assert refusal(path, 4000.0, 1000.0).startswith(says)
    assert not caplog.messages
    if title == "%time":
        assert "must state it, such as time_ms" in refusal(path, 0.0, 1000.0)
    else:
        assert len(read_recording(path, 0.0, 1000.0)) == 2000
    named = [f"{path}: column {title} is taken as the times, in "] if title in OTHER_TIMES else []
    assert [message[: len(named[0])] for message in caplog.messages] == named


@pytest.mark.parametrize(
    ("title", "values", "told"),
    [
        ("n", np.arange(4000), 0),
        ("delay [ms]", np.random.default_rng(2).normal(size=4000), 0),
        ("temperature", 20 + np.sqrt(np.arange(4000)), 0),
        ("acc_min", -np.arange(4000.0), 0),
        ("x [mm]", 0.05 * np.arange(4000), 1),
        ("Zeit (Sek)", 0.0005 * np.arange(4000), 1),
    ],
)
def test_columns_that_are_no_times_or_have_no_known_unit_contradict_no_rate(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, title: str, values: FloatArray, told: int
) -> None:
    path = with_times(tmp_path / "a.csv", title, values)
    assert len(read_recording(path, 1000.0, 1000.0)) == 4000
    assert [message.endswith("not compared with the rate") for message in caplog.messages] == (
        [True] * told
    )


@pytest.mark.parametrize("kind", ["coarse", "coarser", "epoch", "jitter"])
def test_rounded_and_jittering_times_are_times(tmp_path: Path, kind: str) -> None:
    times = np.arange(4000) / 2000.0
    jitter = np.random.default_rng(1).uniform(-0.04, 0.04, 4000) / 2000.0
    made = {
        "coarse": np.arange(4000) // 2 / 1e3,
        "coarser": np.floor(times * 1e3) / 1e3,
        "epoch": times + 1.7e9,
        "jitter": times + jitter,
    }
    path = with_times(tmp_path / "a.csv", "time_s", made[kind], "%.7f")
    assert len(read_recording(path, 0.0, 1000.0)) == pytest.approx(2000, abs=2)
    assert len(read_recording(path, 2000.0, 1000.0)) == 2000
    assert "must agree" in refusal(path, 2100.0, 1000.0)


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (lambda t: np.where(t > 1.0, t - 0.3, t), "goes back at line 2003, from 1 to 0.7005"),
        (lambda t: np.where(t > 1.0, t + 0.3, t), "is uneven: .* 0.3005 before line 2003"),
        (lambda t: t**2, "is uneven"),
        (lambda t: 0 * t, "is always 0: must rise"),
        (lambda t: 200 * t, "says 10 Hz, recording_rate = 2000: must agree"),
    ],
)
def test_times_that_contradict_a_constant_rate_are_refused(
    tmp_path: Path, times: Callable[[FloatArray], FloatArray], words: str
) -> None:
    path = with_times(tmp_path / "a.csv", "time_s", times(np.arange(4000) / 2000.0))
    message = refusal(path, 2000.0, 1000.0)
    assert message.startswith(f"{path}: column time_s ")
    assert re.search(words, message)


def test_few_missing_samples_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    times = np.delete(np.arange(4000), [1000, 2000]) / 2000.0
    read_recording(path := with_times(tmp_path / "a.csv", "t", times), 0.0, 2000.0)
    assert caplog.messages == [
        f"{path}: column t: 2 of 3997 steps are not 0.0005, such as 0.001 before line 1002:"
        " samples are taken as even"
    ]


def test_times_that_are_no_numbers_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,a\n" + "2026-11-27 01:02:03,1\n" * 20)
    assert len(read_recording(path, 10.0, 10.0)) == 20
    assert "not compared with the rate" in caplog.text
    assert "recording_rate = 0: must be given" in refusal(path, 0.0, 10.0)


G = 9.80665
UNITS = {
    **{"a [g]": G, "acc_mg": G / 1000, "accel_g": G, "acceleration (mm/s^2)": 1e-3},
    **{"acceleration m/s\u00b2": 1.0, "acceleration_m_s2": 1.0, "accel [m s^-2]": 1.0},
    **{"acc_ms2": 1.0, "acc / (ft/s\u00b2)": 0.3048, "acc in g": G, "acc(x)": 1.0, "acc": 1.0},
}


@pytest.mark.parametrize("title", UNITS)
def test_a_unit_in_a_title_is_converted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, title: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"speed;{title}\n" + "1;2.5\n" * 20)
    chosen = {"acc(x)": "acc(x)"}.get(title, "")
    assert read_recording(path, 10.0, 10.0, chosen) == pytest.approx([2.5 * UNITS[title]] * 20)
    assert read_recording(path, 10.0, 10.0, title) == pytest.approx([2.5 * UNITS[title]] * 20)
    told = [] if UNITS[title] == 1.0 else [f"{path}: column {title}: converted from "]
    assert [message[: len(told[0])] for message in caplog.messages] == told


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read_where_no_comma_separates(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"n{separator}a\n" + f"1{separator}-1,0484\n" * 20)
    assert read_recording(path, 10.0, 10.0).tolist() == [-1.0484] * 20
    path.write_text(path.read_text() + f"1{separator}2.5\n")
    assert "line 22: a = '2.5': must be a number" in refusal(path, 10.0, 10.0)
    assert "with ',' for decimals" in refusal(path, 10.0, 10.0)


def test_comments_are_searched_for_another_rate(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("# by hand\n" * 200 + "a\n" + "2.5\n# Abtastrate: 2 kHz\n" * 2000)
    for rate, used in ((2000.0, ""), (1000.0, ", though 1000 Hz is used")):
        read_recording(path, rate, 1000.0)
        assert caplog.messages[-1].endswith(f"such as # Abtastrate: 2 kHz{used}")


@pytest.mark.parametrize("separator", ["   ", ",", ";", "\t"])
def test_columns_without_titles_have_numbers(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, separator: str
) -> None:
    path = tmp_path / "a.txt"
    rows = [f" {at / 500:.7e}{separator}{math.sin(at):.7e}" for at in range(1000)]
    path.write_text("\n".join(rows))
    found = read_recording(path, 0.0, 500.0)
    assert found == pytest.approx(np.sin(np.arange(1000)), abs=1e-6)
    assert caplog.messages == [
        f"{path}: column 2: taken as the acceleration",
        f"{path}: column 1 is taken as the times, in s: 500 Hz",
    ]
    assert np.array_equal(read_recording(path, 500.0, 500.0, "2"), found)
    assert "column 1 says 500 Hz, recording_rate = 800" in refusal(path, 800.0, 800.0)


def test_titles_in_a_comment_are_titles(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.csv", np.full((20, 2), 2.5), delimiter=",", header="speed,a [g]")
    assert read_recording(tmp_path / "a.csv", 10.0, 10.0) == pytest.approx([2.5 * G] * 20)


# Files


def wav(count: int = 2000) -> bytes:
    """Return a WAV file of silence in 16 bits at 1 kHz."""
    write_wav(buffer := io.BytesIO(), 1000, np.zeros(count), "int16")
    return buffer.getvalue()


MANY = b"\x88\x13\0\0"
"""5000, as a size in a WAV file."""

EXPORTED = (b"LabVIEW Measurement\t\r\n", b"TDSm\0", b"MATLAB 5.0 MAT-file\0", b"\x89HDF\0")


WITHOUT_UNIT = r"must be in m/s\^2, mm/s\^2, g or mg, or without a unit"
COMMAS = "-1,0484\n" * 20
IN_COMMAS = "line 3: .*decimal commas need semicolons or tabs between columns$"


@pytest.mark.parametrize(
    ("content", "rate", "words"),
    [
        *(
            (
                f"{title}\n" + "2.5\n" * 20,
                10.0,
                f"column {re.escape(title)} is in .*{WITHOUT_UNIT}",
            )
            for title in ("acc [V]", "a_counts", "accel (LSB)", "acc_raw", "a [m/s]")
        ),
        *((f"{acc},\n2,\n{COMMAS}", 10.0, IN_COMMAS) for acc in ("acceleration", '"accel",""')),
        (f"acceleration\n2\n{COMMAS}", 10.0, IN_COMMAS),
        ("accel,accel\n" + "1,2\n" * 100, 100.0, "accel: exists more than once"),
        ("accel,speed\n1,2\n1,2,3\n", 100.0, "line 3: '3' in a column without a title"),
        ('accel,speed\n1,"2\n' + "1,2\n" * 100, 100.0, "must be comma-separated values$"),
        ("accel\n", 100.0, "0 samples"),
        ("a\n" + "0\n" * 99, 100.0, "99 samples at 100 Hz last 0.99 s, must be at least 1 s$"),
        ("accel\n" + "0\n" * 999, 0.0, "^recording_rate = 0: must be given for a CSV file"),
        ("speed,b\n0,0\n", 100.0, "= acceleration or accel or acc or a: no such column"),
        ("speed,b\n0,0\n", 100.0, "there are speed, b; choose one with recording_column:=NAME$"),
        ("1.5,2.5\n" * 100, 100.0, "has no titles, but columns 1, 2: choose one with "),
        *(("", rate, f"^recording_rate = {rate}: must be from 10 to") for rate in (1.0, math.nan)),
        (b"", 100.0, "is empty"),
        ("n;a\n" + "0;1\n" * 9 + "0;1e7\n" * 9, 100.0, "line 11: a = '1e7': must be a number"),
        *((each, 9e3, "is not text") for each in (b"\xff\xfe\x00", b"\x89PNG\r\n", b"a\n1\0\n")),
        *((each, 0.0, "is not a WAV file") for each in (b"RIFX", b"RIFF\x04\0\0\0WAVE")),
        *((wav(count), 0.0, "must be at least 1 s") for count in (0, 999)),
        (wav()[:40] + MANY + wav()[44:], 0.0, "have 5000 bytes, but it ends after 4000"),
        (wav()[:28] + MANY + wav()[32:], 0.0, "its format is unknown, or contradicts"),
        (wav()[:4] + bytes(4) + wav()[8:] + wav()[36:], 0.0, "has 2 chunks 'data': must have one"),
        (wav()[:3000], 0.0, "is cut off after 3000 bytes, its header says 4044"),
        *((each, 0.0, "MAT or HDF5 file: export its table as text") for each in EXPORTED),
        (f"{LFS}\noid sha256:0\n", 0.0, "is a pointer of Git LFS.* git lfs pull, must be"),
    ],
)
def test_what_cannot_be_read_is_refused(
    tmp_path: Path, content: str | bytes, rate: float, words: str
) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    message = refusal(path, rate, 100.0)
    assert re.search(words, message)
    assert words.startswith("^") or message.startswith(f"{path}: ")


def test_too_many_samples_are_refused_before_they_are_decoded(tmp_path: Path) -> None:
    whole = tmp_path / "a.wav"
    with whole.open("wb") as file:
        file.write(wav(1)[:4] + bytes(4) + wav(1)[8:40] + bytes(4))
        file.truncate(100_000_000)
    with measured(megabytes=250):
        assert "99999956 bytes of 1 channels: must be at most" in refusal(whole, 0.0, 1000.0)


@pytest.mark.parametrize("name", ["a\0b", "a\nb", "x" * 5000, "", "none.csv", "/"])
def test_impossible_names_are_refused(name: str) -> None:
    words = {
        "": "^recording = ''",
        "none.csv": "No such file",
        "/": "is a folder, must be a CSV or",
    }
    assert re.search(words.get(name, ""), refusal(name, 1000.0, 1000.0))


# WAV


@pytest.mark.parametrize("dtype", ["uint8", "int16", "int32"])
def test_full_scale_of_integer_samples(tmp_path: Path, dtype: str) -> None:
    limits = np.iinfo(dtype)
    middle = 128 if dtype == "uint8" else 0
    samples = np.array([limits.min, middle, middle + limits.max // 4] * 400, dtype=dtype)
    path = tmp_path / "a.wav"
    wavfile.write(path, 1000, samples)
    found = read_recording(path, 0.0, 1000.0)
    assert found[0] == pytest.approx(-FULL_SCALE)
    assert found[1] == 0.0
    expected = (limits.max // 4) / (limits.max - middle + 1)
    assert found[2] == pytest.approx(expected * FULL_SCALE)
    assert read_recording(path, 0.0, 1000.0, full_scale=2.0)[0] == pytest.approx(-2.0)


def test_samples_beyond_full_scale_are_refused_or_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.wav"
    wavfile.write(path, 1000, np.full(2000, -12.5))
    assert "samples reach 12.5, beyond the full scale of 1" in refusal(path, 0.0, 1000.0)
    assert read_recording(path, 0.0, 1000.0, full_scale=1.0).tolist() == [-12.5] * 2000
    assert caplog.messages == [
        f"{path}: samples reach 12.5, beyond the full scale of 1: read as up to 12.5 m/s^2"
    ]


def test_channel_of_a_wav(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    wavfile.write(path, 1000, np.tile([0.1, 0.2, 0.3], (1000, 1)))
    assert read_recording(path, 0.0, 1000.0)[0] == pytest.approx(0.1 * FULL_SCALE)
    assert read_recording(path, 0.0, 1000.0, "3")[0] == pytest.approx(0.3 * FULL_SCALE)
    assert "no such channel; there are 1, 2, 3" in refusal(path, 0.0, 1000.0, "4")
    assert "channel = accel: no such channel" in refusal(path, 0.0, 1000.0, "accel")


def test_the_channel_with_a_signal_is_read_and_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "a.wav"
    right = np.column_stack([0 * NOISE, 0.1 * NOISE])
    for samples, channel in ((right, 2), (right[:, ::-1], 1), (0 * right, 1)):
        wavfile.write(path, 1000, samples)
        found = read_recording(path, 0.0, 1000.0, full_scale=1.0)
        assert np.array_equal(found, samples[:, channel - 1])
        spreads = ", ".join(f"{each:.2g}" for each in samples.std(axis=0))
        assert caplog.messages[-1] == (
            f"{path}: channel {channel} of 2 is read; their standard deviations are {spreads} of"
            " full scale; choose another with recording_column:=NAME"
        )


ODD = b"bext" + (3).to_bytes(4, "little") + b"xxx"


@pytest.mark.parametrize(
    "changed",
    [
        lambda whole: whole[:4] + bytes(4) + whole[8:],
        lambda whole: whole[:4] + bytes(4) + whole[8:40] + bytes(4) + whole[44:],
        lambda whole: whole[:4] + b"\xff" * 4 + whole[8:40] + b"\xff" * 4 + whole[44:],
        lambda whole: whole[:4] + b"\0\xf0\xff\x7f" + whole[8:40] + b"\0\xf0\xff\x7f" + whole[44:],
        lambda whole: whole[:4] + bytes(4) + whole[8:36] + ODD + whole[36:],
        lambda whole: whole[:4] + bytes(4) + whole[8:36] + ODD + b"\0" + whole[36:],
        lambda whole: whole + b"LIST",
        lambda whole: whole[:40] + (4000).to_bytes(4, "little") + whole[44:],
    ],
)
def test_a_wav_with_odd_sizes_is_read_whole_or_the_rest_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, changed: Callable[[bytes], bytes]
) -> None:
    write_wav(buffer := io.BytesIO(), 1000, 0.2 * NOISE, "int16")
    whole = buffer.getvalue()
    (path := tmp_path / "a.wav").write_bytes(whole)
    right = read_recording(path, 0.0, 1000.0)
    path.write_bytes(changed(whole))
    found = read_recording(path, 0.0, 1000.0)
    assert np.array_equal(found, right[: len(found)])
    told = {"2000": 4000, "4000": 4}[str(len(found))] if changed(whole)[4:8] == whole[4:8] else 0
    rest = [f"{path}: {told} bytes after its samples are not read"]
    assert caplog.messages == (rest if told else [])


NO_ACCELERATION = {math.nan: "nan", math.inf: "inf", 1e7: r"1e\+07"}


@pytest.mark.parametrize(
    ("value", "full_scale", "words"),
    [
        *((each, 1.0, rf": sample 7 = {text}: must be") for each, text in NO_ACCELERATION.items()),
        *((0.0, each, "^full_scale = ") for each in (0.0, -1.0, math.nan, math.inf)),
    ],
)
def test_a_wav_without_acceleration_and_an_unfit_full_scale_are_refused(
    tmp_path: Path, value: float, full_scale: float, words: str
) -> None:
    samples = np.zeros(1000)
    samples[7] = value
    wavfile.write(tmp_path / "a.wav", 1000, samples)
    assert re.search(words, refusal(tmp_path / "a.wav", 0.0, 1000.0, full_scale=full_scale))


def chunks(count: int) -> bytes:
    """Return a WAV file with empty chunks before its samples."""
    body = wav()[8:36] + (b"note" + bytes(4)) * count + wav()[36:]
    return b"RIFF" + len(body).to_bytes(4, "little") + body


def calls(read: Callable[[], object]) -> int:
    """Return the number of function calls."""
    profile = cProfile.Profile()
    profile.runcall(read)
    return sum(entry.callcount for entry in profile.getstats())


def test_work_for_empty_chunks_is_bounded(tmp_path: Path) -> None:
    paths = {count: tmp_path / f"{count}.wav" for count in (900, 2_000, 200_000)}
    for count, path in paths.items():
        path.write_bytes(chunks(count))
    assert len(read_recording(paths[900], 0.0, 1000.0)) == 2000
    few = calls(lambda: refusal(paths[2_000], 0.0, 1000.0))
    many = calls(lambda: refusal(paths[200_000], 0.0, 1000.0))
    assert "has more than 1000 chunks" in refusal(paths[200_000], 0.0, 1000.0)
    assert many < 1.1 * few


# Files


def test_a_huge_file_and_a_pipe_are_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "a.csv").open("wb") as file:
        file.truncate(recording.MOST_BYTES + 1)
    assert "has 300000001 bytes or more" in refusal(tmp_path / "a.csv", 1000.0, 1000.0)
    os.mkfifo(tmp_path / "pipe")
    assert "is not a regular file" in refusal(tmp_path / "pipe", 1000.0, 1000.0)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", {"accel": np.zeros(1000)})
    path.chmod(0)
    assert refusal(path, 1000.0, 1000.0).startswith(f"{path}: Permission denied")


def gives_an_array_or_one_line(path: Path, rate: float) -> None:
    samples = np.zeros(10)

    def read() -> None:
        nonlocal samples
        samples = read_recording(path, rate, rate or 20.0)

    with measured(), without_programs():
        accepted(read)
    assert samples.ndim == 1
    assert len(samples) >= 10
    assert np.all(np.isfinite(samples))


plain = st.floats(-1e6, 1e6).map(repr) | st.sampled_from(["1", "-1.5", ".5", "5.", "1e5", "+2E-3"])
cells = plain | st.sampled_from(ODD_TEXTS)


@st.composite
def tables(draw: st.DrawFn) -> str:
    delimiter, end = draw(st.sampled_from([",", ";", "\t", "|"])), draw(st.sampled_from(ENDS))
    titles = draw(st.sampled_from(["accel", "é,accel", 'a,"q"', "b,b", "X_Value,a", "t [ms],1"]))
    titles = titles.split(",")
    row = st.tuples(*[st.one_of(plain, plain, plain, cells)] * len(titles))
    rows = draw(st.lists(row, min_size=8, max_size=14))
    lines = [delimiter.join(row) for row in (titles, *rows)]
    return draw(st.sampled_from(["", "\ufeff", "\n", " "])) + end.join(lines)


ENDS = ("\n", "\r\n", "\r", "\n\n")
pieces = st.sampled_from([*ODD_TEXTS, ",", ";", '"', "\n", "\r", "\0", '",\n"', "\ufeff", "é"])


@fuzz
@given(
    mutated(tables() | st.text(max_size=200), pieces),
    st.sampled_from(["utf-8", "utf-16", "latin-1"]),
)
def test_any_damage_to_a_csv(tmp_path: Path, text: str, encoding: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding, "replace"))
    gives_an_array_or_one_line(path, 10.0)


@fuzz
@given(
    st.lists(
        cells.filter(lambda text: "\0" not in text and text != "1,5"), min_size=10, max_size=12
    )
)
def test_numbers_are_read_exactly_and_what_is_none_is_refused_with_its_line(
    tmp_path: Path, texts: list[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["n;accel", *(f"0;{text}" for text in texts)]), encoding="utf-8")
    wrong = [line for line, text in enumerate(texts, start=2) if text in ODD_TEXTS]
    if wrong:
        assert refusal(path, 10.0, 10.0).startswith(f"{path}: line {wrong[0]}: accel = ")
    else:
        assert read_recording(path, 10.0, 10.0).tolist() == list(map(float, texts))


LIES = (0, 1, 2, 3, 7, 8, 0x7FFF, 0xFFFE, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1)


@st.composite
def wav_files(draw: st.DrawFn) -> bytes:
    """Files of chunks, of which any number may be a lie, about its size too."""

    def field(truth: int, size: int) -> bytes:
        told = draw(st.sampled_from([*[truth] * 150, *LIES]))
        return (told % 256**size).to_bytes(size, "little")

    width, channels = draw(st.sampled_from([1, 2, 3, 4, 8])), draw(st.integers(1, 3))
    kind, frame = draw(st.sampled_from([1, 1, 3, 6, 0xFFFE])), width * channels
    data = draw(st.binary(min_size=8, max_size=8)) * (30 * frame // 8)
    form = field(kind, 2) + field(channels, 2) + field(20, 4) + field(20 * frame, 4)
    form += field(frame, 2) + field(8 * width, 2) + draw(st.sampled_from([b"", bytes(24)]))
    other = draw(st.sampled_from([b"LIST", b"fact", b"ds64", b"\0\0\0\0"])), bytes(draw(BYTES))
    chunks = [(b"fmt ", form), (b"data", data), other]
    chunks = chunks[:2] if draw(st.booleans()) else draw(st.permutations(chunks))
    body = b"WAVE" + b"".join(name + field(len(part), 4) + part for name, part in chunks)
    riff = draw(st.sampled_from([b"RIFF", b"RIFF", b"RIFX", b"RF64"]))
    return riff + field(len(body), 4) + body


BYTES = st.integers(0, 40)
wav_pieces = st.sampled_from([b"\0", b"\xff\xff\xff\xff", b"data", b"fmt ", b"RIFF", b"\x7f"])


@fuzz
@given(mutated(wav_files(), wav_pieces))
def test_any_lies_in_a_wav(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.wav"
    path.write_bytes(content)
    gives_an_array_or_one_line(path, 0.0)


# Loops


def seam(loop: FloatArray) -> float:
    """Size of the step from the last sample back to the first."""
    return float(abs(loop[0] - loop[-1]))


def test_a_loop_continues_as_the_original_did() -> None:
    original = tone(3.3, 1000.0) + 9.8
    loop = crossfaded(original, 1000.0, 0.1)
    assert np.array_equal(loop[:-100], original[100:-100])
    assert loop[-1] == pytest.approx(original[99])


def test_a_loop_keeps_offset_and_power() -> None:
    loop = crossfaded(np.random.default_rng(0).normal(9.8, 1.0, 200_000), 1000.0, seconds=99.0)
    assert len(loop) == 101_000
    assert loop.mean() == pytest.approx(9.8, abs=0.02)
    assert loop.std() == pytest.approx(1.0, rel=0.02)


@untimed
@given(
    arrays.arrays(np.float64, st.integers(2, 200), elements=st.floats(-1e6, 1e6)),
    st.floats(0.001, 0.1),
)
def test_the_seam_is_a_step_that_the_original_has(samples: FloatArray, seconds: float) -> None:
    seconds = min(seconds, (len(samples) - 1) // 2 / 1000.0)
    loop = crossfaded(samples, 1000.0, seconds)
    assert np.all(np.isfinite(loop))
    assert seam(loop) <= np.abs(np.diff(samples)).max() + 1e-6


@pytest.mark.parametrize("seconds", [-0.1, 0.5, math.nan, math.inf])
def test_a_fade_of_half_or_more_is_refused(seconds: float) -> None:
    with pytest.raises(ParameterError, match=r"^seconds = .*: must be from 0 to 0\.499 s$"):
        crossfaded(np.ones(1000), 1000.0, seconds)


@pytest.mark.parametrize("surface", ["plywood", "vinyl"])
def test_a_recording_of_a_surface_keeps_its_power(tmp_path: Path, surface: str) -> None:
    path = write_recording(tmp_path / f"{surface}.csv", surface)
    original = read_recording(path, 10_000, 10_000, "accel")
    result = read_recording(path, 10_000, 1000)
    assert len(original) == 19_000
    assert len(result) == 1900
    assert 0.5 < result.std() <= original.std()
    below = np.fft.rfftfreq(len(original), 1e-4) < 450.0
    power = np.abs(np.fft.rfft(original - original.mean())) ** 2
    assert result.var() >= 0.97 * original.var() * power[below].sum() / power.sum()
    loop = crossfaded(result, 1000)
    assert seam(loop) <= np.abs(np.diff(loop)).max()
