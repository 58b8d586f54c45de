# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""PortAudio with a card that has the faults of a test, on the machine's clock."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

RATE, BLOCK = 48_000, 64
"""Samples per second, Hz, and samples a block of the card."""


@dataclass
class PortAudio:
    """Stands for the module `sounddevice`.

    Attributes
    ----------
    outputs : int
        Number of the card's outputs.
    host : str
    spoiled : float
        Value of a single sample of both inputs, a hundredth of a second after the start.
    gives, plays : bool
        Whether blocks come and are fetched.
    recordings : list
        What `rec` returns: loss and samples of each recording; None where none ever ends.
    """

    outputs: int = 2
    host: str = "ALSA"
    spoiled: float = 0.25
    gives: bool = True
    plays: bool = True
    recordings: list[Any] = field(default_factory=list)
    PortAudioError = type("PortAudioError", (Exception,), {})

    def query_devices(self, *_: object) -> dict[str, Any]:
        count = {"max_input_channels": 2, "max_output_channels": self.outputs}
        return {"name": "card", "index": 0, "hostapi": 0, "default_samplerate": RATE, **count}

    def query_hostapis(self, _: int) -> dict[str, str]:
        return {"name": self.host}

    def Stream(self, **_: object) -> Stream:
        return Stream(self)

    def rec(self, count: int, *_: object, **given: object) -> np.ndarray:
        self.recording = self.recordings.pop(0)
        return np.array([]) if self.recording is None else self.recording[1]

    def get_stream(self) -> Any:
        return SimpleNamespace(active=self.recording is None)

    def wait(self) -> Any:
        return self.recording[0]

    def _exit_handler(self) -> None: ...


class Stream:
    """Running stream: 0.25 on both inputs."""

    latency = 4 * BLOCK / RATE, 4 * BLOCK / RATE

    def __init__(self, card: PortAudio) -> None:
        self._card, self._began = card, time.monotonic()
        self._taken = self._written = 0

    @property
    def _passed(self) -> int:
        return int((time.monotonic() - self._began) * RATE) // BLOCK * BLOCK

    @property
    def read_available(self) -> int:
        return (self._passed - self._taken) * self._card.gives

    @property
    def write_available(self) -> int:
        return 5 * BLOCK * self._card.plays

    def read(self, count: int) -> tuple[np.ndarray, bool]:
        samples = np.full((count, 2), 0.25, np.float32)
        if 0 <= (at := RATE // 100 - self._taken) < count:
            samples[at] = self._card.spoiled
        self._taken += count
        return samples, False

    def write(self, samples: np.ndarray) -> bool:
        self._written += len(samples)
        return False

    def start(self) -> None: ...

    def close(self) -> None: ...
