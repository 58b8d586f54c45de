# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import shutil
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.interfaces import Connection

from haptic_accel.bags.metadata import connection, read_metadata
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagFiles
from haptic_accel.core.parameters import ParameterError
from reading import with_mcap, with_rosbags

FACTS = {"haptic_accel.version": "1.2.3", "haptic_accel.arguments": '{"surface": "vinyl: #1"}'}
TYPES = ("std_msgs/msg/String", "geometry_msgs/msg/AccelStamped", "std_msgs/msg/String")
TOPICS = [connection(n + 1, f"/topic_{n}", kind, []) for n, kind in enumerate(TYPES)]
START = 1_700_000_000_000_000_000

FORMS = st.sampled_from([{}, {"storage_preset_profile": "zstd_fast"}])
MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""A bag is asked for its content, not for the time that a disk takes to confirm it."""

SPLITS = st.sampled_from([{}, {"max_bag_size": 300}, {"max_bag_duration": 0.005}])
MESSAGES = st.lists(
    st.tuples(
        st.sampled_from(TOPICS),
        st.integers(1, 10_000_000),  # ns after the one before
        st.binary(max_size=200),
    ),
    max_size=40,
)
ACTIONS = st.sets(st.integers(0, 40), max_size=3)


@given(form=FORMS, split=SPLITS, messages=MESSAGES, flushes=ACTIONS, splits=ACTIONS)
@settings(max_examples=30)
def test_what_goes_in_comes_out_in_order_for_every_reader(
    form: dict[str, Any],
    split: dict[str, Any],
    messages: list[tuple[Connection, int, bytes]],
    flushes: set[int],
    splits: set[int],
) -> None:
    times = [START + passed for passed in accumulate(after for _, after, _ in messages)]
    with TemporaryDirectory(dir=MEMORY) as folder:
        bag = Path(folder) / "bag"
        files = BagFiles(bag, RecordingOptions(**form, **split), FACTS)
        for topic in TOPICS:
            files.add(topic)
        for position, ((topic, _, data), time) in enumerate(zip(messages, times, strict=True)):
            if position in splits:
                files.split()
            if position in flushes:
                files.flush()
            files.write(topic, time, data)
        files.close()
        expected = [
            (topic.topic, time, data)
            for (topic, _, data), time in zip(messages, times, strict=True)
        ]
        assert (files.written, files.lost) == (len(messages), 0)
        assert files.failure == files.trouble == ""
        assert with_rosbags(bag) == with_mcap(bag) == expected
        metadata = read_metadata(bag)
        assert metadata.custom == FACTS
        assert {topic.name: topic.messages for topic in metadata.topics} == {
            topic.topic: sum(one is topic for one, _, _ in messages) for topic in TOPICS
        }
        names = {"metadata.yaml", *(entry.name for entry in metadata.files)}
        assert {path.name for path in bag.iterdir()} == names


def test_a_file_is_full_at_its_size_and_at_its_duration(tmp_path: Path) -> None:
    topic = TOPICS[0]
    options = RecordingOptions(max_bag_size=1000, max_bag_duration=1.0)
    files = BagFiles(tmp_path / "bag", options, {})
    files.add(topic)
    for number in range(10):
        files.write(topic, START + number, bytes(100))
    assert len(files.file_names) == 1 + 1  # schema and header count too
    files.write(topic, START + 2_000_000_000, b"")
    assert files.file_names == ["bag_0.mcap", "bag_1.mcap", "bag_2.mcap"]
    files.close()
    first, second, third = read_metadata(tmp_path / "bag").files
    assert first.messages + second.messages == 10
    assert (third.start, third.end, third.messages) == (START + 2_000_000_000,) * 2 + (1,)


def test_a_file_of_mcap_says_itself_what_it_is_and_metadata_from_the_start(tmp_path: Path) -> None:
    files = BagFiles(tmp_path / "bag", RecordingOptions(), FACTS)
    described = read_metadata(tmp_path / "bag")
    assert described.custom == FACTS
    assert [file.name for file in described.files] == ["bag_0.mcap"]
    files.add(TOPICS[1])
    files.write(TOPICS[1], START, b"")
    files.close()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        reader = make_reader(stream)
        ((schema, channel, _),) = reader.iter_messages()
        (metadata,) = reader.iter_metadata()
    assert schema is not None
    assert (schema.name, schema.encoding) == ("geometry_msgs/msg/AccelStamped", "ros2msg")
    assert b"MSG: geometry_msgs/Vector3" in schema.data
    assert channel.message_encoding == "cdr"
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert "offered_qos_profiles" in channel.metadata
    assert "vinyl: #1" in metadata.metadata["serialized_metadata"]


def one_file(bag: Path) -> BagFiles:
    """Begin a bag with a message."""
    files = BagFiles(bag, RecordingOptions(), {})
    files.add(TOPICS[0])
    files.write(TOPICS[0], START, b"one")
    return files


def two_files(bag: Path) -> BagFiles:
    """Begin a bag with a message in each of two files."""
    files = one_file(bag)
    files.split()
    files.write(TOPICS[0], START, b"two")
    return files


def content(file: Path) -> list[bytes]:
    return [data for _, _, data in with_rosbags(file)]


def test_where_no_other_file_can_be_made_the_recording_goes_on(tmp_path: Path) -> None:
    files = one_file(tmp_path / "bag")
    (tmp_path / "bag" / "bag_1.mcap").touch()
    files.split()
    assert "cannot be split" in files.trouble
    files.write(TOPICS[0], START + 1, b"after")
    files.close()
    assert (files.written, files.lost, files.failure) == (2, 0, "")
    assert content(tmp_path / "bag" / "bag_0.mcap") == [b"one", b"after"]


def test_a_recording_without_metadata_has_failed(tmp_path: Path) -> None:
    files = BagFiles(tmp_path / "bag", RecordingOptions(), {})
    (tmp_path / "bag" / "metadata.yaml.tmp").mkdir()
    files.close()
    assert files.failure == "metadata.yaml cannot be written: Is a directory"


LOSSES: dict[str, Callable[[Path], object]] = {
    "removed": shutil.rmtree,
    "moved away": lambda bag: bag.rename(bag.with_name("elsewhere")),
    "replaced": lambda bag: (shutil.rmtree(bag), bag.mkdir(), (bag / "bag_1.mcap").touch()),
}


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("noticed_by", ["flush", "split", "close"])
def test_a_folder_that_is_lost_ends_the_recording(
    tmp_path: Path, loss: str, noticed_by: str
) -> None:
    bag = tmp_path / "bag"
    files = two_files(bag)
    LOSSES[loss](bag)
    left = sorted(bag.iterdir()) if bag.exists() else None
    getattr(files, noticed_by)()
    what = "moved away" if loss == "moved away" else "removed"
    assert files.failure == f"bag_1.mcap was {what} while it was recorded"
    files.write(TOPICS[0], START, b"three")
    files.close()
    saved = 2 if loss == "moved away" else 0
    assert (files.written, files.lost) == (saved, 3 - saved)
    line = files.summary(files.lost)
    assert f"bag_1.mcap was {what} while it was recorded: {saved} messages" in line
    where = f" in {tmp_path / 'elsewhere'}" if saved else ""
    assert line.endswith(f"are saved{where} and can be read, {3 - saved} are not")
    # Nothing is written into what has taken the folder's place.
    assert (sorted(bag.iterdir()) if bag.exists() else None) == left
    if saved:
        elsewhere = sorted((tmp_path / "elsewhere").glob("*.mcap"))
        assert [each for file in elsewhere for each in content(file)] == [b"one", b"two"]


def test_messages_of_a_file_that_is_replaced_are_not_called_saved(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    files = two_files(bag)
    (bag / "other.mcap").write_bytes((bag / "bag_0.mcap").read_bytes())
    (bag / "other.mcap").replace(bag / "bag_0.mcap")
    files.close()
    assert (files.written, files.lost) == (1, 1)
    assert files.failure == "bag_0.mcap was removed or replaced after it was recorded"
    assert read_metadata(bag).messages == 1


def test_a_file_that_is_renamed_is_named_with_its_messages(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    files = one_file(bag)
    renamed = (bag / "bag_0.mcap").rename(bag / "kept.mcap.old")
    (bag / "bag_0.mcap").touch()
    files.close()
    assert "1 messages" in (line := files.summary(files.lost))
    assert f"are saved in {renamed} and can be read, 0 are not" in line


@pytest.mark.parametrize("name", ["there", "file/bag"])
def test_a_folder_that_cannot_be_made_is_refused_by_name(tmp_path: Path, name: str) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match="^bag = .*must be a folder to make"):
        BagFiles(tmp_path / name, RecordingOptions(), {})
