# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

import bag_maker
from haptic_accel.bags.reading import Change, read_bag
from haptic_accel.core import topics
from haptic_accel.core.parameters import ParameterError


def vector(
    topic: topics.Topic, stamp: int, received: int, number: float = 0.0, graph: str = ""
) -> bag_maker.Message:
    """Make a message of one of a graph's topics."""
    data = bag_maker.vector_bytes(topic.type, stamp, topic.frame, (0.0, 0.0, number))
    return bag_maker.Message(f"{graph}/{topic.name}", topic.type, received, data)


FORMATS = [
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.MCAP, CompressionMode.STORAGE),
    (StoragePlugin.MCAP, CompressionMode.FILE),
    (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    (StoragePlugin.SQLITE3, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.FILE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
]

samples = st.lists(
    st.tuples(
        st.sampled_from(topics.SIGNALS),
        st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9),
        st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3),
    ),
    min_size=1,
    max_size=40,
)
begins = st.integers(0, (2**31 - 1) * bag_maker.NANOSECONDS)
"""First stamps; samples follow each other by 1 ms."""


namespaces = st.sampled_from(["", "/left", "/a/b"])


@settings(max_examples=40)
@given(samples, begins, st.sampled_from(FORMATS), st.booleans(), namespaces)
def test_what_was_written_is_read(
    vectors: list[tuple[Any, str, tuple[float, float, float]]],
    begin: int,
    form: tuple[StoragePlugin, CompressionMode],
    little_endian: bool,
    namespace: str,
) -> None:
    rows = [(topic, begin + n * 10**6, *rest) for n, (topic, *rest) in enumerate(vectors)]
    written = [
        bag_maker.Message(
            f"{namespace}/{topic.name}",
            topic.type,
            10**18 + n,
            bag_maker.vector_bytes(topic.type, at, frame, v, little_endian=little_endian),
        )
        for n, (topic, at, frame, v) in enumerate(rows)
    ]
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bag"
        storage, compression = form
        bag_maker.write_messages(path, written, storage=storage, compression=compression)
        recorded = read_bag(path)
    assert recorded.problems == []
    assert sum(recorded.counts.values()) == len(rows)
    for topic in topics.SIGNALS:
        of_topic = [(n, at, v) for n, (t, at, _, v) in enumerate(rows) if t is topic]
        assert (topic.name in recorded.signals) == bool(of_topic)
        if of_topic:
            signal = recorded.signals[topic.name]
            assert signal.received.tolist() == [10**18 + n for n, _, _ in of_topic]
            assert signal.stamps.tolist() == [at for _, at, _ in of_topic]
            assert np.array_equal(signal.values, [v for _, _, v in of_topic])


def test_of_topics_that_are_not_asked_for_only_the_stamps_are_kept(tmp_path: Path) -> None:
    rows = [
        vector(topic, 5, 10**18, 3.0)
        for topic in (topics.TOOL_ACCELERATION, topics.MASTER_POSITION)
    ]
    bag_maker.write_messages(tmp_path / "bag", rows)
    found = read_bag(tmp_path / "bag", [topics.TOOL_ACCELERATION.name]).signals
    tool, position = found[topics.TOOL_ACCELERATION.name], found[topics.MASTER_POSITION.name]
    assert (tool.stamps.tolist(), tool.values.tolist()) == ([5], [[0.0, 0.0, 3.0]])
    assert (position.stamps.tolist(), position.values.shape) == ([5], (0, 3))


@pytest.fixture(scope="module")
def long_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of 9000 numbered samples: several chunks of a mebibyte or less."""
    path = tmp_path_factory.mktemp("bags") / "long"
    return bag_maker.write_messages(
        path, (vector(topics.TOOL_ACCELERATION, n, n, n) for n in range(9000))
    )


@settings(max_examples=60)
@given(share=st.floats(0.0, 1.0))
def test_a_file_cut_off_anywhere_is_read_up_to_there(long_bag: Path, share: float) -> None:
    whole = (long_bag / "long.mcap").read_bytes()
    with TemporaryDirectory() as folder:
        cut = Path(folder) / "cut.mcap"
        cut_content = whole[: int(share * (len(whole) - 1))]
        cut.write_bytes(cut_content)
        try:
            recorded = read_bag(cut)
        except ParameterError as error:
            assert len(cut_content) < 8, error
            return
    assert recorded.problems
    if recorded.signals:
        found = recorded.signals[topics.TOOL_ACCELERATION.name].stamps
        assert np.array_equal(found, np.arange(len(found)))
    # A message takes less than 200 bytes; what is behind the messages, index and all, some more.
    size = len(cut_content)
    assert sum(recorded.counts.values()) >= min(9000, (size - 8000) // 200)


def reported(
    received: int, name: str, message: str, topic: str = "/diagnostics"
) -> bag_maker.Message:
    """Make diagnostics with the status of a node."""
    data = bag_maker.diagnostics_bytes(received, name, message, {"ticks": "3"})
    return bag_maker.Message(topic, topics.DIAGNOSTICS.type, received, data)


def changed(received: int, node: str, controller: str) -> bag_maker.Message:
    """Make the event of a controller that was set."""
    data = bag_maker.change_bytes(received, node, "controller", controller)
    return bag_maker.Message("/parameter_events", bag_maker.CHANGED, received, data)


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_metadata_diagnostics_and_changes_are_read(tmp_path: Path, storage: StoragePlugin) -> None:
    bag_maker.write_messages(
        tmp_path / "bag",
        [reported(5, "coupler: coupling", "alone"), changed(6, "/x/compensator", "inverse")],
        storage=storage,
        custom={
            "haptic_accel.version": "0.2.0",
            "haptic_accel.arguments": json.dumps({"rate": 1000.0}),
            "other": "kept out",
        },
    )
    recorded = read_bag(tmp_path / "bag")
    assert recorded.metadata == {"version": "0.2.0", "arguments": {"rate": 1000.0}}
    (said,) = recorded.diagnostics
    assert (said.received, said.node, said.message) == (5, "coupler", "alone")
    assert said.values == {"ticks": "3"}
    assert recorded.changes == [Change(6, "compensator", "controller", "inverse")]


@pytest.mark.parametrize(
    ("topic", "name"),
    [("/diagnostics", "left/coupler: coupling"), ("/left/diagnostics", "coupler")],
    ids=["now", "until 0.2.0"],
)
def test_of_two_graphs_in_a_bag_one_speaks(tmp_path: Path, topic: str, name: str) -> None:
    bag_maker.write_messages(
        tmp_path / "bag",
        [
            reported(1, name, "ours", topic),
            vector(topics.TOOL_ACCELERATION, 1, 2, graph="/left"),
            reported(3, "right/coupler: coupling", "theirs"),
            changed(4, "/right/compensator", "none"),
            changed(5, "/left/compensator", "inverse"),
        ],
    )
    recorded = read_bag(tmp_path / "bag")
    assert [(said.node, said.message) for said in recorded.diagnostics] == [("coupler", "ours")]
    assert recorded.changes == [Change(5, "compensator", "controller", "inverse")]


def test_another_graph_and_another_type_are_named_and_left_out(tmp_path: Path) -> None:
    topic = topics.TOOL_ACCELERATION.name
    other = next(kind for kind in topics.VECTORS if kind.endswith("WrenchStamped"))
    bag_maker.write_messages(
        tmp_path / "bag",
        [
            vector(topics.TOOL_ACCELERATION, 1, 1, graph="/left"),
            vector(topics.TOOL_ACCELERATION, 2, 2, graph="/right"),
            vector(replace(topics.MASTER_POSITION, type=other), 3, 3, graph="/left"),
        ],
    )
    recorded = read_bag(tmp_path / "bag")
    assert list(recorded.signals) == [topic]
    assert recorded.signals[topic].stamps.tolist() == [1]
    assert any("/right" in problem for problem in recorded.problems)
    assert any("/left/master/measured_cp" in problem for problem in recorded.problems)
    assert len(recorded.counts) == 3


def test_a_malformed_message_is_named_and_the_others_are_read(tmp_path: Path) -> None:
    topic = topics.SIGNALS[0]
    rows = [vector(topic, n, n, n) for n in range(4)]
    rows[2] = rows[2]._replace(data=rows[2].data[:9])
    recorded = read_bag(bag_maker.write_messages(tmp_path / "bag", rows))
    assert recorded.problems == [f"/{topic.name}: malformed messages are not read"]
    signal = recorded.signals[topic.name]
    assert signal.stamps.tolist() == [0, 1, 3]
    assert signal.received.tolist() == [0, 1, 3]
    assert signal.values[:, 2].tolist() == [0.0, 1.0, 3.0]


@pytest.mark.parametrize("content", [None, b"", b"no bag at all"])
def test_what_is_no_bag_is_refused_in_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ParameterError, match=r"^/.*x\.mcap: must be a bag") as caught:
        read_bag(path)
    assert "\n" not in str(caught.value)


def test_a_pipe_in_place_of_a_compressed_file_is_missing_and_others_are_read(
    tmp_path: Path,
) -> None:
    row = vector(topics.TOOL_ACCELERATION, 1, 1)
    bag_maker.write_messages(tmp_path / "bag", [row], compression=CompressionMode.FILE)
    (file,) = (tmp_path / "bag").glob("*.zstd")
    file.rename(file.with_name("other.mcap.zstd"))
    os.mkfifo(file)
    bag = read_bag(tmp_path / "bag")
    other = "other.mcap.zstd is not listed in metadata.yaml"
    assert bag.problems == [f"{file.name} is missing", other]
    assert bag.counts == {row.topic: 1}
