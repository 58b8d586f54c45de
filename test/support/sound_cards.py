# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sound cards for tests: ALSA's file plug-in over its null plug-in, and JACK without hardware."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from sound_world import numbers

from running import realtime_is_allowed

NAME = "coil"
"""Name of the card."""

QUAD = "quad"
"""Name of a card with exactly four channels."""

RATE = 44100.0
"""Samples per second that PortAudio takes by default, Hz."""

CONFIGURATION = """
pcm.coil {{ type file  slave.pcm "null"  file "{0}/coil.raw"  format "raw" }}
pcm.stereo {{
    type multi  slaves.a {{ pcm "null"  channels 2 }}
    bindings {{ 0 {{ slave a  channel 0 }}  1 {{ slave a  channel 1 }} }}
}}
pcm.quad {{
    type multi
    slaves {{
        a {{ pcm "quad_1"  channels 1 }}  b {{ pcm "quad_2"  channels 1 }}
        c {{ pcm "quad_3"  channels 1 }}  d {{ pcm "quad_4"  channels 1 }}
    }}
    bindings {{
        0 {{ slave a  channel 0 }}  1 {{ slave b  channel 0 }}
        2 {{ slave c  channel 0 }}  3 {{ slave d  channel 0 }}
    }}
}}
pcm.quad_1 {{ type file  slave.pcm "null"  file "{0}/quad_1.raw"  format "raw" }}
pcm.quad_2 {{ type file  slave.pcm "null"  file "{0}/quad_2.raw"  format "raw" }}
pcm.quad_3 {{ type file  slave.pcm "null"  file "{0}/quad_3.raw"  format "raw" }}
pcm.quad_4 {{ type file  slave.pcm "null"  file "{0}/quad_4.raw"  format "raw" }}
pcm.null {{ type null }}
pcm.default {{ type null }}
"""


@contextmanager
def sound_card(folder: Path) -> Iterator[None]:
    """Provide a sound card that writes its samples to a folder, or skip the test."""
    try:
        import sounddevice
    except (ImportError, OSError) as missing:
        pytest.skip(f"no sound card can be opened: {missing}")
    (folder / "asound.conf").write_text(CONFIGURATION.format(folder))
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("ALSA_CONFIG_PATH", str(folder / "asound.conf"))
        sounddevice._terminate()
        sounddevice._initialize()
        yield
    sounddevice._terminate()
    sounddevice._initialize()


def received(folder: Path, channels: int = 2) -> np.ndarray:
    """Return the samples of the closed card, shape (n, channels), full scale 1."""
    return np.fromfile(folder / "coil.raw", dtype="<f4").reshape(-1, channels)


JACK_NAME = "system"
"""Name that PortAudio has for JACK's card."""


@contextmanager
def jack_card(outputs: int = 4) -> Iterator[dict[str, str]]:
    """Run JACK without hardware; yield the environment of its programs, or skip without JACK."""
    if not shutil.which("jackd"):
        pytest.skip("no jackd: apt-get install jackd2")
    name = f"test_{os.getpid()}"
    urgency = ["-R", "-P", "60"] if realtime_is_allowed() else ["-r"]
    # On a busy machine blocks of 64 samples, 1.3 ms, are lost several times as often as of 128.
    driver = ["-d", "dummy", "-P", str(outputs), "-p", "128"]
    command = ["jackd", *urgency, "-n", name, *driver]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as server:
        assert server.stdout
        try:
            subprocess.run(["jack_wait", "-s", name, "-w", "-t", "20"], check=True)
            yield {**os.environ, "JACK_DEFAULT_SERVER": name, "JACK_NO_START_SERVER": "1"}
        finally:
            server.terminate()
            server.stdout.read()


SOUND_RIG = """
master_device:
  ros__parameters:
    device: none
    actuator_device: audio
    accelerometer_device: audio
    audio: {device: system, block: 128, inputs: "1", scales: "100", ac_corner: 10.0, full_scale: 5}
slave_device:
  ros__parameters:
    device: none
    accelerometer_device: audio
    audio: {device: system, block: 128, inputs: "2", scales: "100", ac_corner: 10.0}
"""
"""Parameters of a graph before `sound_world`: sensors on inputs 1 and 2, coil on output 1."""


@contextmanager
def sound_world(
    folder: Path, polarity: float = 1.0
) -> Iterator[tuple[dict[str, str], subprocess.Popen[str]]]:
    """Run a handle and a tool behind JACK's card; yield the environment, and the world.

    Parameters
    ----------
    folder : Path
        For the compiled world.
    polarity : float
        1, or -1 for a handle's sensor with swapped wires.
    """
    source, program = Path(__file__).with_name("sound_world.c"), folder / "sound_world"
    if not shutil.which("cc"):
        pytest.skip("no cc: apt-get install gcc")
    command = ["cc", "-O2", "-o", str(program), str(source), "-l:libjack.so.0"]
    with jack_card(outputs=2) as environment:
        subprocess.run(command, check=True)
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        with subprocess.Popen(program, env=environment, **pipes) as world:
            assert world.stdin
            assert world.stdout
            try:
                world.stdin.write(numbers(polarity))
                world.stdin.close()
                assert world.stdout.readline() == "ready\n"
                yield environment, world
            finally:
                world.terminate()


def received_of_four(folder: Path) -> np.ndarray:
    """Return the samples of the closed card with four channels, shape (n, 4), full scale 1."""
    files = [folder / f"quad_{number}.raw" for number in (1, 2, 3, 4)]
    return np.stack([np.fromfile(file, dtype="<f4") for file in files], axis=1)
