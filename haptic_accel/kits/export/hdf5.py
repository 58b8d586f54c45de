# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""HDF5 in ALOHA's layout: a file for each bag, with frames and all samples.

``/observations/qpos`` and ``qvel`` are position and velocity of the slave, ``/action`` the
position of the master, as in tonyzhaozh/aloha, whose readers treat each file as an episode.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from haptic_accel import Bag, ParameterError
from haptic_accel.kits.export.signals import (
    FrameRate,
    Writer,
    descriptions,
    engagements,
    frames_of,
    recorded_rate,
    signals_of,
)


@dataclass
class Hdf5Writer(Writer):
    """Writer of bags as files ``episode_N.hdf5``.

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
    _count: int = 0

    def add(self, name: str, bag: Bag) -> None:
        """Write a bag; without coupled arms, the file has signals but no frames.

        Raises
        ------
        ParameterError
            The rates are not compatible, or a signal of coupled arms is missing.
        """
        with h5py.File(self.folder / f"episode_{self._count}.hdf5", "w") as file:
            file.attrs["bag"] = name
            about = descriptions(bag)
            file["metadata"] = json.dumps(about)
            for exported, signal in signals_of(bag):
                group = file.create_group(f"signals/{exported.name}")
                own = about["signals"][exported.name]
                group.attrs.update({key: v for key, v in own.items() if v is not None})
                group["stamps"], group["values"] = signal.stamps, signal.values
            try:
                periods = engagements(bag)
            except ParameterError:
                self.notes.append(f"{name}: the arms were never coupled: signals and no frames")
            else:
                self._write_frames(file, bag, periods, about)
        self._count += 1

    def _write_frames(self, file: Any, bag: Bag, periods: Sequence[Any], about: Any) -> None:
        """Write frames from the first engagement to the last one's end."""
        rates = FrameRate.of(self.fps, self.rate, recorded_rate(bag))
        found = frames_of(bag, periods[0][0], periods[-1][1], rates)
        self.notes.extend(f"{file.attrs['bag']}: {note}" for note in found.notes)
        file.attrs.update({"sim": about["simulated"]["slave"], "fps": self.fps})
        begins = [each["begin_ns"] for each in about["conditions"]]
        file["condition"] = np.searchsorted(begins, found.times, side="right") - 1
        observations = file.create_group("observations")
        observations["qpos"], observations["qvel"] = found.state[:, :3], found.state[:, 3:]
        file["action"] = found.action[:, :3]
        file["stamps"] = found.times
        engaged = [(begin <= found.times) & (found.times <= end) for begin, end in periods]
        file["engaged"] = np.any(engaged, axis=0)
        for part, windows in (("tool", found.tool), ("handle", found.handle)):
            observations[f"vibration/{part}"] = windows
            about_windows = rates.description(bag.axes) | {"unit": "m/s^2"}
            observations[f"vibration/{part}"].attrs.update(about_windows)
