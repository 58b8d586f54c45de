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

"""World behind a sound card without hardware: handle, coil, tool and sensors as a client of JACK.

Run as a process: the handle of a rig moves by the force on the card's first output; its
acceleration is on the first input, that of a tool with a known texture on the second. A signal
SIGUSR1 taps both.
"""

from __future__ import annotations

import argparse
import signal as signals
import sys
import time

import jack
import numpy as np
from scipy import signal

from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import handle_model
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.setup import Setup

FULL_SCALE, SCALE = 5.0, 100.0
"""Force of the coil, N, and acceleration of both sensors, m/s^2, at full scale."""

TAP, TAP_TIME = 40.0, 0.005
"""Acceleration of a tap, m/s^2, and its length, s."""

TEXTURE_TIME = 4.0
"""Period of the tool's texture, s."""


def texture(rate: float, strength: float) -> np.ndarray:
    """Return a period of the tool's acceleration, m/s^2."""
    lines = np.fft.rfftfreq(round(TEXTURE_TIME * rate), 1 / rate)
    phases = np.random.default_rng(7).uniform(0, 2 * np.pi, len(lines))
    spectrum = np.where((lines > 25) & (lines < 350), np.exp(1j * phases), 0)
    found = np.fft.irfft(spectrum)
    return np.asarray(strength * found / found.std())


class World:
    """Process callback of JACK."""

    def __init__(self, given: argparse.Namespace) -> None:
        self.client = jack.Client("world")
        rate = self.client.samplerate
        handle = Setup.of(GraphArguments(rig=given.rig)).rig().master.handle
        model = handle_model(Plant(handle).handle)
        self._handle = signal.tf2sos(*signal.bilinear(model.numerator, model.denominator, rate))
        self._state = np.zeros((len(self._handle), 2))
        self._ac = signal.butter(1, given.corner or 1e-3, "high", fs=rate, output="sos")
        self._ac_states = np.zeros((2, len(self._ac), 2))
        self._noise = given.noise * np.random.default_rng(1).normal(size=(2, 10 * rate))
        self._texture = texture(rate, given.texture)
        self._force = self.client.inports.register("force")
        self._sensors = [self.client.outports.register(name) for name in ("handle", "tool")]
        self._polarity = given.polarity
        self._now = self._tapped = 0
        signals.signal(signals.SIGUSR1, lambda *_: self._tap(round(TAP_TIME * rate)))
        self.client.set_process_callback(self._process)

    def _tap(self, frames: int) -> None:
        self._tapped = frames

    def _process(self, frames: int) -> None:
        force = FULL_SCALE * self._force.get_array()
        moved, self._state = signal.sosfilt(self._handle, force, zi=self._state)
        at = np.arange(self._now, self._now + frames)
        tap = TAP if self._tapped > 0 else 0.0
        self._tapped -= frames
        self._now += frames
        for number, acceleration in enumerate((moved, self._texture[at % len(self._texture)])):
            measured = tap + acceleration + self._noise[number, at % self._noise.shape[1]]
            passed, self._ac_states[number] = signal.sosfilt(
                self._ac, measured, zi=self._ac_states[number]
            )
            polarity = 1.0 if number else self._polarity
            self._sensors[number].get_array()[:] = polarity * passed / SCALE

    def connect(self) -> None:
        """Connect to what PortAudio has opened; it numbers its ports on and on."""
        outs, ins = (
            [
                port
                for port in self.client.get_ports(is_audio=True, **{way: True})
                if port.name.startswith("PortAudio")
            ]
            for way in ("is_output", "is_input")
        )
        pairs = [*zip(outs, [self._force], strict=False), *zip(self._sensors, ins, strict=False)]
        for source, target in pairs:
            try:
                if target not in self.client.get_all_connections(source):
                    self.client.connect(source, target)
            except jack.JackError:  # closed meanwhile
                continue


def main() -> None:
    """Run until ended."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rig", default="ideal")
    for name, value in (("corner", 10.0), ("noise", 0.05), ("texture", 2.0), ("polarity", 1.0)):
        parser.add_argument(f"--{name}", type=float, default=value)
    sys.setswitchinterval(1e-4)  # the callback must not wait for this thread
    world = World(parser.parse_args())
    with world.client:
        print("ready", flush=True)
        while True:
            world.connect()
            time.sleep(0.1)


if __name__ == "__main__":
    main()
