# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exports of any bag to any format, on the command line."""

from __future__ import annotations

import copy
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from exported import START, Recorded

from bag_maker import STRING, Message, vector_bytes, write_messages
from haptic_accel.bags.writing import write_trial
from haptic_accel.core.cdr import pack_text
from haptic_accel.core.topics import TOOL_ACCELERATION
from running import Command, wait_until
from verbs import ODD_NAMES, output_of, refusal, status_of, tells

MAIN = [sys.executable, "-c", "from haptic_accel.cli.start import main; main()"]
"""What the console script does."""

FORMS = ["lerobot", "parquet", "hdf5", "csv", "wav", "mcap-audio"]


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_of_any_name_is_exported(tmp_path: Path, recorded: Recorded, form: str) -> None:
    bags = [tmp_path / name for name in ODD_NAMES]
    for bag in bags:
        shutil.copytree(recorded.path, bag)
    assert status_of("export", *bags, "--format", form, "--out", tmp_path / "out") == 0


def tool_alone(path: Path) -> Path:
    """Write a bag with a tool and no arms."""
    topic, start = TOOL_ACCELERATION, 1_700_000_000_000_000_000
    stamps = [start + n * 1_000_000 for n in range(100)]

    def message(stamp: int) -> Message:
        data = vector_bytes(topic.type, stamp, "", (0.0, 0.0, 1.0))
        return Message(f"/{topic.name}", topic.type, stamp, data)

    return write_messages(path, map(message, stamps))


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_without_what_a_format_needs_is_refused(tmp_path: Path, form: str) -> None:
    word = write_messages(tmp_path / "word", [Message("/said", STRING, 10, pack_text("word"))])
    refused = {word: "must have a signal of this graph"}
    bag = tool_alone(tmp_path / "bag")
    if form in ("lerobot", "wav", "mcap-audio"):
        refused[bag] = "has no handle_acceleration, which this format needs"
    else:
        output_of("export", bag, "--format", form, "--out", tmp_path / "tool")
    for each, reason in refused.items():
        line = refusal("export", each, "--format", form, "--out", tmp_path / "out")
        assert line.startswith(f"{each}: ")
        assert line.endswith(reason)
        assert not (tmp_path / "out").exists()


def test_damage_of_a_bag_is_told(tmp_path: Path, recorded: Recorded) -> None:
    shutil.copytree(recorded.path, tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    words = ("--format", "parquet", "--out", tmp_path / "out")
    assert "was cut off" in output_of("export", tmp_path / "bag", *words)


@pytest.mark.parametrize("form", FORMS)
def test_a_value_that_no_sensor_has_counts_as_missing(
    tmp_path: Path, recorded: Recorded, form: str
) -> None:
    trial = copy.deepcopy(recorded.trial)
    trial.tool_acceleration[1000:1002] = 1e308, -1e38
    write_trial(tmp_path / "bag", trial, {}, START)
    text = output_of("export", tmp_path / "bag", "--format", form, "--out", tmp_path / "out")
    assert ("2 of 2967 samples repeat the one before" in text) == (form in ("lerobot", "hdf5"))
    for file in (tmp_path / "out").rglob("*.json"):
        assert not re.search("NaN|Infinity", file.read_text())


@pytest.mark.parametrize("library", ["pyarrow", "h5py"])
def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, recorded: Recorded, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    form = {"pyarrow": "parquet", "h5py": "hdf5"}[library]
    monkeypatch.setitem(sys.modules, library, None)
    for module in ("tables", "hdf5", "lerobot", "images"):
        monkeypatch.delitem(sys.modules, f"haptic_accel.kits.export.{module}", raising=False)
    words = ("export", recorded.path, "--format", form, "--out", tmp_path / "out")
    assert refusal(*words, status=1) == f"needs {library}: pip install 'haptic_accel[{form}]'"
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_nothing_but_one_line(tmp_path: Path, recorded: Recorded) -> None:
    out = tmp_path / "out"
    # The limit of a file's size has the same effect, for a disk of its own would need root.
    words = shlex.join([*MAIN, "export", str(recorded.path), *f"--format csv --out {out}".split()])
    limited = ["bash", "-c", f"ulimit -f 50; exec {words}"]
    done = subprocess.run(limited, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    line = f"haptic-accel: out = '{out}': cannot be written: File too large\n"
    assert (done.stdout, done.stderr) == ("", line)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_export_leaves_nothing(
    tmp_path: Path, recorded: Recorded, number: signal.Signals
) -> None:
    # Many bags, so that it lasts.
    bags = [str(recorded.path)] * 50
    words = ["export", *bags, "--format", "parquet", "--out", str(tmp_path / "out")]
    command = Command([*MAIN[1:], *words], tmp_path.parent)
    wait_until(lambda: list(tmp_path.iterdir()), "begin of the export", command)
    assert command.end(number) == 130
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_not_touched(tmp_path: Path, recorded: Recorded) -> None:
    (tmp_path / "out").mkdir()
    line = refusal("export", recorded.path, "--format", "csv", "--out", tmp_path / "out")
    assert line == f"out = '{tmp_path / 'out'}': must be a new folder"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("csv --fps 30", "fps = 30: csv has none: leave it out"),
        ("hdf5 --task write", "task = write: hdf5 has none: leave it out"),
        ("wav --rate 960", "rate = 960.0: wav has none: leave it out"),
        ("lerobot --rate 1000", "rate = 1000 Hz: must be a whole multiple of fps = 30, ..."),
        ("hdf5 --fps 1000 --rate 500", "rate = 500 Hz: must be a whole multiple of ..."),
        ("lerobot --fps 0", "...--fps...0 is not in the range 1<=x<=1000."),
        ("png", "...--format...'png' is not one of ..."),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(
    tmp_path: Path, recorded: Recorded, words: str, line: str
) -> None:
    found = refusal("export", recorded.path, "--out", tmp_path / "out", "--format", *words.split())
    assert tells(found, line)
    assert list(tmp_path.iterdir()) == []
