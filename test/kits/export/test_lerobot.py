# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""LeRobotDataset v3.0, read again as its documentation describes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from exported import START, Recorded, vectors, write_bag
from hypothesis import given
from hypothesis import strategies as st
from pyarrow import parquet

from bag_maker import CHANGED, Message, change_bytes, write_messages
from haptic_accel import __version__
from haptic_accel.bags.metadata import read_metadata
from haptic_accel.core.axes import ACTUATOR_AXES
from haptic_accel.kits.export.lerobot import combined, statistics
from reading import with_types
from verbs import refusal, status_of

EXACT = ("min", "max", "mean", "std", "count")


@given(st.lists(st.integers(1, 9), min_size=1, max_size=5), st.integers(0, 99))
def test_those_of_all_episodes_are_those_of_all_frames(lengths: list[int], seed: int) -> None:
    random = np.random.default_rng(seed)
    episodes = [random.normal(size=(length, 4, 2)) for length in lengths]
    found = combined([{"feature": statistics(each)} for each in episodes])["feature"]
    expected = statistics(np.concatenate(episodes))
    for name in EXACT:
        assert found[name] == pytest.approx(expected[name])
    assert found["q50"].shape == (4, 2)


@pytest.fixture(scope="module")
def dataset(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a set of two bags."""
    folder = tmp_path_factory.mktemp("sets")
    write_bag(folder / "vinyl", surface="vinyl")
    published = ("--licence", "CC0-1.0", "--author", "Ann")
    words = ("--format", "lerobot", *published, "--out", folder / "set")
    assert status_of("export", recorded.path, folder / "vinyl", *words) == 0
    return folder / "set"


def json_of(path: Path) -> Any:
    return json.loads(path.read_text())


def episodes(dataset: Path) -> pd.DataFrame:
    return pd.read_parquet(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet")


def rows(dataset: Path) -> pd.DataFrame:
    return pd.read_parquet(dataset / "data" / "chunk-000" / "file-000.parquet")


def test_info_describes_what_is_there(dataset: Path) -> None:
    info, found = json_of(dataset / "meta" / "info.json"), rows(dataset)
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 30, 2)
    assert info["total_frames"] == len(found)
    assert set(found) == set(info["features"])
    for name, feature in info["features"].items():
        array = np.atleast_1d(found[name][0])
        assert (list(array.shape), array.dtype.name) == (feature["shape"], feature["dtype"])
    state = info["features"]["observation.state"]
    names = ["slave_velocity.z", *ACTUATOR_AXES.sample_names(32), "vibration.valid"]
    assert state["names"][5:] == names
    assert (state["info"]["rate_hz"], state["info"]["units"][6]) == (960.0, "m/s^2")
    assert state["info"]["resampling_look_ahead_s"] > 0
    assert info["haptic_accel"]["exported_with"]["haptic_accel"] == __version__
    assert info["haptic_accel"]["published"] == {"licence": "CC0-1.0", "author": "Ann"}
    assert info["haptic_accel"]["units"]["action"] == ["m"] * 3 + ["m/s"] * 3


def test_what_differs_between_bags_is_no_part_of_the_features(
    dataset: Path, recorded: Recorded, tmp_path: Path
) -> None:
    bag = write_messages(tmp_path / "lost", [Message(*r) for r in with_types(recorded.path)[:-99]])
    assert status_of("export", bag, "--format", "lerobot", "--out", tmp_path / "set") == 0
    own, other = (json_of(each / "meta" / "info.json") for each in (dataset, tmp_path / "set"))
    assert own["features"] == other["features"]  # LeRobot's `features_equal_for_merge`
    vinyl = episodes(dataset)["haptic_accel"].map(json.loads)[1]
    assert (vinyl["series"], vinyl["condition"]["surface"]) == ("vinyl", "vinyl")
    assert vinyl["begin_ns"] >= START


def test_episodes_have_one_condition_each(tmp_path: Path, recorded: Recorded) -> None:
    surface = ("slave_device", "simulated.surface.name", "vinyl")
    moments = {1: surface, 2: ("compensator", "controller", "inverse")}
    messages = [Message(*row) for row in with_types(recorded.path)]
    for seconds, (node, *change) in moments.items():
        moment = START + seconds * 10**9
        data = change_bytes(moment, f"/{node}", *change)
        messages.append(Message("/parameter_events", CHANGED, moment, data))
    messages.sort(key=lambda each: each.received)
    bag = write_messages(tmp_path / "bag", messages, custom=read_metadata(recorded.path).custom)
    assert status_of("export", bag, "--format", "lerobot", "--out", tmp_path / "set") == 0
    found = episodes(tmp_path / "set")
    tasks = [["feel plywood with a tool"], *[["feel vinyl with a tool"]] * 2]
    assert found["tasks"].map(list).tolist() == tasks
    held = [json.loads(each)["condition"] for each in found["haptic_accel"]]
    assert [each["controller"] for each in held][1:] == ["dynamic", "inverse"]
    assert [each["arguments"]["surface"] for each in held] == ["plywood", "vinyl", "vinyl"]


def test_indices_and_times_follow_each_other(dataset: Path) -> None:
    found = rows(dataset)
    known = episodes(dataset)
    assert found["index"].tolist() == list(range(len(found)))
    for number, own in found.groupby("episode_index"):
        length = int(known["length"][number])
        assert own["frame_index"].tolist() == list(range(length))
        assert own["timestamp"].to_numpy() == pytest.approx(np.arange(length) / 30, abs=1e-5)
    ends = known["dataset_to_index"].tolist()
    assert known["dataset_from_index"].tolist() == [0, *ends[:-1]]
    assert ends[-1] == len(found)


def test_each_task_is_a_text_and_each_episode_a_group_of_rows(dataset: Path) -> None:
    tasks = pd.read_parquet(dataset / "meta" / "tasks.parquet")["task_index"].to_dict()
    assert tasks == {"feel plywood with a tool": 0, "feel vinyl with a tool": 1}
    own = rows(dataset).groupby("episode_index")
    assert own["task_index"].first().tolist() == [0, 1]
    file = parquet.ParquetFile(dataset / "data" / "chunk-000" / "file-000.parquet").metadata
    groups = [file.row_group(n).num_rows for n in range(file.num_row_groups)]
    assert groups == own.size().tolist()


def test_statistics_are_those_of_the_rows(dataset: Path) -> None:
    found, stated = rows(dataset), json_of(dataset / "meta" / "stats.json")
    assert set(stated) == set(found)
    windows = np.stack(found["handle.vibration"])
    own = stated["handle.vibration"]
    assert np.array(own["mean"]) == pytest.approx(windows.mean(axis=0, dtype=float))
    assert np.array(own["std"]) == pytest.approx(windows.std(axis=0, dtype=float))
    assert own["count"] == [len(found)]


def test_the_series_beside_it_are_untouched(dataset: Path, recorded: Recorded) -> None:
    for name, values in vectors(recorded.trial).items():
        series = pd.read_parquet(dataset / "series" / "plywood" / f"{name}.parquet")
        assert np.array_equal(series[["x", "y", "z"]], values)


@pytest.mark.smoke
def test_three_axes_have_three_columns_and_no_place_in_a_set_of_one(
    tmp_path: Path, recorded: Recorded
) -> None:
    write_bag(tmp_path / "bag", rig="three_axis")
    words = ("--fps", "50", "--task", "write", "--out", tmp_path / "set")
    assert status_of("export", tmp_path / "bag", "--format", "lerobot", *words) == 0
    info = json_of(tmp_path / "set" / "meta" / "info.json")
    names = info["features"]["observation.state"]["names"]
    assert [names[6], names[26], names[-2]] == ["vibration.x.0", "vibration.y.0", "vibration.z.19"]
    assert pd.read_parquet(tmp_path / "set" / "meta" / "tasks.parquet").index.tolist() == ["write"]

    words = ("--format", "lerobot", "--out", tmp_path / "both")
    line = refusal("export", recorded.path, tmp_path / "bag", *words)
    assert "must be as the bags before it in one set" in line
    assert {each.name for each in tmp_path.iterdir()} == {"bag", "set"}, "nothing is left"
