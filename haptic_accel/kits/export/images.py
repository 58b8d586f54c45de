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

"""Images of a camera for the frames of a learning set."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from tempfile import TemporaryFile
from typing import IO, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from PIL import Image

from haptic_accel.bags.reading import Bag, messages_of
from haptic_accel.core.parameters import ParameterError, one_line, shown
from haptic_accel.core.sampling import NANOSECONDS, IntArray
from haptic_accel.kits.export.statistics import Statistics, statistics

RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
"""Types of images."""

MODES = {"rgb8": ("RGB", "RGB", 3), "bgr8": ("RGB", "BGR", 3), "mono8": ("L", "L", 1)}
"""Encodings of `RAW`: Pillow's mode, its raw mode, and bytes of a pixel."""

MOST_REPEATED = 0.5
"""Largest share of frames without a new image."""

SAMPLED = 100
"""Most images of an episode from which statistics are computed, as LeRobot does."""

THUMBNAIL = 150
"""Shorter side of an image for statistics, pixels, at least."""

_STORED = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


@dataclass(frozen=True)
class CameraFrames:
    """Images of the frames of an episode, on the disk.

    Attributes
    ----------
    key : str
        Name of the feature.
    shape : tuple of int
        Height, width, channels.
    notes : list of str
    """

    key: str
    shape: tuple[int, ...]
    notes: list[str]
    _file: IO[bytes] = field(repr=False)
    _parts: Sequence[tuple[int, int]] = field(repr=False)

    def image(self, frame: int) -> bytes:
        """Return the PNG or JPEG of a frame."""
        begin, size = self._parts[frame]
        self._file.seek(begin)
        return self._file.read(size)

    def column(self, begin: int, end: int) -> pa.Array:
        """Return images of some frames as Hugging Face's `datasets` embeds them."""
        rows = [{"bytes": self.image(frame), "path": None} for frame in range(begin, end)]
        return pa.array(rows, _STORED)

    def statistics(self) -> Statistics:
        """Return statistics of each colour, from 0 to 1, shape (3, 1, 1)."""
        count = len(self._parts)
        chosen = np.linspace(0, count - 1, min(SAMPLED, count)).astype(int).tolist()
        step = max(1, min(self.shape[:2]) // THUMBNAIL)
        images = (_pixels(self.image(frame))[::step, ::step] for frame in chosen)
        pixels = np.array(list(images)) / np.float32(255)
        return statistics(pixels.reshape(-1, 3, 1, 1)) | {"count": np.array([len(chosen)])}


def camera_frames(
    bag: Bag, topics: Sequence[str], times: IntArray, fps: int
) -> list[CameraFrames]:
    """Return for each frame the newest image at its time, by topic.

    Raises
    ------
    ParameterError
        A topic has no images, an image is unreadable, or most frames have no new image.
    """
    cameras = {f"/{topic.strip('/')}": _Camera(bag, topic, times) for topic in topics}
    if cameras:
        for topic, _, message in messages_of(bag.path, (RAW, COMPRESSED)):
            if topic in cameras:
                cameras[topic].add(message)
    return [camera.frames(fps) for camera in cameras.values()]


class _Camera:
    """Images of one topic, of which the last before each frame is kept."""

    def __init__(self, bag: Bag, topic: str, times: IntArray) -> None:
        self._location = f"{bag.path}: camera {topic}"
        self._times = times
        self._waiting: tuple[int, int, Any] = -1, 0, None
        self._key = f"observation.images.{topic.strip('/').replace('/', '_')}"
        self._file = TemporaryFile()  # noqa: SIM115, closed with the frames
        self._parts: dict[int, tuple[int, int]] = {}
        self._shape: tuple[int, ...] = ()

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
            data = _encoded(message)
            shape = _pixels(data).shape
            self._shape = self._shape or shape
            if shape != self._shape:
                raise ValueError(f"shape = {shape}: must be {self._shape}, as before")
        except (ValueError, OSError) as error:
            raise ParameterError(
                f"{self._location}: image at {stamp / NANOSECONDS:.3f} s: {shown(one_line(error))}"
            ) from None
        self._parts[frame] = self._file.tell(), len(data)
        self._file.write(data)

    def frames(self, fps: int) -> CameraFrames:
        """Return the images of all frames; a frame without a new one repeats the one before."""
        self._store()
        if not self._parts:
            raise ParameterError(f"{self._location}: has no images while the arms were coupled")
        count, parts = len(self._times), [self._parts[min(self._parts)]]
        for frame in range(count):
            parts.append(self._parts.get(frame, parts[-1]))
        repeated = count - len(self._parts)
        text = f"{repeated} of {count} frames repeat an image"
        if repeated > MOST_REPEATED * count:
            raise ParameterError(
                f"{self._location}: {text}: fps = {fps}: must be at most that of the camera"
            )
        notes = [f"{self._key}: {text}"] if repeated else []
        return CameraFrames(self._key, self._shape, notes, self._file, parts[1:])


def _encoded(message: Any) -> bytes:
    """Return an image as PNG, or as it was compressed."""
    if message.__msgtype__ == COMPRESSED:
        return bytes(message.data)
    if message.encoding not in MODES:
        raise ValueError(f"encoding = {message.encoding!r}: must be one of {', '.join(MODES)}")
    mode, raw, size = MODES[message.encoding]
    if message.step < size * message.width:
        raise ValueError(f"step = {message.step}: must be at least {size * message.width}")
    shape = message.width, message.height
    image = Image.frombytes(mode, shape, bytes(message.data), "raw", raw, message.step)
    with io.BytesIO() as file:
        image.convert("RGB").save(file, "PNG", compress_level=1)
        return file.getvalue()


def _pixels(file: bytes) -> npt.NDArray[np.uint8]:
    """Return the pixels of an image, shape (height, width, 3)."""
    with Image.open(io.BytesIO(file)) as image:
        return np.asarray(image.convert("RGB"))
