# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""PulseAudio with outputs that have no hardware, whose sound is recorded."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

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

FRONT = "front-left,front-right"
CHANNELS = {SPEAKERS: FRONT, CONTROLLER: f"{FRONT},rear-left,rear-right"}
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
        words = ["pulseaudio", "-n", *own, *loaded]
        self._process = subprocess.Popen(words, env=self.environment, stderr=subprocess.DEVNULL)
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
        channels = CHANNELS[output]
        count = channels.count(",") + 1
        form = [f"--channels={count}", f"--channel-map={channels}", f"--rate={RATE}"]
        given = ["--raw", "--format=float32le", "--latency-msec=5", "-d", f"{output}.monitor"]
        command = ["parec", *given, *form]
        with subprocess.Popen(command, env=self.environment, stdout=subprocess.PIPE) as process:
            assert process.stdout
            recording = Recording(process.stdout, count)
            try:
                yield recording
            finally:
                process.terminate()
                recording.join()

    def close(self) -> None:
        """End the server."""
        self._process.terminate()
        self._process.wait()


class Recording(threading.Thread):
    """Sound that an output plays, as it comes.

    Parameters
    ----------
    stream : file
        Samples of all channels in turn, float32.
    channels : int
    """

    def __init__(self, stream: IO[bytes], channels: int) -> None:
        super().__init__()
        self._stream, self._channels = stream, channels
        self._samples = np.zeros((0, channels), "<f4")
        self._newest = time.time()
        self.start()

    def run(self) -> None:
        """Read until the end."""
        frame = 4 * self._channels
        rest = b""
        while data := os.read(self._stream.fileno(), 2**16):
            rest += data
            whole = len(rest) // frame * frame
            samples = np.frombuffer(rest[:whole], "<f4").reshape(-1, self._channels)
            rest = rest[whole:]
            self._samples = np.concatenate((self._samples, samples))
            self._newest = time.time()

    def forget(self) -> None:
        """Drop what came so far."""
        self._samples = self._samples[:0]

    def last(self, seconds: float) -> np.ndarray:
        """Return the last samples so far, shape (n, channels), full scale 1."""
        return self._samples[-round(seconds * RATE) :]

    def begin(self, channel: int, level: float) -> float | None:
        """Return the time at which a channel, from 0, first had a level, s; None if never."""
        samples, newest = self._samples, self._newest
        loud = np.flatnonzero(np.abs(samples[:, channel]) > level)
        return newest - (len(samples) - loud[0]) / RATE if len(loud) else None


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
