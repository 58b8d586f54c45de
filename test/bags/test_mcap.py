# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from pathlib import Path
from zlib import crc32

import pytest
from backports import zstd
from lz4 import frame as lz4
from mcap.stream_reader import StreamReader

import damaged
from bag_maker import START, STRING
from haptic_accel.bags.compression import LARGEST_RECORD
from haptic_accel.bags.metadata import connection
from haptic_accel.bags.reading import read_bag
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.writing import BagFiles
from haptic_accel.core.cdr import pack_text
from haptic_accel.core.topics import SIGNALS
from reading import with_mcap

FLIPS = 50


@pytest.mark.parametrize("profile", ["none", "zstd_fast"])
def test_no_flipped_bit_goes_unnoticed(tmp_path: Path, profile: str) -> None:
    damaged.write_small_bag(tmp_path / "bag", profile)
    whole = damaged.content(read_bag(tmp_path / "bag"))
    files = {path: path.read_bytes() for path in (tmp_path / "bag").iterdir()}
    chosen = random.Random(profile)
    unnoticed = []
    for _ in range(FLIPS):
        path, saved = chosen.choice(list(files.items()))
        bit = chosen.randrange(8 * len(saved))
        path.write_bytes(damaged.flip(saved, bit))
        bag = read_bag(tmp_path / "bag")
        if not bag.problems and damaged.content(bag) != whole:
            unnoticed.append((path.name, bit))
        path.write_bytes(saved)
    assert unnoticed == []


DIFFERS = "cannot be read: it differs from its checksum"
TIMES = "2023-11-14T22:13:20.020Z to 2023-11-14T22:13:20.039Z are left out"


@pytest.mark.parametrize(
    ("offset", "problem", "kept"),
    [
        # A chunk's kind, length, time, size, checksum; and a value of one of its messages.
        (0, "differs from its checksum, but in no message", damaged.SAMPLES),
        (1, "differs from its checksum, but in no message", damaged.SAMPLES),
        (9, "differs from its checksum, but in no message", damaged.SAMPLES),
        (25, "bytes in place of", damaged.SAMPLES - damaged.CHUNK),
        (33, f"a chunk {DIFFERS}", damaged.SAMPLES - damaged.CHUNK),
        (5000, f"a chunk {DIFFERS}, messages from {TIMES}", damaged.SAMPLES - damaged.CHUNK),
    ],
)
def test_what_is_damaged_is_named_and_the_rest_is_read(
    tmp_path: Path, offset: int, problem: str, kept: int
) -> None:
    file = damaged.write_small_bag(tmp_path / "bag")
    second = damaged.places(file, damaged.CHUNKS)[1]
    file.write_bytes(damaged.flip(file.read_bytes(), 8 * (second + offset)))
    bag = read_bag(tmp_path / "bag")
    (found,) = bag.problems
    assert found.startswith("bag_0.mcap: ")
    assert problem in found
    assert {len(signal.stamps) for signal in bag.signals.values()} == {kept}
    assert len(bag.signals) == len(SIGNALS)


def test_an_index_of_messages_that_is_wrong_is_not_used(tmp_path: Path) -> None:
    file = damaged.write_small_bag(tmp_path / "bag")
    damaged.without_checksums(file)  # as in bags of other programs
    last = damaged.places(file, damaged.MESSAGE_INDEXES)[-1]
    place_of_first_message = last + 9 + 6 + 8
    file.write_bytes(damaged.flip(file.read_bytes(), 8 * place_of_first_message))
    bag = read_bag(tmp_path / "bag")
    assert bag.problems == ["bag_0.mcap: the index of a chunk is wrong"]
    assert {len(signal.stamps) for signal in bag.signals.values()} == {damaged.SAMPLES}


def test_a_topic_that_is_declared_chunks_before_its_first_message_is_read(tmp_path: Path) -> None:
    files = BagFiles(tmp_path / "bag", RecordingOptions(), {})
    early, late = (connection(n, f"/{n}", STRING, []) for n in (1, 2))
    files.add(early)
    files.write(early, START, pack_text("a"))
    files.flush()
    files.add(late)
    for each in (early, late):
        files.write(each, START, pack_text("b"))
        files.flush()
    files.close()
    assert len(with_mcap(tmp_path / "bag")) == 3
    assert read_bag(tmp_path / "bag").counts == {"/1": 2, "/2": 1}


def test_others_find_the_checksums_right(tmp_path: Path) -> None:
    file = damaged.write_small_bag(tmp_path / "bag")
    with file.open("rb") as stream:
        assert list(StreamReader(stream, validate_crcs=True).records)
    assert (
        len(with_mcap(tmp_path / "bag"))
        == damaged.SAMPLES * len(SIGNALS) + damaged.SAMPLES // damaged.CHUNK
    )
    saved = file.read_bytes()
    *_, start, _, given = struct.unpack_from("<BQQQI", saved, len(saved) - 8 - 29)
    assert given == crc32(saved[start : -len(damaged.MAGIC) - 4])
    assert struct.unpack_from("<I", saved, start - 4) == (crc32(saved[: start - 13]),)


BOMBS: dict[str, Callable[[bytes], bytes]] = {
    "": lambda data: data[:100],
    "lz4": lz4.compress,
    "zstd": zstd.compress,
}


@pytest.mark.parametrize("compression", BOMBS)
@pytest.mark.parametrize("claim", [100, LARGEST_RECORD + 1, 2**63])
def test_a_chunk_that_claims_much_is_left_out(
    tmp_path: Path, compression: str, claim: int
) -> None:
    stored = BOMBS[compression](bytes(1 << 24))
    name = struct.pack("<I", len(compression)) + compression.encode()
    chunk = struct.pack("<QQQI", 0, 0, claim, 1) + name + struct.pack("<Q", len(stored)) + stored
    file = tmp_path / "bomb.mcap"
    file.write_bytes(damaged.MAGIC + struct.pack("<BQ", damaged.CHUNKS, len(chunk)) + chunk)
    problem, cut_off = read_bag(file).problems
    assert "bomb.mcap: a chunk cannot be read: " in problem
    assert "was cut off" in cut_off


def test_a_record_that_claims_much_is_not_loaded(tmp_path: Path) -> None:
    file = tmp_path / "sparse.mcap"
    with file.open("wb") as stream:
        stream.write(damaged.MAGIC + struct.pack("<BQ", damaged.CHUNKS, 1 << 40))
        stream.truncate(1 << 41)
    (problem, _) = read_bag(file).problems
    assert f"a record has {1 << 40} bytes and is left out" in problem
