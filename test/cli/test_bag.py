# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import yaml

from bag_maker import NANOSECONDS, START, STRING, Message, record_messages
from damaged import write_cut_off_bag
from haptic_accel.bags.trial_metadata import custom_data, json_text
from verbs import next_command, output_of

CUSTOM = custom_data(json_text({"surface": "vinyl", "bag": ""}, {"coupler": {"k_m": 250.0}}))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag with two messages half a second apart; beside it one that was cut off."""
    said = {START: b"one", START + NANOSECONDS // 2: b"two"}
    messages = [Message("/said", STRING, *each) for each in said.items()]
    write_cut_off_bag(tmp_path / "killed", messages, custom=CUSTOM, flush_after=[1])
    record_messages(tmp_path / "bag", messages, custom=CUSTOM).close()
    return tmp_path / "bag"


def test_a_bag_explains_itself(bag: Path) -> None:
    shown = output_of("bag", "info", bag, "--json", bag / "info.json")
    for said in ("0.50 s, 2 messages", "mcap, 1 file(s)", "surface vinyl", "/said", "of coupler"):
        assert said in shown
    assert "repair" not in shown
    figures = json.loads((bag / "info.json").read_text())
    assert figures["topics"] == {"/said": 2}
    assert figures["duration_s"] == 0.5
    assert figures["facts"]["parameters"] == {"coupler": {"k_m": 250.0}}
    assert figures["problems"] == []


def test_a_bag_that_was_cut_off_is_known_and_repaired(bag: Path) -> None:
    killed = bag.with_name("killed")
    assert "haptic-accel bag repair makes it whole" in output_of("bag", "info", killed)
    report = bag.with_name("report.json")
    shown = output_of("bag", "repair", bag, killed, "--json", report)
    assert f"{bag}: is whole: 2 messages in 0.50 s" in shown
    assert f"{killed}: is whole again: 2 messages in 0.50 s" in shown
    assert next_command(shown) == ["analyze", str(bag), str(killed)]
    whole, repaired = json.loads(report.read_text())
    assert whole["repairs"] == []
    assert (repaired["path"], repaired["messages"]) == (str(killed), 2)
    assert repaired["repairs"]
    assert "repair" not in output_of("bag", "info", killed)


def test_a_bag_without_a_word_that_can_be_read_is_a_failure(bag: Path) -> None:
    (bag / "bag_0.mcap").write_bytes(b"")
    assert "nothing in it can be read" in output_of("bag", "repair", bag, status=1)


def test_metadata_without_counts_of_each_file_is_no_damage(bag: Path) -> None:
    metadata = bag / "metadata.yaml"
    old = yaml.safe_load(metadata.read_text())
    del old["rosbag2_bagfile_information"]["files"]  # as before version 5
    metadata.write_text(yaml.dump(old))
    shutil.copy(bag / "bag_0.mcap", bag / "bag_1.mcap")
    old["rosbag2_bagfile_information"]["relative_file_paths"].append("bag_1.mcap")
    old["rosbag2_bagfile_information"]["message_count"] = 4
    metadata.write_text(yaml.dump(old))
    assert "repair" not in output_of("bag", "info", bag)


def test_a_second_recording_in_the_folder_is_named_and_no_damage(tmp_path: Path) -> None:
    for number, name in enumerate(("bag", "other")):
        messages = [Message("/said", STRING, START + n, b"one") for n in range(2)]
        custom = custom_data(json_text({"seed": number}, {}))
        record_messages(tmp_path / name, messages, custom=custom).close()
    shutil.copy(tmp_path / "other" / "other_0.mcap", tmp_path / "bag")
    shown = output_of("bag", "info", tmp_path / "bag")
    assert "other_0.mcap: another recording, which is read as a bag of its own" in shown
    assert "repair" not in shown
