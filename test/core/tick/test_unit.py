# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The compiled tick: the bits of plain Python, and plain Python where it cannot be used."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import bit_generator
from setuptools import Distribution

from haptic_accel.core import tick
from nightly import rest_slow
from tick_bits import UNIT, differing_sums, differing_trials, first_difference, loaded
from tick_unit import PACKAGE, BuildUnit, built, extension, stamp


@pytest.fixture(scope="module", params=rest_slow([False, True]))
def unit(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the installed unit, and one that checks each index, which takes long to build."""
    for installed in Path(tick.__path__[0]).glob("_compiled*.so"):
        current = stamp(installed.parent).encode() in installed.read_bytes()
        if current and not request.param:
            return installed
    if not (find_spec("Cython") and (shutil.which("cc") or "CC" in os.environ)):
        pytest.skip("needs Cython and a C compiler")
    return built(tmp_path_factory.mktemp("unit"), boundscheck=request.param)


@pytest.mark.plain
def test_compiled_and_plain_give_the_same_bits(unit: Path) -> None:
    assert differing_trials(unit) == []
    assert differing_sums(loaded(unit)) == []

    @given(st.integers(0, 1 << 32), st.sampled_from(["z", "x, y, z"]))
    def of_the_safety_layer(seed: int, axes: str) -> None:
        assert first_difference(loaded(unit), 100, seed, axes) is None

    of_the_safety_layer()


@pytest.mark.plain
@pytest.mark.slow
@pytest.mark.parametrize("axes", ["z", "x, y, z"])
def test_a_million_ticks_of_the_safety_layer_keep_limits_and_bits(unit: Path, axes: str) -> None:
    assert first_difference(loaded(unit), 1_000_000, axes=axes) is None


def test_a_unit_is_built_again_for_other_text_whatever_the_dates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path.joinpath(*PACKAGE.split("."))
    folder.mkdir(parents=True)
    section = folder / "section.py"
    section.write_text("A = 1\n")
    monkeypatch.chdir(tmp_path)
    command = BuildUnit(Distribution({"name": "unit", "ext_modules": [extension()]}))
    command.build_lib = str(tmp_path / "lib")
    command.ensure_finalized()
    made = Path(command.get_ext_fullpath(extension().name))
    (folder / made.name).write_bytes(b"\0" + stamp(folder).encode() + b"\0")
    section.touch()
    command.build_extension(extension())
    assert made.exists()
    section.write_text("A = 2\n")
    os.utime(section, (0, 0))
    monkeypatch.setattr("tick_unit.c_text", lambda *_: pytest.exit("built"))
    with pytest.raises(pytest.exit.Exception, match="built"):
        command.build_extension(extension())


OTHER = Path(bit_generator.__file__).read_bytes()
"""Another extension of Python."""


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("x.py", b"DIGEST = ''", "it is of another version"),
        ("x.so", OTHER, "PyInit__compiled"),
        ("x.so", OTHER[:30_000], "x.so: the end of the file is missing"),
        ("x.so", OTHER[:18] + b"\xf3\0" + OTHER[20:], "x.so: "),  # RISC-V
        ("x.so", OTHER[:64] + os.urandom(len(OTHER)), "x.so: "),
    ],
)
def test_a_unit_that_cannot_be_used_costs_one_line(
    tmp_path: Path, name: str, content: bytes, told: str
) -> None:
    (tmp_path / name).write_bytes(content)
    found = f"find(name, {str(tmp_path / name)!r}) if name == {UNIT!r} else None"
    code = (
        "import sys; from importlib.util import spec_from_file_location as find\n"
        f"sys.meta_path.insert(0, type('', (), {{'find_spec': lambda name, *_: {found}}}))\n"
        "from haptic_accel.core.tick import TICK; print(TICK)"
    )
    use = {**os.environ, "HAPTIC_ACCEL_PLAIN": ""}
    done = subprocess.run([sys.executable, "-c", code], env=use, capture_output=True, text=True)
    assert (done.stdout, done.stderr.count("\n")) == ("plain Python\n", 1)
    assert told in done.stderr
