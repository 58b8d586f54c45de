# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture model files: YAML for people, NPZ for programs, with the same names and units.

The reader of NumPy array files checks the stated sizes before it reads the data.
"""

from __future__ import annotations

import io
import math
import struct
import warnings
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
import numpy.typing as npt
import yaml

from haptic_accel.core.document import Document, load_yaml, read_yaml_document
from haptic_accel.core.files import located, read_bytes
from haptic_accel.core.parameters import one_line, shown
from haptic_accel.core.surfaces.texture import Provenance, TextureModel

LARGEST_FILE = 1 << 26
"""Maximum size of a file, and of the contents of all its arrays, bytes."""

MOST_NUMBERS = 4_000_000
"""Maximum number of values in an array: three axes of acceleration at 10 kHz for two minutes."""

MOST_MEMBERS = 64
"""Maximum number of arrays in a file."""

LONGEST_DIRECTORY = 1 << 16
"""Maximum size of the table of contents, bytes: a thousand bytes per array."""

LONGEST_HEADER = 10_000
"""Maximum size of an array's header, bytes; equal to the limit of NumPy's readers."""

KINDS = "biufUS"
"""Permitted kinds of values: numbers and text. Objects could execute code."""

_END = struct.Struct("<4s4H2LH")  # end record of a ZIP file without comment
_FIRST = LONGEST_HEADER + 12  # maximum size of a header and its prefix

Array = npt.NDArray[np.generic]
T = TypeVar("T")


def read_array(path: Path) -> Array:
    """Return the array of an NPY file.

    Raises
    ------
    OSError
        See `core.files.opened` for the conditions.
    ValueError
        The file is not an NPY file, or is too large.
    """
    return _read(path, lambda content: _array(io.BytesIO(content), LARGEST_FILE))


def read_arrays(path: Path) -> dict[str, Array]:
    """Return the arrays of an NPZ file by name.

    Raises
    ------
    OSError
        See `core.files.opened` for the conditions.
    ValueError
        The file is not an NPZ file, or has too many or too large arrays.
    """
    return _read(path, _arrays)


def _read(path: Path, read: Callable[[bytes], T]) -> T:
    content = read_bytes(path, LARGEST_FILE)
    try:
        return read(content)
    except Exception as error:  # the readers of NumPy and `zipfile` raise a dozen kinds
        raise ValueError(one_line(error)) from None


def _arrays(content: bytes) -> dict[str, Array]:
    mark, *_, directory, _, comment = _END.unpack(content[-_END.size :])
    if mark != b"PK\5\6" or comment or content[-_END.size - 20 :].startswith(b"PK\6\7"):
        # With a comment, or in the format for more than 4 GB, the size could be stated elsewhere.
        raise ValueError("it must end as a ZIP file without a comment")
    if directory > LONGEST_DIRECTORY:
        raise ValueError(f"its table of contents has more than {LONGEST_DIRECTORY} bytes")
    found: dict[str, Array] = {}
    left = LARGEST_FILE
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        members = file.infolist()
        if len(members) > MOST_MEMBERS:
            raise ValueError(f"{len(members)} arrays; at most {MOST_MEMBERS} are allowed")
        for member in members:
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError("its compression method is not supported")
            with file.open(member) as stream:
                array = _array(stream, left)
            left -= array.nbytes
            found[member.filename.removesuffix(".npy")] = array
    return found


def _array(stream: IO[bytes], most_bytes: int) -> Array:
    """Return an array of a limited number of bytes."""
    start = stream.read(_FIRST)
    header = io.BytesIO(start)
    version = np.lib.format.read_magic(header)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"format version {version} is not supported")
    read = getattr(np.lib.format, f"read_array_header_{version[0]}_0")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about Python 2, or unusual text in the header
        shape, is_fortran, kind = read(header, max_header_size=LONGEST_HEADER)
    if kind.kind not in KINDS or kind.subdtype:
        raise ValueError(f"values of type {str(kind)[:40]} are not supported")
    count = math.prod(shape)
    if not (min(shape, default=0) >= 0 and count <= MOST_NUMBERS):
        raise ValueError(f"it has {shape} values; at most {MOST_NUMBERS} are allowed")
    size = count * kind.itemsize
    if size > most_bytes:
        raise ValueError(
            f"its values have {size} bytes or more; at most {LARGEST_FILE} are allowed"
        )
    data = bytearray(start[header.tell() :])
    if len(data) < size:
        data += stream.read(size - len(data))
    if len(data) != size or stream.read(1):  # also checks the checksum
        raise ValueError("its data are truncated, or longer than its header states")
    return np.frombuffer(data, kind, count).reshape(shape, order="F" if is_fortran else "C")


UNITS = {
    **{"rate": "Hz", "speeds": "m/s", "forces": "N", "deviation": "m/s^2"},
    **dict.fromkeys(("lsf", "ma_lsf"), "rad/sample"),
}
"""Units of the numbers in a file, as stated in the file."""

ARRAYS = ("speeds", "forces", "deviation", "gain", "lsf", "ma_lsf")
OPTIONAL = ("gain", "ma_lsf", "coulomb_friction")
NAMES = ("name", "rate", "units", "provenance", "coulomb_friction", *ARRAYS)

DIGITS = 7
"""Significant digits of numbers in a YAML file; the rounding error is a tenth of that of single
precision."""


def read_texture(path: Path) -> TextureModel:
    """Read a texture model.

    Raises
    ------
    ParameterError
        The message is one line with the file, the name, the invalid value and the allowed values.
    """
    return _model(read_npz(path) if path.suffix == ".npz" else read_yaml_document(path))


def write_texture(path: Path, model: TextureModel) -> None:
    """Write a texture model as NPZ or, for other suffixes, YAML.

    Raises
    ------
    ParameterError
        The file cannot be written; the message gives the reason.
    """
    arrays = {name: getattr(model, name) for name in ARRAYS if name not in OPTIONAL}
    if model.ma_lsf.size:
        arrays |= {name: getattr(model, name) for name in ("gain", "ma_lsf")}
    about = {
        "name": model.name,
        "rate": model.rate,
        "units": {name: unit for name, unit in UNITS.items() if name in (*arrays, "rate")},
        "provenance": asdict(model.provenance),
    }
    if model.coulomb_friction is not None:
        about["coulomb_friction"] = model.coulomb_friction
    with located(shown(str(path)), unreadable=""):
        if path.suffix == ".npz":
            np.savez_compressed(path, about=yaml.safe_dump(about, sort_keys=False), **arrays)
        else:
            content = about | _rounded(arrays)
            text = yaml.safe_dump(  # each row of numbers in one line
                content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=100
            )
            path.write_text(text, encoding="utf-8")


def _rounded(arrays: Mapping[str, Any]) -> dict[str, Any]:
    plain = np.vectorize(lambda value: float(f"{value:.{DIGITS}g}"), otypes=[float])
    return {name: plain(values).tolist() for name, values in arrays.items()}


def read_npz(path: Path) -> Document:
    """Return the arrays of a file by name, with the YAML data in its text ``about``.

    Raises
    ------
    ParameterError
        The file cannot be read.
    """
    with located(shown(str(path)), "must be NPZ"):
        arrays = read_arrays(path)
        about = load_yaml(str(arrays.pop("about", "")), exponents=True)
    content = {name: each if each.ndim else each.item() for name, each in arrays.items()}
    return Document(path, {**(about if isinstance(about, dict) else {}), **content})


def _model(file: Document) -> TextureModel:
    """Return the model from a file."""
    file.check_keys(*NAMES)
    units, provenance = file.at("units"), file.at("provenance")
    units.check_keys(*UNITS)
    for name, unit in units.members():
        if unit.value != UNITS[name]:
            unit.wrong(f"must be {UNITS[name]}")
    provenance.check_keys(*(each.name for each in fields(Provenance)))
    friction = file.get("coulomb_friction")
    values: dict[str, Any] = {
        "name": file.at("name").text(),
        "rate": file.at("rate").number(),
        "coulomb_friction": None if friction.value is None else friction.number(),
        "provenance": Provenance(**{name: each.text() for name, each in provenance.members()}),
    }
    arrays = [name for name in ARRAYS if name in file or name not in OPTIONAL]
    values |= {name: file.at(name).array() for name in arrays}
    with file.located():
        return TextureModel(**values)
