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

"""Images of a camera for the frames of a learning set, and statistics of all its features."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Mapping, Sequence
from tempfile import TemporaryFile
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from PIL import Image

from haptic_accel.bags.reading import Bag, messages_of
from haptic_accel.core.parameters import ParameterError, one_line, shown
from haptic_accel.core.sampling import NANOSECONDS, IntArray

QUANTILES = (0.01, 0.10, 0.50, 0.90, 0.99)

_REDUCTIONS: dict[str, Any] = {"min": np.min, "max": np.max, "count": np.sum}

Statistics = dict[str, npt.NDArray[Any]]
"""Values of one feature by name, in the shape of the feature; ``count`` has shape (1,)."""


def statistics(array: npt.NDArray[Any]) -> Statistics:
    """Return the statistics of a feature over its frames, shape (n, ...).

    Examples
    --------
    >>> found = statistics(np.array([0.0, 1.0, 2.0, 5.0]))
    >>> [found[name].tolist() for name in ("max", "mean", "q50", "count")]
    [[5.0], [2.0], [1.5], [4]]
    """
    array = array if array.ndim > 1 else array[:, np.newaxis]
    quantiles = np.quantile(array, QUANTILES, axis=0)
    return {
        "min": array.min(axis=0),
        "max": array.max(axis=0),
        "mean": array.mean(axis=0, dtype=np.float64),
        "std": array.std(axis=0, dtype=np.float64),
        "count": np.array([len(array)]),
        **{f"q{round(100 * q):02d}": row for q, row in zip(QUANTILES, quantiles, strict=True)},
    }


def combined(episodes: Sequence[Mapping[str, Statistics]]) -> dict[str, Statistics]:
    """Return the statistics of all episodes by feature.

    Quantiles are means of those of the episodes, as LeRobot computes them.
    """
    return {
        key: {name: _combined(name, [own[key] for own in episodes]) for name in episodes[0][key]}
        for key in episodes[0]
    }


def _combined(name: str, each: Sequence[Statistics]) -> npt.NDArray[Any]:
    values = np.array([own[name] for own in each])
    weights = [float(own["count"][0]) for own in each]
    if name in _REDUCTIONS:
        return np.asarray(_REDUCTIONS[name](values, axis=0))
    if name != "std":
        return np.asarray(np.average(values, axis=0, weights=weights))
    means = np.array([own["mean"] for own in each])
    spread = means - np.average(means, axis=0, weights=weights)
    return np.asarray(np.sqrt(np.average(values**2 + spread**2, axis=0, weights=weights)))


RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
"""Types of images."""

ENCODINGS = {"rgb8": [0, 1, 2], "bgr8": [2, 1, 0], "mono8": [0, 0, 0]}
"""Places of red, green and blue among the bytes of a pixel, by encoding of `RAW`."""

READERS = {"png": "PNG", "jpeg": "JPEG", "jpg": "JPEG"}
"""Pillow's reader by the word in the format of `COMPRESSED`. No other reader is used, as some
start programs."""

MODES = ("RGB", "RGBA", "L", "P")
"""Pillow's modes with eight bits for each colour."""

MOST_PIXELS = 2**24
"""Largest size of an image, pixels: twice that of a 4K camera. It takes 230 MB to decode."""

MOST_REPEATED = 0.5
"""Largest share of frames without a new image."""

SAMPLED = 100
"""Most images of an episode from which statistics are computed, as LeRobot does."""

SAMPLED_PIXELS = 30_000
"""Pixels of an image for statistics, at least, if it has as many."""

_STORED = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


def camera_frames(
    bag: Bag, topics: Sequence[str], times: IntArray, fps: int
) -> list[CameraFrames]:
    """Return for each frame the newest image at its time, by topic.

    Images that cannot be used are left out, and counted in the notes.

    Raises
    ------
    ParameterError
        Two topics have one name in a set, a topic has no images, or most frames have no new image.
    """
    names = [topic.strip("/") for topic in topics]
    cameras = {f"/{name}": CameraFrames(name.replace("/", "_"), times) for name in names}
    if len({camera.key for camera in cameras.values()}) < len(topics):
        raise ParameterError(
            f"camera = {', '.join(topics)}: must have different names, also with _ in place of /"
        )
    for topic, _, message in messages_of(bag.path, (RAW, COMPRESSED)) if cameras else ():
        if topic in cameras:
            cameras[topic].add(message)
    for topic, camera in cameras.items():
        if problem := camera.finish(fps):
            raise ParameterError(f"{bag.path}: camera {topic}: {problem}")
    return list(cameras.values())


class CameraFrames:
    """Images of the frames of an episode, on the disk: for each the newest at its time.

    Parameters
    ----------
    name : str
        Name of the camera.
    times : ndarray of int64
        Times of the frames, ns.

    Attributes
    ----------
    key : str
        Name of the feature.
    shape : tuple of int
        Height, width, channels.
    notes : list of str
    """

    def __init__(self, name: str, times: IntArray) -> None:
        self.key, self._times = f"observation.images.{name}", times
        self.shape: tuple[int, ...] = ()
        self.notes: list[str] = []
        self._waiting: tuple[int, int, Any] = -1, 0, None
        self._file = TemporaryFile()  # noqa: SIM115, closed with the frames
        self._parts: dict[int, tuple[int, int]] = {}
        self._unusable, self._first = 0, ""

    def add(self, message: Any) -> None:
        """Add an image; the one before is stored if the next frame has it."""
        stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        frame = int(np.searchsorted(self._times, stamp))  # the first that can have it
        if frame != self._waiting[0]:
            self._store()
        self._waiting = frame, stamp, message

    def _store(self) -> None:
        frame, stamp, message = self._waiting
        if not 0 <= frame < len(self._times):
            return
        try:
            data, shape = _stored(message)
            self.shape = self.shape or shape
            if shape != self.shape:
                raise ValueError(f"shape = {shape}: must be {self.shape}, as before")
        except Exception as error:  # a reader of foreign data may raise anything
            reason = f"the first at {stamp / NANOSECONDS:.3f} s: {shown(one_line(error))}"
            self._unusable, self._first = self._unusable + 1, self._first or reason
        else:
            self._parts[frame] = self._file.tell(), len(data)
            self._file.write(data)

    def finish(self, fps: int) -> str:
        """Repeat the image before a frame without a new one; return why that is impossible."""
        self._store()
        reason = f"; unusable images: {self._unusable}, {self._first}" if self._unusable else ""
        if not self._parts:
            return f"has no images while the arms were coupled{reason}"
        count = len(self._times)
        repeated = count - len(self._parts)
        text = f"{repeated} of {count} frames repeat an image"
        if repeated > MOST_REPEATED * count:
            return f"{text}: fps = {fps}: must be at most that of the camera{reason}"
        self.notes += [f"{self.key}: {text}{reason}"] if repeated or reason else []
        newest = self._parts[min(self._parts)]
        for frame in range(count):
            newest = self._parts.setdefault(frame, newest)
        return ""

    def column(self, begin: int, end: int) -> pa.Array:
        """Return images of some frames as Hugging Face's `datasets` embeds them."""
        rows = [{"bytes": self._image(frame), "path": None} for frame in range(begin, end)]
        return pa.array(rows, _STORED)

    def statistics(self) -> Statistics:
        """Return statistics of each colour, from 0 to 1, shape (3, 1, 1)."""
        count, readers = len(self._parts), list(READERS.values())
        chosen = np.linspace(0, count - 1, min(SAMPLED, count)).astype(int).tolist()
        step = max(1, self.shape[0] * self.shape[1] // SAMPLED_PIXELS)
        images = (_decoded(self._image(frame), readers)[1] for frame in chosen)
        pixels = np.concatenate([image.reshape(-1, 3)[::step] for image in images])
        found = statistics(pixels.reshape(-1, 3, 1, 1) / np.float32(255))
        return found | {"count": np.array([len(chosen)])}

    def _image(self, frame: int) -> bytes:
        """Return the PNG or JPEG of a frame."""
        begin, size = self._parts[frame]
        self._file.seek(begin)
        return self._file.read(size)


def _stored(message: Any) -> tuple[bytes, tuple[int, ...]]:
    """Return an image as it was compressed, or else as PNG in colour, and its shape."""
    if message.__msgtype__ == RAW:
        mode, pixels = "", _uncompressed(message)
    else:
        mode, pixels = _decoded(bytes(message.data), _readers(message.format))
    if mode == "RGB":
        return bytes(message.data), pixels.shape
    with io.BytesIO() as file:
        Image.fromarray(pixels).save(file, "PNG", compress_level=1)
        return file.getvalue(), pixels.shape


def _uncompressed(message: Any) -> Any:
    """Return the pixels of an image whose sizes agree with its data, shape (height, width, 3)."""
    height, width, step = message.height, message.width, message.step
    if message.encoding not in ENCODINGS:
        raise ValueError(f"encoding = {message.encoding!r}: must be one of {', '.join(ENCODINGS)}")
    colours = ENCODINGS[message.encoding]
    size = max(colours) + 1
    _check_size(width, height)
    if step < size * width or len(message.data) != step * height:
        raise ValueError(f"{width} x {height}, step = {step}: must fit {len(message.data)} bytes")
    rows = message.data.reshape(height, step)[:, : size * width]
    return rows.reshape(height, width, size)[..., colours]


def _readers(stated: str) -> list[str]:
    """Return the one reader for a stated format, as in ``bgr8; jpeg compressed bgr8``."""
    found = {READERS[word] for word in re.findall("[a-z]+", stated.lower()) if word in READERS}
    if len(found) != 1:
        raise ValueError(f"format = {stated!r}: must be png or jpeg")
    return list(found)


def _decoded(data: bytes, readers: list[str]) -> tuple[str, Any]:
    """Return an image's mode, and its pixels in colour, shape (height, width, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of metadata that are not used
        # The end of a PNG, which is not read for its pixels.
        Image.open(io.BytesIO(data), formats=readers).verify()
        with Image.open(io.BytesIO(data), formats=readers) as image:
            _check_size(*image.size)
            if image.mode not in MODES:
                raise ValueError(f"mode = {image.mode}: must be one of {', '.join(MODES)}")
            return image.mode, np.asarray(image.convert("RGB"))


def _check_size(width: int, height: int) -> None:
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"size = {width} x {height}: must be 1 to {MOST_PIXELS} pixels")
