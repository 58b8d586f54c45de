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
Its schema has no place for channels faster than the frames: the tool's samples are numbers of the
state, as in sets that LeRobot records itself. Beside the set are all signals as recorded, in
``series``. What differs between bags is in a column of the episodes, which a merge keeps.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from pyarrow import parquet

from haptic_accel.analysis.description import UNKNOWN
from haptic_accel.bags.reading import Bag
from haptic_accel.core.axes import NAMES, VIBRATION, Axes
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.export import frames
from haptic_accel.kits.export.frames import FrameRate, Frames, SingleArray
from haptic_accel.kits.export.images import (
    CameraFrames,
    Statistics,
    camera_frames,
    combined,
    statistics,
)
from haptic_accel.kits.export.signals import UNITS_OF_STATE, Writer, descriptions, write_json
from haptic_accel.kits.export.tables import write_parquet

VERSION = "v3.0"
"""Version of LeRobot's format."""

STATE_KEY, HANDLE_KEY = "observation.state", f"handle.{VIBRATION}"
"""Features with the vibration of tool and handle; the handle's is none that a policy observes."""

VALID = f"{VIBRATION}.valid"
"""Name of the number of a state that is 1 if vibration was recorded, as in recorded sets."""

PROGRAM = "haptic_accel"
"""Key of this program's metadata: in ``info.json``, and as JSON text of each episode."""

SERIES = "series"
"""Folder of the signals as recorded."""

CHUNK = "chunk-000/file-000.parquet"
"""First file below a folder of tables; all rows are in it."""

CHUNK_FILES, DATA_MEGABYTES, VIDEO_MEGABYTES = 1000, 100, 200
"""LeRobot's defaults for files that are appended."""

ROWS = 1000
"""Rows of a group in a set with images, which would not fit into memory as one group."""

FILE_INDICES = [f"{t}/{p}_index" for t in ("data", "meta/episodes") for p in ("chunk", "file")]
"""Columns of an episode with the numbers of its files."""

INDICES = ("frame_index", "episode_index", "index", "task_index")


@dataclass
class LeRobotWriter(Writer):
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
        """Append the engagements of a bag.

        Raises
        ------
        ParameterError
            The bag has no engagement, or another rate or axes than the bags before.
        """
        rates, axes = FrameRate.of(self.fps, self.rate, frames.recorded_rate(bag)), bag.axes
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
        about = descriptions(bag)
        self._about = {name: about[name] for name in ("exported_with", "published", "units")}
        for begin, end, condition in frames.episodes(bag, about.pop("conditions")):
            found = frames.frames_of(bag, begin, end, rates)
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
        tasks = pd.DataFrame({"task_index": self._tasks.values()})
        tasks.set_index(pd.Index(self._tasks, name="task")).to_parquet(meta / "tasks.parquet")
        parquet.write_table(pa.Table.from_pylist(self._episodes), meta / "episodes" / CHUNK)
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
            PROGRAM: self._about,
        }

    def _features(self) -> dict[str, Any]:
        """Return the descriptions of the features, which are equal in sets that can be merged."""
        assert self._rates and self._axes
        samples, about = self._axes.sample_names(self._rates.samples), self._rates.description
        state, action = (
            [f"{each.name}.{axis}" for each in signals for axis in NAMES]
            for signals in (frames.STATE, frames.ACTION)
        )
        units, window = list(UNITS_OF_STATE), ["m/s^2"] * len(samples)
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
