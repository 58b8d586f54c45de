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

"""HDF5 in ALOHA's layout: a file for each bag, with every sample beside its frames.

``/observations/qpos`` and ``qvel`` are position and velocity of the slave, ``/action`` the
position of the master, as in tonyzhaozh/aloha, whose readers take a file for an episode.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from haptic_accel.bags.reading import Bag, Signal
from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.export.frames import FrameRate, engagements, frames_of, recorded_rate
from haptic_accel.kits.export.signals import PART, description, signals_of


@dataclass
class Hdf5Writer:
    """Files ``episode_N.hdf5`` of bags.

    Parameters
    ----------
    folder : Path
    fps : int
        Frames per second.
    rate : float
        As for `FrameRate`.
    """

    folder: Path
    fps: int
    rate: float = 0.0
    notes: list[str] = field(default_factory=list)
    _count: int = 0

    def add(self, name: str, bag: Bag) -> None:
        """Write a bag; without coupled arms it has signals and no frames.

        Raises
        ------
        ParameterError
            The rates do not fit, or a signal of coupled arms is missing.
        """
        with h5py.File(self.folder / f"episode_{self._count}.hdf5", "w") as file:
            file.attrs["bag"] = name
            for exported, signal in signals_of(bag):
                group = file.create_group(f"signals/{exported.name}")
                about = description(bag, exported)
                group.attrs.update({key: v for key, v in about.items() if v is not None})
                _copy(group, signal)
            try:
                periods = engagements(bag)
            except ParameterError:
                self.notes.append(f"{name}: the arms were never coupled: signals and no frames")
            else:
                self._write_frames(file, bag, periods)
        self._count += 1

    def _write_frames(self, file: Any, bag: Bag, periods: list[tuple[int, int]]) -> None:
        """Write frames from the first engagement to the last one's end."""
        rates = FrameRate.of(self.fps, self.rate, recorded_rate(bag))
        found = frames_of(bag, periods[0][0], periods[-1][1], rates, bag.axes)
        self.notes.extend(f"{file.attrs['bag']}: {note}" for note in found.notes)
        is_simulated = bag.arguments.get("slave") == "simulated"
        file.attrs.update({"sim": is_simulated, "fps": self.fps})
        observations = file.create_group("observations")
        observations["qpos"], observations["qvel"] = found.state[:, :3], found.state[:, 3:]
        file["action"] = found.action[:, :3]
        file["stamps"] = found.times
        file["engaged"] = np.any(
            [(begin <= found.times) & (found.times <= end) for begin, end in periods], axis=0
        )
        for part, windows in (("tool", found.tool), ("handle", found.handle)):
            observations[f"vibration/{part}"] = windows
            observations[f"vibration/{part}"].attrs.update(
                {
                    "unit": "m/s^2",
                    "axes": list(bag.axes.names),
                    "rate_hz": rates.rate,
                    "resampling_delay_s": 0.0,
                    "resampling_look_ahead_s": rates.look_ahead,
                }
            )

    def close(self) -> None:
        """Do nothing more."""


def _copy(group: Any, signal: Signal) -> None:
    for name, array in (("stamps", signal.stamps), ("values", signal.values)):
        whole = group.create_dataset(name, array.shape, array.dtype)
        for begin in range(0, len(array), PART):
            whole[begin : begin + PART] = array[begin : begin + PART]
