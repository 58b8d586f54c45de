# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.rosbag2 import StoragePlugin

from bag_maker import START, STRING, Message, write_messages
from damaged import (
    CHUNK,
    MAGIC,
    SAMPLES,
    content,
    flip,
    without_checksums,
    write_bag_with_an_empty_chunk,
    write_cut_off_bag,
    write_small_bag,
)
from fuzzing import accepted, fuzz, measured, mutated
from haptic_accel.bags.metadata import connection, read_metadata
from haptic_accel.bags.reading import read_bag
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.repair import repair
from haptic_accel.core.parameters import ParameterError
from reading import Row, with_mcap, with_rosbags

FACTS = {"haptic_accel.version": "1.2.3"}
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""A bag is asked for its content, not for the time that a disk takes to confirm it."""

FLUSHED = 30
"""Messages after which those so far are brought to the disk."""

FORMS = {
    "mcap": RecordingOptions(),
    "chunks compressed": RecordingOptions(storage_preset_profile="zstd_fast"),
    "split": RecordingOptions(max_bag_duration=4e-8),
}


@pytest.fixture
def memory() -> Iterator[Path]:
    with TemporaryDirectory(dir=MEMORY) as folder:
        yield Path(folder)


def killed(folder: Path, options: RecordingOptions, count: int) -> tuple[Path, list[Row]]:
    """Return a bag as it is on the disk while it is recorded, and what was flushed by then."""
    messages = [
        Message(f"/topic_{number % 2}", STRING, START + number, bytes([number % 256]) * 50)
        for number in range(count)
    ]
    flush_after = range(FLUSHED - 1, count, FLUSHED)
    bag = write_cut_off_bag(
        folder / "bag", messages, options=options, custom=FACTS, flush_after=flush_after
    )
    flushed = messages[: flush_after[-1] + 1]
    return bag, [(one.topic, one.received, one.data) for one in flushed]


def state(bag: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in bag.iterdir()}


@pytest.mark.parametrize("form", FORMS)
def test_all_that_was_flushed_is_there_after_a_repair(memory: Path, form: str) -> None:
    bag, flushed = killed(memory, FORMS[form], 100)
    done = repair(bag)
    assert done.messages == len(with_rosbags(bag))
    assert with_rosbags(bag)[: len(flushed)] == flushed
    assert with_mcap(bag)[: len(flushed)] == flushed
    assert read_metadata(bag).custom == FACTS
    assert done.repairs
    assert done.problems == []
    assert any(name.endswith(".damaged") for name in state(bag))
    before = state(bag)
    assert repair(bag).repairs == []
    assert state(bag) == before


@given(share=st.floats(0.0, 1.0))
@settings(max_examples=30)
def test_of_a_file_cut_off_anywhere_all_is_kept_that_is_whole(share: float) -> None:
    with TemporaryDirectory(dir=MEMORY) as folder:
        bag, flushed = killed(Path(folder), FORMS["mcap"], 100)
        file = bag / "bag_0.mcap"
        content = file.read_bytes()
        cut = int(share * len(content))
        file.write_bytes(content[:cut])
        done = repair(bag)
        # Each message's data occur in the file once: those before the cut are to be kept.
        whole = sum(0 <= content.find(data) <= cut - len(data) for _, _, data in flushed)
        assert done.messages == whole
        if whole:
            assert with_rosbags(bag) == with_mcap(bag) == flushed[:whole]
        assert (bag / "bag_0.mcap.damaged").read_bytes() == content[:cut]
        assert read_metadata(bag).custom == FACTS


def test_zeros_after_a_power_cut_are_no_messages(memory: Path) -> None:
    bag, flushed = killed(memory, FORMS["mcap"], 60)
    with (bag / "bag_0.mcap").open("ab") as file:
        file.write(bytes(10_000))
    repair(bag)
    assert with_mcap(bag) == with_rosbags(bag) == flushed


def test_without_metadata_a_bag_is_put_together_from_its_files(memory: Path) -> None:
    bag, flushed = killed(memory, FORMS["split"], 100)
    (bag / "metadata.yaml").unlink()
    repair(bag)
    metadata = read_metadata(bag)
    assert with_rosbags(bag)[: len(flushed)] == flushed
    assert metadata.custom == FACTS  # closed files carry it too
    digest = connection(1, "/said", STRING, []).digest
    assert [topic.type_description_hash for topic in metadata.topics] == [digest, digest]


def test_what_is_no_mcap_file_at_all_is_set_aside(memory: Path) -> None:
    bag, flushed = killed(memory, FORMS["split"], 100)
    last = max(bag.glob("*.mcap"))
    last.write_bytes(b"nothing of the kind")
    done = repair(bag)
    assert [last.name in problem for problem in done.problems] == [True]
    assert not last.exists()
    assert with_rosbags(bag) == flushed[: done.messages]


def test_a_chunk_without_messages_becomes_none(memory: Path) -> None:
    file = write_bag_with_an_empty_chunk(memory / "bag", Message("/said", STRING, START, b"one"))
    with file.open("rb") as stream:
        before = make_reader(stream).get_summary()
    done = repair(memory / "bag")
    with file.open("rb") as stream:
        after = make_reader(stream).get_summary()
    assert before
    assert after
    assert [bool(index.message_index_length) for index in before.chunk_indexes] == [False, True]
    assert [bool(index.message_index_length) for index in after.chunk_indexes] == [True]
    assert "a chunk has no index of messages" in done.repairs[0]
    assert with_mcap(memory / "bag") == with_rosbags(memory / "bag") == [("/said", START, b"one")]
    assert repair(memory / "bag").repairs == []


@pytest.mark.parametrize("profile", ["none", "zstd_fast"])
def test_a_flipped_bit_costs_a_chunk_at_most(memory: Path, profile: str) -> None:
    file = write_small_bag(memory / "bag", profile)
    whole = content(read_bag(memory / "bag"))
    saved = file.read_bytes()
    chosen = random.Random(profile)
    for _ in range(10):
        bit = chosen.randrange(8 * len(MAGIC), 8 * len(saved))
        file.write_bytes(flip(saved, bit))
        done = repair(memory / "bag")
        assert done.repairs, bit
        bag = read_bag(memory / "bag")
        assert bag.problems == [] or done.problems, bit
        assert all(len(signal.stamps) >= SAMPLES - CHUNK for signal in bag.signals.values()), bit
        assert content(bag) == whole or done.problems, bit


def test_metadata_that_was_changed_is_written_anew(memory: Path) -> None:
    write_small_bag(memory / "bag")
    metadata = memory / "bag" / "metadata.yaml"
    saved = metadata.read_text()
    metadata.write_text(saved.replace("vinyl", "linen"))
    bag = read_bag(memory / "bag")
    assert bag.metadata["arguments"]["surface"] == "vinyl"  # the files say it too
    assert bag.problems == [
        "metadata.yaml is not read: is not metadata of a bag: it differs from its checksum,"
        " which is its last line"
    ]
    assert repair(memory / "bag").repairs == ["metadata.yaml: rewritten"]
    assert metadata.read_text() == saved


def test_a_record_that_cannot_be_read_is_taken_out(memory: Path) -> None:
    file = write_small_bag(memory / "bag")
    whole = content(read_bag(memory / "bag"))
    saved = file.read_bytes()
    channel = bytes([4]) + (1).to_bytes(8, "little") + b"x"
    file.write_bytes(saved[: saved.index(b"rosbag2") - 13] + channel)
    done = repair(memory / "bag")
    assert len(done.problems) == 1
    assert "a record cannot be read" in done.problems[0]
    assert content(read_bag(memory / "bag")) == whole
    assert repair(memory / "bag").repairs == []


numbers = st.sampled_from([0, 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1])
odd = [b"[" * 99, b"9" * 99, b": ", b"- ", b"&a", b"*a", b"*", b"\n", bytes(9), MAGIC]
pieces = st.one_of(
    st.binary(max_size=40), numbers.map(lambda n: n.to_bytes(8, "little")), st.sampled_from(odd)
)


@pytest.fixture(scope="module")
def small_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("small") / "bag"
    write_small_bag(bag)
    return bag


@fuzz
@given(data=st.data(), checksums=st.booleans())
def test_any_damage_to_a_bag_is_read_or_refused_in_one_line_and_repaired(
    small_bag: Path, data: st.DataObject, checksums: bool
) -> None:
    lines: list[str] = []
    with TemporaryDirectory(dir=MEMORY) as folder:
        bag = Path(folder) / "bag"
        shutil.copytree(small_bag, bag)
        if not checksums:
            without_checksums(bag / "bag_0.mcap")
        for file in (bag / "bag_0.mcap", bag / "metadata.yaml"):
            file.write_bytes(data.draw(mutated(st.just(file.read_bytes()), pieces)))
        with measured():
            accepted(lambda: lines.extend(read_bag(bag).problems))
        done = repair(bag)
        assert all("\n" not in line for line in (*lines, *done.problems, *done.repairs))
        if done.messages:
            assert repair(bag).repairs == []


@pytest.mark.parametrize("name", ["bag_0.mcap", "metadata.yaml"])
@pytest.mark.parametrize("kind", ["pipe", "zeros", "folder"])
def test_what_is_no_file_is_not_read(memory: Path, name: str, kind: str) -> None:
    write_small_bag(memory / "bag")
    path = memory / "bag" / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "zeros":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    if name == "metadata.yaml":
        assert "metadata.yaml is not read" in read_bag(memory / "bag").problems[0]
        assert repair(memory / "bag").repairs == ["metadata.yaml: rewritten"]
        assert read_bag(memory / "bag").problems == []
        return
    for refused in (memory / "bag", path):
        for action in (read_bag, repair):
            with pytest.raises(ParameterError, match="must be"):
                action(refused)


def test_what_is_no_bag_and_a_bag_of_another_form_are_refused_and_stay(tmp_path: Path) -> None:
    write_messages(tmp_path / "bag", [], storage=StoragePlugin.SQLITE3)
    before = state(tmp_path / "bag")
    with pytest.raises(ParameterError, match=r"must be a bag of \.mcap files.*bag\.db3$"):
        repair(tmp_path / "bag")
    assert state(tmp_path / "bag") == before
    (tmp_path / "file.mcap").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "nothing", tmp_path / "folder", tmp_path / "file.mcap"):
        with pytest.raises(ParameterError, match=f"^{path}: must be"):
            repair(path)


RECORDING = """
import sys, time
from pathlib import Path
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagWriter
bag = BagWriter(Path(sys.argv[1]), 100_000, RecordingOptions(), {})
put = bag.connect("/x", "std_msgs/msg/String", [])
while True:
    put(bytes(100))
    if bag.files.bytes and not bag.files.trouble:
        print("recording", flush=True)
        bag.files.trouble = "reported"
    time.sleep(0.001)
"""

GAP = 1_000_000_000
"""Between the last message and the end of the process, at most, ns."""

ATTEMPTS = 4
"""A machine that stalls just before the end saves nothing meanwhile: not in all of these."""


def test_after_kill_9_at_most_the_last_second_is_lost(tmp_path: Path) -> None:
    moments = random.Random("mcap")
    gaps = []
    for attempt in range(ATTEMPTS):
        bag = tmp_path / f"bag{attempt}"
        words = [sys.executable, "-c", RECORDING, str(bag)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout
            assert child.stdout.readline() == "recording\n"
            time.sleep(moments.uniform(0.7, 1.7))
            end = time.time_ns()
            child.kill()
        repair(bag)
        rows = with_rosbags(bag)
        assert len(read_bag(bag).counts) == 1
        assert with_mcap(bag) == rows
        gaps.append(end - rows[-1][1])
        if gaps[-1] <= GAP:
            return
    pytest.fail(f"lost at the end, ns: {gaps}")


RECORDER = """
import sys
from pathlib import Path
from haptic_accel.bags.metadata import connection
from haptic_accel.bags.writing import BagFiles
from haptic_accel.bags.recording_options import RecordingOptions

files = BagFiles(Path(sys.argv[1]), RecordingOptions(), {})
topic = connection(1, "/text", "std_msgs/msg/String", [])
files.add(topic)
for number in range(5):
    files.write(topic, 10**18 + number, b"\\0\\1\\0\\0\\2\\0\\0\\0a\\0")
    files.flush()
print("written", flush=True)
sys.stdin.readline()
files.close()
print(files.summary(files.lost), flush=True)
"""
"""Program that records until a line comes."""


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    words = [sys.executable, "-c", RECORDER, str(tmp_path / "bag")]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(words, text=True, **pipes) as process:
        assert process.stdout
        assert process.stdout.readline() == "written\n"
        yield process
        process.kill()


def test_a_bag_that_is_being_recorded_is_not_repaired(
    tmp_path: Path, recorder: subprocess.Popen[str]
) -> None:
    bag = tmp_path / "bag"
    before = sorted(bag.iterdir())
    with pytest.raises(ParameterError, match=r"bag: bag_0\.mcap is still being written"):
        repair(bag)
    assert sorted(bag.iterdir()) == before
    found = read_bag(bag)
    assert found.counts["/text"] == 5
    assert found.problems == ["bag_0.mcap is still being written: read as far as it is there"]
    said, _ = recorder.communicate("end\n")
    assert said == f"{bag}: 5 messages, 0 dropped\n"
    assert repair(bag).repairs == []
    assert read_bag(bag).problems == []
