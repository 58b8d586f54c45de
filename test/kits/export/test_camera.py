# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A camera with touch, with the commands and the program of the page."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from haptic_accel.bags.reading import messages_of
from running import Start

PAGE = Path(__file__).resolve().parents[3] / "haptic_accel" / "kits" / "export" / "README.md"
SECTION = PAGE.read_text(encoding="utf-8").partition("## A camera with touch")[2]
PROGRAM = re.findall(r"^```python\n(.*?)^```", SECTION, re.MULTILINE | re.DOTALL)[0]
TELEOP, EXPORT = re.findall(r"^haptic-accel (.*)$", SECTION, re.MULTILINE)
TOPIC, RAW = "/camera/image_raw", "sensor_msgs/msg/Image"


def test_images_are_recorded_with_the_graph_and_exported_with_its_frames(
    start: Start, haptic_accel: Start, tmp_path: Path
) -> None:
    (tmp_path / "test_camera.py").write_text(PROGRAM)
    start("test_camera.py")
    graph = haptic_accel(*TELEOP.replace("duration:=10", "duration:=4").split(), "rate:=250")
    graph.wait_for(f"{TOPIC}: recorded too")
    assert graph.end(patience=60.0) == 0, graph.text
    done = haptic_accel(*EXPORT.split())
    assert done.end() == 0, done.text

    images = [
        (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec, message.data.tobytes())
        for _, _, message in messages_of(tmp_path / "bags" / "camera", (RAW,))
    ]
    stamps = np.array([stamp for stamp, _ in images])
    dataset = tmp_path / "camera_set"
    rows = pd.read_parquet(dataset / "data" / "chunk-000" / "file-000.parquet")
    episodes = pd.read_parquet(dataset / "meta" / "episodes" / "chunk-000" / "file-000.parquet")
    assert len(rows) > 60
    for frame, cell in enumerate(rows["observation.images.camera_image_raw"]):
        time = json.loads(episodes["haptic_accel"][0])["begin_ns"] + round((frame + 1) * 1e9 / 30)
        newest = int(np.searchsorted(stamps, time, side="right")) - 1
        assert np.asarray(Image.open(io.BytesIO(cell["bytes"]))).tobytes() == images[newest][1]
    info = json.loads((dataset / "meta" / "info.json").read_text())
    assert info["features"]["observation.images.camera_image_raw"]["shape"] == [120, 160, 3]
    # At 250 Hz there are 240 samples a second, eight for each frame.
    assert info["features"]["handle.vibration"]["shape"] == [8]
