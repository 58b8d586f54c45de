# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""LeRobotDataset v3.0 with vibration of tool and handle, readable by unmodified LeRobot.

Layout, features and statistics after LeRobot 0.6 (huggingface/lerobot, ``src/lerobot/datasets``).
Its schema does not support channels faster than the frames; the tool's samples are therefore
components of the state, as in datasets that LeRobot records itself. The folder ``series`` has all
signals as recorded. Differences between bags are in a column of the episodes, which a merge of
datasets keeps.

Each frame has the newest camera images at its time; statistics cover all features.
"""

from __future__ import annotations

import io
import json
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
from PIL import Image
from pyarrow import parquet

from haptic_accel import Axes, Bag, ParameterError
from haptic_accel.analysis import UNKNOWN
from haptic_accel.bags import messages_of
from haptic_accel.core import ALL_AXES, VIBRATION
from haptic_accel.core.parameters import one_line, shown
from haptic_accel.core.sampling import NANOSECONDS, IntArray
from haptic_accel.kits.export import signals
from haptic_accel.kits.export.signals import FrameRate, Frames, SingleArray
from haptic_accel.kits.export.tables import write_parquet

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
"""Message types of images."""

ENCODINGS = {"rgb8": [0, 1, 2], "bgr8": [2, 1, 0], "mono8": [0, 0, 0]}
"""Indices of red, green and blue in the bytes of a pixel, by encoding of `RAW`."""

READERS = {"png": "PNG", "jpeg": "JPEG", "jpg": "JPEG"}
"""Pillow's reader, by the format in `COMPRESSED`. No other reader is used, as some start
programs."""

MODES = ("RGB", "RGBA", "L", "P")
"""Pillow's modes with eight bits for each colour."""

MOST_PIXELS = 2**24
"""Maximum size of an image, pixels: twice that of a 4K camera. Decoding needs 230 MB."""

MOST_REPEATED = 0.5
"""Maximum share of frames without a new image."""

SAMPLED = 100
"""Maximum number of images per episode for statistics, as in LeRobot."""

SAMPLED_PIXELS = 30_000
"""Minimum number of an image's pixels for statistics, if the image has as many."""

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
    """Images of an episode's frames, stored on disk: the newest at the time of each frame.

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
        """Add an image; store the previous one if the next frame shows it."""
        stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        frame = int(np.searchsorted(self._times, stamp))  # the first frame that can show the image
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
        """Repeat images for frames without a new one; return the reason if impossible."""
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
        """Return images of some frames in the form of Hugging Face's `datasets`."""
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
    """Return an image, compressed as recorded or else as colour PNG, and its shape."""
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
    """Return the only reader for a stated format, such as ``bgr8; jpeg compressed bgr8``."""
    found = {READERS[word] for word in re.findall("[a-z]+", stated.lower()) if word in READERS}
    if len(found) != 1:
        raise ValueError(f"format = {stated!r}: must be png or jpeg")
    return list(found)


def _decoded(data: bytes, readers: list[str]) -> tuple[str, Any]:
    """Return an image's mode, and its pixels in colour, shape (height, width, 3)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about unused metadata
        # Check the end of a PNG, which decoding does not read.
        Image.open(io.BytesIO(data), formats=readers).verify()
        with Image.open(io.BytesIO(data), formats=readers) as image:
            _check_size(*image.size)
            if image.mode not in MODES:
                raise ValueError(f"mode = {image.mode}: must be one of {', '.join(MODES)}")
            return image.mode, np.asarray(image.convert("RGB"))


def _check_size(width: int, height: int) -> None:
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"size = {width} x {height}: must be 1 to {MOST_PIXELS} pixels")


VERSION = "v3.0"
"""Version of LeRobot's format."""

STATE_KEY, HANDLE_KEY = "observation.state", f"handle.{VIBRATION}"
"""Features with the vibration of tool and handle; a policy does not observe the handle's."""

VALID = f"{VIBRATION}.valid"
"""Name of the state's component that is 1 if vibration was recorded, as in recorded datasets."""

PROGRAM = "haptic_accel"
"""Key of this program's metadata: in ``info.json``, and as JSON text of each episode."""

SERIES = "series"
"""Folder of the signals as recorded."""

CHUNK = "chunk-000/file-000.parquet"
"""First file in a folder of tables; it has all rows."""

CHUNK_FILES, DATA_MEGABYTES, VIDEO_MEGABYTES = 1000, 100, 200
"""LeRobot's defaults for files that are appended."""

ROWS = 1000
"""Number of rows per group in a dataset with images, which may be too large for one group."""

FILE_INDICES = [f"{t}/{p}_index" for t in ("data", "meta/episodes") for p in ("chunk", "file")]
"""Columns of an episode with the numbers of its files."""

INDICES = ("frame_index", "episode_index", "index", "task_index")


@dataclass
class LeRobotWriter(signals.Writer):
    """Writer of a dataset with an episode for each engagement of the arms.

    Parameters
    ----------
    folder : Path
        Empty folder.
    fps : int
        Frames per second.
    rate : float
        Samples per second of the windows; 0 for the recording's rate or lower, see `FrameRate`.
    task : str
        Description of the task; empty for the surface.
    cameras : sequence of str
        Topics of images.
    """

    folder: Path
    fps: int
    rate: float = 0.0
    task: str = ""
    cameras: Sequence[str] = ()
    _axes: Axes | None = None
    _rates: FrameRate | None = None
    _images: dict[str, tuple[int, ...]] = field(default_factory=dict)
    _tasks: dict[str, int] = field(default_factory=dict)
    _episodes: list[dict[str, Any]] = field(default_factory=list)
    _statistics: list[dict[str, Statistics]] = field(default_factory=list)
    _about: dict[str, Any] = field(default_factory=dict)
    _frames: int = 0
    _file: parquet.ParquetWriter | None = None

    def add(self, name: str, bag: Bag) -> None:
        """Append the engagements of a bag as episodes.

        Raises
        ------
        ParameterError
            The bag has no engagement, or its rate or axes differ from earlier bags.
        """
        rates = FrameRate.of(self.fps, self.rate, signals.recorded_rate(bag))
        axes = bag.axes
        if (rates, axes) != (self._rates or rates, self._axes or axes):
            raise ParameterError(
                f"{bag.path}: has {rates.recorded:g} Hz and axes {', '.join(axes.names)}: must be"
                " as the bags before it in one set"
            )
        self._rates, self._axes = rates, axes
        series = self.folder / SERIES / name
        series.mkdir(parents=True)
        (self.folder / "data" / CHUNK).parent.mkdir(parents=True, exist_ok=True)
        write_parquet(bag, series)
        about = signals.descriptions(bag)
        self._about = {name: about[name] for name in ("exported_with", "published", "units")}
        for begin, end, condition in signals.episodes(bag, about.pop("conditions")):
            found = signals.frames_of(bag, begin, end, rates)
            if not len(found.times):
                continue
            images = camera_frames(bag, self.cameras, found.times, self.fps)
            notes = [*found.notes, *(note for each in images for note in each.notes)]
            self.notes.extend(f"{name}: {note}" for note in notes)
            own = {"series": name, "begin_ns": begin, "condition": condition, "notes": notes}
            task = f"feel {condition['surface']} with a tool".replace(UNKNOWN, "a surface")
            self._append(found, images, self.task or task, about | own)

    def _append(
        self, found: Frames, images: Sequence[CameraFrames], task: str, about: dict[str, Any]
    ) -> None:
        """Write an episode as one group of rows, which readers find by its number."""
        count, number = len(found.times), len(self._episodes)
        arrays: dict[str, Any] = {
            STATE_KEY: np.column_stack([found.state, _by_axis(found.tool), found.valid]),
            "action": found.action,
            HANDLE_KEY: _by_axis(found.handle),
            "timestamp": (np.arange(count) / self.fps).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": np.arange(self._frames, self._frames + count),
            "task_index": np.full(count, self._tasks.setdefault(task, len(self._tasks))),
        }
        for each in images:
            if self._images.setdefault(each.key, each.shape) != each.shape:
                raise ParameterError(f"{about['series']}: {each.key}: must have one size in a set")
        step = ROWS if images else count
        for row in range(0, count, step):
            rows = slice(row, row + step)
            table = {key: pa.array(list(array[rows])) for key, array in arrays.items()}
            table |= {each.key: each.column(row, min(count, rows.stop)) for each in images}
            rows_table = pa.table(table)
            self._file = self._file or parquet.ParquetWriter(
                self.folder / "data" / CHUNK, rows_table.schema, compression="snappy"
            )
            self._file.write_table(rows_table, row_group_size=len(rows_table))
        own = {key: statistics(array) for key, array in arrays.items()}
        self._statistics.append(own | {each.key: each.statistics() for each in images})
        self._episodes.append(
            {
                "episode_index": number,
                "tasks": [task],
                "length": count,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + count,
                **dict.fromkeys(FILE_INDICES, 0),
                PROGRAM: json.dumps(about),
                **{
                    f"stats/{key}/{name}": each.tolist()
                    for key, own in self._statistics[-1].items()
                    for name, each in own.items()
                },
            }
        )
        self._frames += count

    def close(self) -> None:
        """Write the metadata of the dataset.

        Raises
        ------
        ParameterError
            No engagement was as long as a frame.
        """
        if self._file is None:
            raise ParameterError(f"fps = {self.fps}: the arms were coupled for less than a frame")
        self._file.close()
        meta = self.folder / "meta"
        (meta / "episodes" / CHUNK).parent.mkdir(parents=True)
        tasks = pd.DataFrame({"task_index": self._tasks.values()})
        tasks.set_index(pd.Index(self._tasks, name="task")).to_parquet(meta / "tasks.parquet")
        parquet.write_table(pa.Table.from_pylist(self._episodes), meta / "episodes" / CHUNK)
        signals.write_json(meta / "stats.json", combined(self._statistics))
        signals.write_json(meta / "info.json", self._info())

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": VERSION,
            "fps": self.fps,
            "features": self._features(),
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK_FILES,
            "data_files_size_in_mb": DATA_MEGABYTES,
            "video_files_size_in_mb": VIDEO_MEGABYTES,
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "robot_type": "haptic_accel",
            "splits": {"train": f"0:{len(self._episodes)}"},
            PROGRAM: self._about,
        }

    def _features(self) -> dict[str, Any]:
        """Return the descriptions of the features, equal in datasets that can be merged."""
        assert self._rates and self._axes
        samples, about = self._axes.sample_names(self._rates.samples), self._rates.description
        state, action = (
            [f"{each.name}.{axis}" for each in moved for axis in ALL_AXES.names]
            for moved in (signals.STATE, signals.ACTION)
        )
        units, window = list(signals.UNITS_OF_STATE), ["m/s^2"] * len(samples)
        named = {
            STATE_KEY: ([*state, *samples, VALID], [*units, *window, ""]),
            "action": (action, units),
            HANDLE_KEY: (samples, window),
        }
        return {
            **{
                key: _feature("float32", names) | {"info": {"units": own, **about(self._axes)}}
                for key, (names, own) in named.items()
            },
            **{
                key: _feature("image", ["height", "width", "channels"]) | {"shape": shape}
                for key, shape in self._images.items()
            },
            "timestamp": _feature("float32"),
            **{name: _feature("int64") for name in INDICES},
        }


def _feature(kind: str, names: list[str] | None = None) -> dict[str, Any]:
    return {"dtype": kind, "shape": [len(names or [""])], "names": names}


def _by_axis(windows: SingleArray) -> SingleArray:
    """Return the samples of windows in the order of `Axes.sample_names`, a row for each frame."""
    return windows.transpose(0, 2, 1).reshape(len(windows), -1)
