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

"""LeRobotDataset v3.0 with the vibration of tool and handle, which LeRobot opens as it is.

Layout, features and statistics after LeRobot 0.6 (huggingface/lerobot, ``src/lerobot/datasets``).
Its schema has no place for channels faster than the frames; `VIBRATION` is this package's, until
there is a common one. Beside the set are all signals as recorded, in ``series``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from haptic_accel.bags.reading import Bag
from haptic_accel.core.axes import Axes
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.export.frames import (
    ACTION,
    STATE,
    FrameRate,
    Frames,
    engagements,
    frames_of,
    recorded_rate,
)
from haptic_accel.kits.export.images import CameraFrames, camera_frames
from haptic_accel.kits.export.signals import write_json
from haptic_accel.kits.export.statistics import Statistics, combined, statistics
from haptic_accel.kits.export.tables import write_parquet

VERSION = "v3.0"
"""Version of LeRobot's format."""

VIBRATION = "observation.vibration"
"""Beginning of the names of the features with windows."""

SERIES = "series"
"""Folder of the signals as recorded."""

CHUNK = "chunk-000/file-000.parquet"
"""First file below a folder of tables; all rows are in it."""

CHUNK_FILES, DATA_MEGABYTES, VIDEO_MEGABYTES = 1000, 100, 200
"""LeRobot's defaults for files that are appended."""

ROWS = 1000
"""Rows of a group in a set with images, which would not fit into memory as one group."""

INDICES = ("frame_index", "episode_index", "index", "task_index")


@dataclass
class LeRobotWriter:
    """Set of episodes, one for each engagement of the arms.

    Parameters
    ----------
    folder : Path
        Empty folder.
    fps : int
        Frames per second.
    rate : float
        Samples per second of the windows; 0 for that of the recording or below, see `FrameRate`.
    task : str
        What is done, in words; empty for the surface.
    cameras : sequence of str
        Topics of images.
    """

    folder: Path
    fps: int
    rate: float = 0.0
    task: str = ""
    cameras: Sequence[str] = ()
    notes: list[str] = field(default_factory=list)
    _axes: Axes | None = None
    _rates: FrameRate | None = None
    _images: dict[str, tuple[int, ...]] = field(default_factory=dict)
    _tasks: list[str] = field(default_factory=list)
    _episodes: list[dict[str, Any]] = field(default_factory=list)
    _statistics: list[dict[str, Statistics]] = field(default_factory=list)
    _frames: int = 0
    _file: parquet.ParquetWriter | None = None

    def add(self, name: str, bag: Bag) -> None:
        """Append the engagements of a bag.

        Raises
        ------
        ParameterError
            The bag has no engagement, or another rate or axes than the bags before.
        """
        self._agree(bag)
        assert self._rates and self._axes
        series = self.folder / SERIES / name
        series.mkdir(parents=True)
        write_parquet(bag, series)
        for begin, end in engagements(bag):
            found = frames_of(bag, begin, end, self._rates, self._axes)
            if not len(found.times):
                continue
            self.notes.extend(f"{name}: {note}" for note in found.notes)
            images = camera_frames(bag, self.cameras, found.times, self.fps)
            self.notes.extend(f"{name}: {note}" for each in images for note in each.notes)
            self._append(name, begin, found, images, self._task_index(bag))

    def _agree(self, bag: Bag) -> None:
        rates, axes = FrameRate.of(self.fps, self.rate, recorded_rate(bag)), bag.axes
        if (rates, axes) != (self._rates or rates, self._axes or axes):
            raise ParameterError(
                f"{bag.path}: has {rates.recorded:g} Hz and axes {', '.join(axes.names)}: must be"
                " as the bags before it in one set"
            )
        self._rates, self._axes = rates, axes

    def _task_index(self, bag: Bag) -> int:
        surface = bag.arguments.get("surface") or "a surface"
        task = self.task or f"feel {surface} with a tool"
        if task not in self._tasks:
            self._tasks.append(task)
        return self._tasks.index(task)

    def _append(
        self,
        name: str,
        begin: int,
        frames: Frames,
        images: Sequence[CameraFrames],
        task: int,
    ) -> None:
        """Write an episode as one group of rows, which readers find by its number."""
        count, number = len(frames.times), len(self._episodes)
        arrays: dict[str, Any] = {
            "observation.state": frames.state,
            "action": frames.action,
            f"{VIBRATION}.tool": frames.tool,
            f"{VIBRATION}.handle": frames.handle,
            "timestamp": (np.arange(count) / self.fps).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": np.arange(self._frames, self._frames + count),
            "task_index": np.full(count, task),
        }
        for each in images:
            if self._images.setdefault(each.key, each.shape) != each.shape:
                raise ParameterError(f"{name}: {each.key}: must have one size in a set")
        for row in range(0, count, ROWS if images else count):
            rows = slice(row, row + (ROWS if images else count))
            table = {key: _column(array[rows]) for key, array in arrays.items()}
            table |= {each.key: each.column(row, min(count, rows.stop)) for each in images}
            self._write(pa.table(table))
        found = {key: statistics(array) for key, array in arrays.items()}
        self._statistics.append(found | {each.key: each.statistics() for each in images})
        self._episodes.append(
            {
                "episode_index": number,
                "tasks": [self._tasks[task]],
                "length": count,
                "data/chunk_index": 0,
                "data/file_index": 0,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                f"{SERIES}/folder": f"{SERIES}/{name}",
                f"{SERIES}/begin_ns": begin,
            }
        )
        self._frames += count

    def _write(self, table: pa.Table) -> None:
        if self._file is None:
            path = self.folder / "data" / CHUNK
            path.parent.mkdir(parents=True)
            self._file = parquet.ParquetWriter(path, table.schema, compression="snappy")
        self._file.write_table(table, row_group_size=len(table))

    def close(self) -> None:
        """Write what describes the set.

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
        tasks = pd.DataFrame({"task_index": range(len(self._tasks))})
        tasks.set_index(pd.Index(self._tasks, name="task")).to_parquet(meta / "tasks.parquet")
        rows = [
            episode
            | {
                f"stats/{key}/{name}": each.tolist()
                for key, own in found.items()
                for name, each in own.items()
            }
            for episode, found in zip(self._episodes, self._statistics, strict=True)
        ]
        parquet.write_table(pa.Table.from_pylist(rows), meta / "episodes" / CHUNK)
        write_json(meta / "stats.json", combined(self._statistics))
        write_json(meta / "info.json", self._info())

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
        }

    def _features(self) -> dict[str, Any]:
        features = {
            key: _feature("float32", [6], [f"{s.name}.{axis}" for s in signals for axis in "xyz"])
            for key, signals in (("observation.state", STATE), ("action", ACTION))
        }
        features |= {f"{VIBRATION}.{part}": self._window(part) for part in ("tool", "handle")}
        for key, shape in self._images.items():
            features[key] = _feature("image", list(shape), ["height", "width", "channels"])
        features["timestamp"] = _feature("float32", [1], None)
        return features | {name: _feature("int64", [1], None) for name in INDICES}

    def _window(self, part: str) -> dict[str, Any]:
        """Return the description of the windows of tool or handle: this package's schema."""
        assert self._rates and self._axes
        rates, axes = self._rates, self._axes.names
        shape = [rates.samples, len(axes)]
        names = [f"sample at {rates.rate:g} Hz, delay 0 s", f"{', '.join(axes)} (m/s^2)"]
        return _feature("float32", shape, names) | {
            "info": {
                "signal": f"{part}_acceleration",
                "unit": "m/s^2",
                "axes": list(axes),
                "rate_hz": rates.rate,
                "recorded_rate_hz": rates.recorded,
                "resampling_delay_s": 0.0,
                "resampling_look_ahead_s": rates.look_ahead,
                "window": "from the frame before until this one",
                "notes": self.notes,
            }
        }


def _feature(kind: str, shape: list[int], names: list[str] | None) -> dict[str, Any]:
    return {"dtype": kind, "shape": shape, "names": names}


def _column(array: FloatArray) -> pa.Array:
    """Return an array as a column whose cells are numbers, lists, or lists of lists."""
    column = pa.array(array.ravel())
    for size in reversed(array.shape[1:]):
        column = pa.ListArray.from_arrays(
            np.arange(0, len(column) + 1, size, dtype=np.int32), column
        )
    return column
