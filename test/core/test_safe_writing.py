# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Folders that are whole, or not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from haptic_accel.core.safe_writing import whole_folder


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
