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
"""PulseAudio with outputs that have no hardware, whose sound is recorded."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

RATE = 48000
"""Samples per second of all outputs, Hz."""

CONFIGURATION = f"""
default-sample-rate = {RATE}
default-sample-channels = 4
default-channel-map = front-left,front-right,rear-left,rear-right
"""
"""Chromium gives every output of PulseAudio the default number of channels."""

SPEAKERS, CONTROLLER = "speakers", "controller"
"""Names of outputs with two and four channels; the first is the default."""

CHANNELS = {
    SPEAKERS: "front-left,front-right",
    CONTROLLER: "front-left,front-right,rear-left,rear-right",
}
"""Channels of each output: another order in a recording would mix them."""


class SoundServer:
    """Sound server with two outputs, without hardware.

    Parameters
    ----------
    folder : Path
        Home of the server and of its clients.

    Attributes
    ----------
    environment : dict
        Environment of its clients.
    """

    def __init__(self, folder: Path) -> None:
        address = f"unix:{folder}/native"
        self.environment = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
        self.environment |= {"PULSE_SERVER": address, "PULSE_RUNTIME_PATH": str(folder)}
        settings = folder / ".config" / "pulse"
        settings.mkdir(parents=True)
        (settings / "daemon.conf").write_text(CONFIGURATION)
        modules = [
            f"module-native-protocol-unix socket={folder}/native auth-anonymous=1",
            "module-null-source source_name=microphone",
            *(
                f"module-null-sink sink_name={name} channel_map={channels} rate={RATE}"
                f" sink_properties=device.description={name}"
                for name, channels in CHANNELS.items()
            ),
        ]
        loaded = [word for module in modules for word in ("-L", module)]
        own = ["--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no"]
        self._process = subprocess.Popen(
            ["pulseaudio", "-n", *own, *loaded],
            env=self.environment,
            stderr=subprocess.DEVNULL,
        )
        while not self.ask("info"):
            assert self._process.poll() is None, "pulseaudio has ended"
            time.sleep(0.05)

    def ask(self, *words: str) -> str:
        """Return what ``pactl`` answers; empty while there is no server."""
        asked = ["pactl", *words]
        return subprocess.run(asked, env=self.environment, capture_output=True, text=True).stdout

    @contextmanager
    def recording(self, output: str) -> Iterator[Recording]:
        """Record what an output plays, from now on."""
        with tempfile.TemporaryFile() as file:
            channels = CHANNELS[output]
            count = channels.count(",") + 1
            form = [f"--channels={count}", f"--channel-map={channels}", f"--rate={RATE}"]
            given = ["--raw", "--format=float32le", "--latency-msec=10", "-d", f"{output}.monitor"]
            command = ["parec", *given, *form]
            with subprocess.Popen(command, env=self.environment, stdout=file) as process:
                try:
                    yield Recording(file.fileno(), count)
                finally:
                    process.terminate()

    def unplug(self, output: str) -> None:
        """Take an output away."""
        lines = self.ask("list", "short", "modules").splitlines()
        number = next(line.split()[0] for line in lines if f"sink_name={output} " in line)
        self.ask("unload-module", number)

    def close(self) -> None:
        """End the server."""
        self._process.terminate()
        self._process.wait()


class Recording:
    """Sound that an output plays."""

    def __init__(self, file: int, channels: int) -> None:
        self._file, self._channels = file, channels

    def last(self, seconds: float) -> np.ndarray:
        """Return the last samples so far, shape (n, channels), full scale 1."""
        frame = 4 * self._channels
        whole = os.fstat(self._file).st_size // frame
        count = min(whole, round(seconds * RATE))
        data = os.pread(self._file, count * frame, (whole - count) * frame)
        return np.frombuffer(data, "<f4").reshape(-1, self._channels)


@contextmanager
def sound_server(folder: Path) -> Iterator[SoundServer]:
    """Run a sound server; skip the test where there is no PulseAudio."""
    for program in ("pulseaudio", "pactl", "parec"):
        if not shutil.which(program):
            pytest.skip(f"no {program}: apt-get install pulseaudio pulseaudio-utils")
    server = SoundServer(folder)
    try:
        yield server
    finally:
        server.close()
