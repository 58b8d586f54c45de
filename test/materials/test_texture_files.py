# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture models as files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from archive_bombs import BOMBS, header
from fuzzing import measured
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.surfaces.texture import Provenance, TextureModel
from haptic_accel.materials import texture_files
from haptic_accel.materials.scenes import Sampling, read_heights, read_taps

ARRAYS: dict[str, Any] = {
    "whole": np.arange(6, dtype=np.int16).reshape(2, 3),
    "columns": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "one": np.float64(3.0),
    "texts": np.array(["left", "r\u00fcck"]),
    "truth": np.array([True, False]),
    "other order": np.array([1.5, 2.5], dtype=">f8"),
    "none": np.empty((0, 3)),
}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_are_read_as_they_were(tmp_path: Path, save: Callable[..., None]) -> None:
    save(tmp_path / "a.npz", **ARRAYS)
    found = texture_files.read_arrays(tmp_path / "a.npz")
    assert list(found) == list(ARRAYS)
    for name, values in ARRAYS.items():
        np.testing.assert_array_equal(found[name], values)
        assert found[name].dtype == np.asarray(values).dtype
        np.save(tmp_path / "a.npy", values)
        np.testing.assert_array_equal(texture_files.read_array(tmp_path / "a.npy"), values)


@pytest.mark.parametrize("kind", BOMBS)
def test_a_file_that_expands_or_is_none_is_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = BOMBS[kind](tmp_path / "a.npz")
    for read in (texture_files.read_texture, read_taps):
        with measured(megabytes=300), pytest.raises(ParameterError, match="a.npz: ") as refused:
            read(path)
        assert str(refused.value).isprintable()


def test_a_table_of_a_size_that_no_file_has_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "relief.npy"
    with path.open("wb") as file:
        file.write(header((30_000, 30_000)))
        file.truncate(6_500_000_000)
    with (
        measured(megabytes=300),
        pytest.raises(ParameterError, match="at most 67108864 are allowed"),
    ):
        read_heights(path, Sampling())
    for shape in ((30_000, 30_000), (texture_files.MOST_NUMBERS + 1,)):
        path.write_bytes(header(shape) + bytes(1000))
        with measured(megabytes=300), pytest.raises(ParameterError, match="4000000 are allowed"):
            read_heights(path, Sampling())
    assert texture_files.MOST_MEMBERS == 64


ABOUT = Provenance("two strokes", "CC0-1.0", "somebody", "±5 g by gravity")


def model(**changed: object) -> TextureModel:
    values = {
        "name": "oak: new",
        "rate": 1000.0,
        "speeds": np.array([0.0, 0.1, 0.1, 1 / 3]),
        "forces": np.array([0.0, 0.5, 2.0, 1.0]),
        "lsf": np.array([[0.5, 1.5], [0.6, 1 / 0.7], [0.7, 2.0], [0.1, 3.1]]),
        "deviation": np.array([0.0, 1e-5, 0.5, 1.0]),
        "coulomb_friction": 0.3,
        "provenance": ABOUT,
    }
    return TextureModel(**{**values, **changed})  # type: ignore[arg-type]


@pytest.mark.parametrize("form", ["yaml", "npz"])
@pytest.mark.parametrize(
    "changed",
    [{}, {"coulomb_friction": None}, {"ma_lsf": np.full((4, 1), 1.5), "gain": np.full(4, 2.0)}],
    ids=["AR", "no friction", "ARMA"],
)
def test_a_file_holds_the_whole_model(
    tmp_path: Path, form: str, changed: dict[str, object]
) -> None:
    written = model(**changed)
    file = tmp_path / f"oak.{form}"
    texture_files.write_texture(file, written)
    found = texture_files.read_texture(file)
    assert (found.name, found.rate, found.provenance) == ("oak: new", 1000.0, ABOUT)
    assert found.coulomb_friction == written.coulomb_friction
    for name in ("speeds", "forces", "lsf", "deviation", "ma_lsf", "gain"):
        np.testing.assert_allclose(getattr(found, name), getattr(written, name), rtol=1e-6)


def test_the_file_states_units_and_licence(tmp_path: Path) -> None:
    texture_files.write_texture(tmp_path / "oak.yaml", model())
    content = yaml.safe_load((tmp_path / "oak.yaml").read_text())
    assert content["units"]["speeds"] == "m/s"
    assert content["provenance"]["licence"] == "CC0-1.0"


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("units", {"speeds": "mm/s"}, "units.speeds = 'mm/s': must be m/s"),
        ("rate", "fast", "rate = 'fast': must be a finite number"),
        ("rate", -1.0, "rate = -1.0: must be above 0 Hz"),
        ("speeds", [0.0, 0.1], "forces"),
        ("lsf", [[0.5, 1.5], [0.6]], "lsf = .*: must be numbers, in rows"),
        ("lsf", [[1.5, 0.5] for _ in range(4)], "lsf: must increase"),
        ("deviation", [0.0, -1.0, 1.0, 1.0], "deviation = -1: must be"),
        ("provenance", {"license": "MIT"}, r"provenance.license: unknown \(did you mean licence"),
        ("forcs", [1.0], r"forcs: unknown \(did you mean forces"),
        ("lsf", None, "lsf = nothing: must be given"),
    ],
)
def test_a_wrong_file_is_refused_with_file_name_and_range(
    tmp_path: Path, name: str, value: object, says: str
) -> None:
    file = tmp_path / "oak.yaml"
    texture_files.write_texture(file, model())
    content = yaml.safe_load(file.read_text())
    if value is None:
        del content[name]
    else:
        content[name] = value
    file.write_text(yaml.safe_dump(content))
    with pytest.raises(ParameterError, match=rf"oak\.yaml:\d+: .*{says}") as refused:
        texture_files.read_texture(file)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("content", [b"", b"[1, 2]", b"\xff\xfe", b"a: *b", b"PK\x03\x04rubbish"])
@pytest.mark.parametrize("form", ["yaml", "npz"])
def test_what_is_no_model_is_refused(tmp_path: Path, form: str, content: bytes) -> None:
    file = tmp_path / f"oak.{form}"
    file.write_bytes(content)
    with pytest.raises(ParameterError, match=rf"oak\.{form}:"):
        texture_files.read_texture(file)
