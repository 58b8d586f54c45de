from __future__ import annotations

from importlib import import_module

import pytest

from haptic_accel.bags import rosbags_adapter

PRIVATE = {
    "rosbags.rosbag2.metadata": {"dump_qos_v9", "parse_qos"},
    "rosbags.rosbag2.storage_mcap": {
        "DECOMPRESSORS",
        "Channel",
        "McapWriter",
        "PendingChunk",
        "Schema",
        "write_channel",
        "write_string",
    },
}


@pytest.mark.parametrize("module", PRIVATE)
def test_rosbags_has_the_names_that_it_does_not_document(module: str) -> None:
    found = import_module(module)
    assert {name for name in PRIVATE[module] if not hasattr(found, name)} == set()


def test_no_other_name_of_theirs_is_used() -> None:
    assert set(rosbags_adapter.__all__) - {"zstd"} == set().union(*PRIVATE.values())


def test_the_writer_has_what_ours_builds_on() -> None:
    fields = {"message_start_time", "message_end_time", "bio", "msgs"}
    assert set(rosbags_adapter.PendingChunk.__annotations__) == fields
    for method in ("add_msgtype", "close_chunk", "close"):
        assert callable(getattr(rosbags_adapter.McapWriter, method))
