# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Images of a camera beside the vibration, aligned to the frames."""

from __future__ import annotations

import io
import itertools
import json
import math
import shutil
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import redirect_stderr
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import pytest
from exported import START, Recorded, write_bag
from hypothesis import given as any_of
from hypothesis import strategies as st
from PIL import Image
from rosbags.typesys import Stores, get_typestore

from bag_maker import Message, write_messages
from damaged import without_checksums
from damaged_files import ANY_BYTES
from fuzzing import fuzz_few, measured, mutated, without_programs
from haptic_accel.bags.reading import messages_of, read_bag
from haptic_accel.core import topics
from haptic_accel.core.topics import SIGNALS
from verbs import output_of, refusal, status_of

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
STORE = get_typestore(Stores.ROS2_JAZZY)
WIDTH, HEIGHT = 16, 12
TOPIC, KEY = "/camera/image_raw", "observation.images.camera_image_raw"


def pixels(number: int) -> Any:
    """Return an image whose colour tells its number."""
    return np.full((HEIGHT, WIDTH, 3), [number % 256, number // 256, 77], np.uint8)


def header(stamp: int) -> Any:
    kinds: Any = STORE.types
    moment = kinds["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
    return kinds["std_msgs/msg/Header"](moment, "camera")


def raw(stamp: int, number: int, encoding: str = "rgb8", **stated: Any) -> bytes:
    """Return an image whose sizes may be stated wrongly."""
    shown = pixels(number)[..., ::-1] if encoding == "bgr8" else pixels(number)
    data = np.ascontiguousarray(shown).ravel()
    sizes = {"height": HEIGHT, "width": WIDTH, "step": 3 * WIDTH} | stated
    message = STORE.types[RAW](
        header(stamp), encoding=encoding, is_bigendian=0, data=data, **sizes
    )
    return bytes(STORE.serialize_cdr(message, RAW))


def compressed(stamp: int, data: bytes, form: str = "png") -> bytes:
    message = STORE.types[COMPRESSED](header(stamp), form, np.frombuffer(data, np.uint8))
    return bytes(STORE.serialize_cdr(message, COMPRESSED))


def encoded(image: Any, form: str = "PNG") -> bytes:
    with io.BytesIO() as file:
        Image.fromarray(image).save(file, form)
        return file.getvalue()


PNG = encoded(pixels(1))
POSTSCRIPT = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n{ } loop\n"
"""Program without an end, for which Pillow starts Ghostscript."""


def stating(size: int, depth: int = 8, colour: int = 2, interlaced: int = 0) -> bytes:
    """Return a PNG of a few bytes that states another width and height."""
    head = b"IHDR" + struct.pack(">II5B", size, size, depth, colour, 0, 0, interlaced)
    return PNG[:12] + head + struct.pack(">I", zlib.crc32(head)) + PNG[33:]


LATE = [START + round(n * 1e9 / 30) for n in range(2, 12)]
"""Stamps of images while the arms are coupled."""


def with_images(path: Path, recorded: Recorded, images: Iterable[Message]) -> Path:
    """Write the messages of a bag with images of a camera."""
    return write_messages(path, [*signals_of(recorded.path), *images])


@cache
def signals_of(bag: Path) -> list[Message]:
    """Return the messages of a bag's signals."""
    kinds = {topic.type for topic in SIGNALS}
    rows = []
    for topic, received, message in messages_of(bag, kinds):
        data = bytes(STORE.serialize_cdr(message, message.__msgtype__))
        rows.append(Message(topic, message.__msgtype__, received, data))
    return rows


def export(bag: Path, *cameras: str, form: str = "lerobot") -> Sequence[object]:
    """Return the words of an export into a set beside the bag."""
    named = [word for camera in cameras or (TOPIC,) for word in ("--camera", camera)]
    more = named if form == "lerobot" else []
    return "export", bag, "--format", form, "--out", bag.with_name("set"), *more


def camera(form: str, fps: float) -> Iterator[Message]:
    """Yield three seconds of images; the first is at the start."""
    for number in range(int(3 * fps)):
        stamp = START + round(number * 1e9 / fps)
        if form == "png":
            data = compressed(stamp, encoded(pixels(number)), "rgb8; png compressed bgr8")
            yield Message(TOPIC, COMPRESSED, stamp, data)
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
    output_of(*export(with_images(tmp_path / "bag", recorded, camera(form, 60.0))))
    ((begin, _),) = read_bag(recorded.path).coupled(topics.MASTER)
    found = numbers(tmp_path / "set", KEY)
    times = begin - START + (np.arange(len(found)) + 1) * 1e9 / 30
    assert found == np.floor(times * 60 / 1e9 + 1e-6).astype(int).tolist()
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert info["features"][KEY]["shape"] == [HEIGHT, WIDTH, 3]
    stats = json.loads((tmp_path / "set" / "meta" / "stats.json").read_text())[KEY]
    assert np.array(stats["mean"]).shape == (3, 1, 1)
    assert stats["mean"][2][0][0] == pytest.approx(77 / 255)


def test_a_slower_camera_repeats_images_and_says_so(tmp_path: Path, recorded: Recorded) -> None:
    bag = with_images(tmp_path / "bag", recorded, camera("rgb8", 20.0))
    assert "frames repeat an image" in output_of(*export(bag))
    found = numbers(tmp_path / "set", KEY)
    assert found == sorted(found)


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of eleven frames, without checksums and metadata."""
    folder = tmp_path_factory.mktemp("short")
    trial = write_bag(folder / "whole", duration=0.4)
    bag = with_images(folder / "bag", Recorded(folder / "whole", trial), ())
    without_checksums(bag / "bag.mcap")
    (bag / "metadata.yaml").unlink()
    return bag


def with_camera(short: Path, folder: Path, images: Iterable[Message]) -> Path:
    """Return a copy of a short bag with a file of images."""
    shutil.copytree(short, folder / "bag")
    write_messages(folder / "camera", images)
    return (folder / "camera" / "camera.mcap").rename(folder / "bag" / "camera.mcap").parent


def stated(**sizes: Any) -> Iterator[Message]:
    """Yield images with wrong sizes."""
    return (Message(TOPIC, RAW, s, raw(s, 1, **sizes)) for s in LATE)


def given(*images: bytes, form: str = "png") -> Iterator[Message]:
    """Yield some images, one after the other, again and again."""
    for stamp, data in zip(LATE, itertools.cycle(images), strict=False):
        yield Message(TOPIC, COMPRESSED, stamp, compressed(stamp, data, form))


@pytest.mark.parametrize(
    ("images", "line"),
    [
        (camera("rgb8", 5.0), "frames repeat an image: fps = 30: must be at most that of the"),
        (camera("yuv422", 30.0), "encoding = 'yuv422': must be one of rgb8, bgr8, mono8"),
        (stated(step=9), "16 x 12, step = 9: must fit 576 bytes"),
        (stated(step=2**31), "16 x 12, step = 2147483648: must fit 576 bytes"),
        (stated(height=11), "16 x 11, step = 48: must fit 576 bytes"),
        (stated(height=37_000, width=37_000), "size = 37000 x 37000: must be 1 to 16777216 p"),
        (stated(height=0, width=0, step=0), "size = 0 x 0: must be 1 to 16777216 pixels"),
        (given(b"no image"), "cannot identify image file"),
        (given(PNG, form="jpeg"), "cannot identify image file"),
        (given(POSTSCRIPT), "cannot identify image file"),
        (given(POSTSCRIPT, form="eps"), "format = 'eps': must be png or jpeg"),
        (given(stating(40_000)), "Image size (1600000000 pixels) exceeds limit"),
        (given(stating(6_000)), "size = 6000 x 6000: must be 1 to 16777216 pixels"),
        (given(PNG[:-20]), "unusable images: "),
        (given(encoded(np.zeros((9, 9), np.uint16))), "mode = I;16: must be one of RGB, RGBA, L"),
        (given(PNG, encoded(pixels(1)[:6])), "shape = (6, 16, 3): must be (12, 16, 3), as before"),
        ((Message(TOPIC, RAW, s, raw(s, 1)[:50]) for s in LATE), "a message cannot be read: "),
        (iter(()), "has no images while the arms were coupled"),
    ],
)
def test_images_that_do_not_fit_are_refused_and_nothing_is_left(
    short: Path, tmp_path: Path, images: Iterator[Message], line: str
) -> None:
    bag = with_camera(short, tmp_path, images)
    with measured(seconds=60.0):
        assert line in refusal(*export(bag))
    assert {each.name for each in tmp_path.iterdir()} == {"bag", "camera"}


def test_an_image_that_cannot_be_read_costs_only_its_own_frame(
    tmp_path: Path, recorded: Recorded
) -> None:
    images = list(camera("png", 30.0))
    for at in (60, 61):
        images[at] = images[at]._replace(data=compressed(images[at].received, PNG[:-20]))
    bag = with_images(tmp_path / "bag", recorded, images)
    assert "2 of " in (text := output_of(*export(bag)))
    assert "frames repeat an image; unusable images: 2, the first at 1700000002.000 s: " in text
    found = numbers(tmp_path / "set", KEY)
    at = found.index(59)
    assert found[at : at + 4] == [59, 59, 59, 62]


def test_a_grey_image_has_three_channels(short: Path, tmp_path: Path) -> None:
    grey = given(encoded(pixels(1)[..., 0], "JPEG"), form="jpeg")
    output_of(*export(with_camera(short, tmp_path, grey)))
    rows = pd.read_parquet(tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet")
    assert Image.open(io.BytesIO(rows[KEY][0]["bytes"])).mode == "RGB"


def test_cameras_with_one_name_in_the_set_are_refused(recorded: Recorded) -> None:
    line = refusal(*export(recorded.path, "/a/b", "a_b"))
    assert line == "camera = /a/b, a_b: must have different names, also with _ in place of /"


FILES = [POSTSCRIPT, *(encoded(pixels(1), form) for form in ("PNG", "JPEG", "GIF", "TIFF", "PPM"))]


@st.composite
def foreign(draw: st.DrawFn, stamp: int, form: str) -> bytes:
    """Return anything that claims to be an image of a stamp."""
    size = st.integers(0, 20) | st.sampled_from([48, 37_000, 2**31, 2**32 - 1])
    if form != "png":
        sizes = dict.fromkeys(("height", "width", "step"), size)
        stated = draw(st.fixed_dictionaries({}, optional=sizes))
        encoding = draw(st.sampled_from(["rgb8", "bgr8", "mono8", "", "yuv422"]))
        return raw(stamp, 1, encoding, **stated)
    headers = st.builds(stating, size, *[st.integers(0, 20)] * 3)
    data = draw(mutated(headers | st.sampled_from(FILES), ANY_BYTES))
    said = draw(st.sampled_from(["png", "jpeg", "rgb8; jpeg compressed bgr8", "eps", ""]))
    return compressed(stamp, data, said)


@fuzz_few
@any_of(data=st.data(), form=st.sampled_from(["png", "rgb8"]), at=st.integers(2, 11))
def test_any_image_costs_at_most_its_own_frame(
    short: Path, data: st.DataObject, form: str, at: int
) -> None:
    images = [*camera(form, 30.0)][:12]
    images[at] = images[at]._replace(data=data.draw(foreign(images[at].received, form)))
    with TemporaryDirectory() as folder:
        bag = with_camera(short, Path(folder), images)
        with measured(seconds=20.0), without_programs():
            output_of(*export(bag))
        found = numbers(bag.with_name("set"), KEY)
    del found[at - 1]
    assert found == [n for n in range(1, 12) if n != at]


ODD = [struct.pack("<d", value) for value in (1e308, -1e308, 1e38, 1e-320, math.nan, math.inf)]
FORMS = ["lerobot", "parquet", "hdf5", "csv", "wav", "mcap-audio"]


@fuzz_few
@any_of(data=st.data(), form=st.sampled_from(FORMS), at=st.integers(0, 11))
def test_any_damage_to_a_bag_is_exported_or_refused_in_one_line(
    short: Path, data: st.DataObject, form: str, at: int
) -> None:
    images = [*camera("png", 30.0)][:12]
    pieces = ANY_BYTES | st.sampled_from(ODD)
    images[at] = images[at]._replace(data=data.draw(mutated(st.just(images[at].data), pieces)))
    with TemporaryDirectory() as folder:
        bag = with_camera(short, Path(folder), images)
        content = data.draw(mutated(st.just((bag / "bag.mcap").read_bytes()), pieces))
        (bag / "bag.mcap").write_bytes(content)
        told = io.StringIO()
        with measured(seconds=20.0), without_programs(), redirect_stderr(told):
            status = status_of(*export(bag, form=form))
        lines = told.getvalue().splitlines()
        assert (status, len(lines)) in ((0, 0), (2, 1)), lines
        left = ["bag", "camera", *["set"] * (not status)]
        assert sorted(each.name for each in Path(folder).iterdir()) == left
