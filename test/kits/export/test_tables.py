# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parquet and CSV, opened again by other libraries."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from exported import Recorded, stamps, vectors
from pyarrow import csv, parquet

from verbs import status_of


@pytest.fixture(scope="module", params=["parquet", "csv"])
def folder(
    request: pytest.FixtureRequest, recorded: Recorded, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    out = tmp_path_factory.mktemp("exports") / request.param
    path = recorded.path
    assert status_of("export", path, "--format", request.param, "--out", out) == 0
    return out / path.name


def table(folder: Path, name: str) -> pd.DataFrame:
    """Read a signal as a stranger does."""
    file = folder / f"{name}.csv"
    if file.exists():
        found = csv.read_csv(file).to_pandas()
        return found.rename(columns=lambda title: title.partition(" ")[0])
    found = pd.read_parquet(file.with_suffix(".parquet"))
    return found.assign(stamp=found["stamp"].astype("int64"))


def test_values_are_those_of_the_bag_to_the_last_digit(folder: Path, recorded: Recorded) -> None:
    trial = recorded.trial
    written = vectors(trial)
    assert {file.stem for file in folder.iterdir()} - {"signals"} == written.keys()
    for name, values in written.items():
        found = table(folder, name)
        assert np.array_equal(found["stamp"], stamps(trial))
        assert np.array_equal(found[["x", "y", "z"]], values)


def test_each_signal_states_its_unit_and_rate(folder: Path) -> None:
    if folder.parent.name == "csv":
        about = json.loads((folder / "signals.json").read_text())["signals"]
        title = (folder / "tool_acceleration.csv").read_text().partition("\n")[0]
        assert title == "stamp [ns],x [m/s^2],y [m/s^2],z [m/s^2]"
    else:
        schema = parquet.read_schema(folder / "tool_acceleration.parquet")
        about = json.loads(schema.metadata[b"haptic_accel"])["signals"]
        assert schema.field("x").metadata == {b"unit": b"m/s^2"}
    tool = about["tool_acceleration"]
    assert (tool["unit"], tool["rate_hz"], tool["missing_samples"]) == ("m/s^2", 1000.0, 0)
    assert (tool["frame"], tool["axes"]) == ("slave_tool", ["x", "y", "z"])
