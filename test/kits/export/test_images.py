# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Images of a camera beside the vibration, aligned to the frames."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from exported import START, Recorded
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from bag_maker import Message, write_messages
from haptic_accel.bags.reading import messages_of, read_bag
from haptic_accel.core import topics
from haptic_accel.core.topics import SIGNALS
from verbs import output_of, refusal

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
STORE = get_typestore(Stores.ROS2_JAZZY)
WIDTH, HEIGHT = 16, 12
TOPIC = "/camera/image_raw"


def pixels(number: int) -> Any:
    """Return an image whose colour tells its number."""
    return np.full((HEIGHT, WIDTH, 3), [number % 256, number // 256, 77], np.uint8)


def header(stamp: int) -> Any:
    kinds: Any = STORE.types
    moment = kinds["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
    return kinds["std_msgs/msg/Header"](moment, "camera")


def raw(stamp: int, number: int, encoding: str = "rgb8", *, step: int = 3 * WIDTH) -> bytes:
    shown = pixels(number)[..., ::-1] if encoding == "bgr8" else pixels(number)
    data = np.ascontiguousarray(shown).ravel()
    message = STORE.types[RAW](header(stamp), HEIGHT, WIDTH, encoding, 0, step, data)
    return bytes(STORE.serialize_cdr(message, RAW))


def compressed(stamp: int, data: bytes) -> bytes:
    kind = STORE.types[COMPRESSED]
    message = kind(header(stamp), "png", np.frombuffer(data, np.uint8))
    return bytes(STORE.serialize_cdr(message, COMPRESSED))


def png(number: int, size: int = 1) -> bytes:
    with io.BytesIO() as file:
        Image.fromarray(pixels(number)).resize((WIDTH * size, HEIGHT * size)).save(file, "PNG")
        return file.getvalue()


LATE = [START + round(n * 1e9 / 30) for n in range(30, 90)]
"""Stamps of images while the arms are coupled."""


def with_images(path: Path, recorded: Recorded, images: Iterator[Message]) -> Path:
    """Write the messages of a bag with images of a camera."""
    kinds = {topic.type for topic in SIGNALS}
    rows = []
    for topic, received, message in messages_of(recorded.path, kinds):
        data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
        rows.append(Message(topic, message.__msgtype__, received, data))
    return write_messages(path, [*rows, *images])


def camera(form: str, fps: float) -> Iterator[Message]:
    """Yield three seconds of images; the first is at the start."""
    for number in range(int(3 * fps)):
        stamp = START + round(number * 1e9 / fps)
        if form == "png":
            yield Message(TOPIC, COMPRESSED, stamp, compressed(stamp, png(number)))
        else:
            yield Message(TOPIC, RAW, stamp, raw(stamp, number, form))


def numbers(dataset: Path, key: str) -> list[int]:
    """Return the numbers that the images of a set tell."""
    rows = pd.read_parquet(dataset / "data" / "chunk-000" / "file-000.parquet")
    found = [np.asarray(Image.open(io.BytesIO(cell["bytes"]))) for cell in rows[key]]
    return [int(each[0, 0, 0]) + 256 * int(each[0, 0, 1]) for each in found]


@pytest.mark.parametrize("form", ["rgb8", "bgr8", "png"])
def test_each_frame_has_the_newest_image_at_its_time(
    tmp_path: Path, recorded: Recorded, form: str
) -> None:
    bag = with_images(tmp_path / "bag", recorded, camera(form, 60.0))
    words = ("--format", "lerobot", "--camera", TOPIC, "--out", tmp_path / "set")
    output_of("export", bag, *words)
    key = "observation.images.camera_image_raw"
    ((begin, _),) = read_bag(recorded.path).coupled(topics.MASTER)
    found = numbers(tmp_path / "set", key)
    times = begin - START + (np.arange(len(found)) + 1) * 1e9 / 30
    assert found == np.floor(times * 60 / 1e9 + 1e-6).astype(int).tolist()
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert info["features"][key]["shape"] == [HEIGHT, WIDTH, 3]
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())[key]
    assert np.array(stats["mean"]).shape == (3, 1, 1)
    assert stats["mean"][2][0][0] == pytest.approx(77 / 255)


def test_a_slower_camera_repeats_images_and_says_so(tmp_path: Path, recorded: Recorded) -> None:
    bag = with_images(tmp_path / "bag", recorded, camera("rgb8", 20.0))
    words = ("--format", "lerobot", "--camera", TOPIC, "--out", tmp_path / "set")
    assert "frames repeat an image" in output_of("export", bag, *words)
    found = numbers(tmp_path / "set", "observation.images.camera_image_raw")
    assert found == sorted(found)


@pytest.mark.parametrize(
    ("images", "line"),
    [
        (camera("rgb8", 5.0), "frames repeat an image: fps = 30: must be at most that of the"),
        (camera("yuv422", 30.0), "encoding = 'yuv422': must be one of rgb8, bgr8, mono8"),
        (
            (Message(TOPIC, RAW, s, raw(s, 1, step=9)) for s in range(START, START + 9)),
            "step = 9: must be at least 48",
        ),
        (
            (
                Message(TOPIC, COMPRESSED, s, compressed(s, b"no image"))
                for s in range(START, START + 9)
            ),
            "cannot identify image file",
        ),
        (
            (
                Message(TOPIC, COMPRESSED, s, compressed(s, png(1, 1 + n % 2)))
                for n, s in enumerate(LATE)
            ),
            "must be (12, 16, 3), as before",
        ),
        ((Message(TOPIC, RAW, s, raw(s, 1)[:50]) for s in LATE), "a message cannot be read: "),
        (iter(()), "has no images while the arms were coupled"),
    ],
    ids=["slow", "encoding", "step", "damaged", "sizes", "cut", "none"],
)
def test_images_that_do_not_fit_are_refused_and_nothing_is_left(
    tmp_path: Path, recorded: Recorded, images: Iterator[Message], line: str
) -> None:
    bag = with_images(tmp_path / "bag", recorded, images)
    words = ("--format", "lerobot", "--camera", TOPIC, "--out", tmp_path / "set")
    assert line in refusal("export", bag, *words)
    assert [each.name for each in tmp_path.iterdir()] == ["bag"]
