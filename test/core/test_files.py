# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bounded reading of files, and complete writing."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_accel.core.files import (
    DEEPEST,
    LARGEST_TEXT,
    MOST_VALUES,
    located,
    opened,
    read_bytes,
    read_json,
    read_text,
    read_xml,
    whole_folder,
)
from haptic_accel.core.parameters import ParameterError

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:0\n"


def make_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (os.mkfifo, "is not a regular file"),
        (make_socket, "."),
        (lambda path: path.symlink_to("/dev/zero"), "is not a regular file"),
        (Path.mkdir, "is a folder"),
        (lambda path: path.symlink_to(path), "Too many levels"),
        (lambda path: None, "No such file"),
        (lambda path: path.write_text(POINTER + "size 9\n"), "is a pointer of Git LFS"),
    ],
)
def test_what_is_no_file_is_refused_without_waiting(
    tmp_path: Path, make: Callable[[Path], None], says: str
) -> None:
    make(tmp_path / "file")
    with pytest.raises(OSError, match=says):
        read_bytes(tmp_path / "file")


def test_a_name_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(OSError, match="null"):
        read_bytes("a\0b")


def test_a_file_without_a_size_is_read_up_to_the_limit() -> None:
    assert read_text("/proc/self/status").startswith("Name:")
    with pytest.raises(OSError, match="at most 100 are allowed"):
        read_bytes("/proc/self/status", 100)


def test_a_large_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(OSError, match="has 3000000000 bytes or more; at most 4194304 are allowed"):
        read_bytes(path)
    with opened(path, 3_000_000_000) as file:
        assert file.read(3) == bytes(3)


def test_json_is_read_up_to_a_number_of_values(tmp_path: Path) -> None:
    path = tmp_path / "many.json"
    for values in (MOST_VALUES - 1, MOST_VALUES):  # and the list itself
        path.write_text(f"[{','.join('0' * values)}]")
        if values < MOST_VALUES:
            assert len(read_json(path)) == values
            continue
        with pytest.raises(ValueError, match=f"it has more than {MOST_VALUES} values"):
            read_json(path)


@pytest.mark.parametrize("levels", [DEEPEST, DEEPEST + 1, LARGEST_TEXT // 10])
def test_json_and_xml_are_read_up_to_a_depth(tmp_path: Path, levels: int) -> None:
    path = tmp_path / "nested"
    for read, begin, end in ((read_json, "[", "]"), (read_xml, "<a>", "</a>")):
        path.write_text(begin * levels + end * levels)
        if levels <= DEEPEST:
            read(path)
            continue
        with pytest.raises(ValueError, match=f"it is nested deeper than {DEEPEST} levels"):
            read(path)


@pytest.mark.parametrize("text", ["", "<a>", "<a/>x", "<a>\0</a>", '<?xml encoding="x"?><a/>'])
def test_what_is_no_xml_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(ValueError, match=".") as refused:
        read_xml(tmp_path / "a.xml")
    assert str(refused.value).isprintable()


def test_a_document_type_is_refused_before_its_entities_are_read(tmp_path: Path) -> None:
    entities = "".join(
        f'<!ENTITY {name} "{f"&{before};" * 10}">'
        for before, name in zip("abcdefgh", "bcdefghi", strict=True)
    )
    (tmp_path / "a.xml").write_text(f'<!DOCTYPE a [<!ENTITY a "ha">{entities}]><a>&i;</a>')
    with pytest.raises(ValueError, match="it has a document type, which is not allowed"):
        read_xml(tmp_path / "a.xml")


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ParameterError("rate = 0: must be above 0 Hz"), "wood: rate = 0: must be above 0 Hz"),
        (OSError(2, "No such file"), "wood: must be a readable file: No such file"),
        (ValueError("a\nb"), r"wood: must be JSON: 'a\nb'"),
    ],
)
def test_an_error_of_a_file_begins_with_its_place(error: Exception, says: str) -> None:
    with pytest.raises(ParameterError) as raised, located("wood", "must be JSON"):
        raise error
    assert str(raised.value) == says


def test_an_error_of_no_form_is_a_fault_of_the_program() -> None:
    with pytest.raises(ValueError, match=r"^odd$"), located("wood"):
        raise ValueError("odd")


def test_a_folder_gets_its_name_with_all_its_files(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "a" / "set") as folder:
        (folder / "data").mkdir()
        (folder / "data" / "file").write_text("content")
        assert not (tmp_path / "a" / "set").exists()
    assert (tmp_path / "a" / "set" / "data" / "file").read_text() == "content"
    assert list((tmp_path / "a").iterdir()) == [tmp_path / "a" / "set"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_nothing_is_left_after_an_error(tmp_path: Path, error: type[BaseException]) -> None:
    def fail() -> None:
        with whole_folder(tmp_path / "set") as folder:
            (folder / "file").write_text("content")
            raise error

    with pytest.raises(error):
        fail()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_made_meanwhile_is_not_replaced(tmp_path: Path) -> None:
    def write() -> None:
        with whole_folder(tmp_path / "set"):
            (tmp_path / "set").mkdir()
            (tmp_path / "set" / "file").write_text("theirs")

    with pytest.raises(FileExistsError):
        write()
    assert (tmp_path / "set" / "file").read_text() == "theirs"
    assert len(list(tmp_path.iterdir())) == 1
