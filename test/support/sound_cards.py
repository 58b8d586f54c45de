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

"""Sound card for tests: ALSA's file plug-in over its null plug-in."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

NAME = "coil"
"""Name of the card."""

RATE = 44100.0
"""Samples per second that PortAudio takes by default, Hz."""

CONFIGURATION = """
pcm.coil {{ type file  slave.pcm "null"  file "{0}/coil.raw"  format "raw" }}
pcm.stereo {{
    type multi  slaves.a {{ pcm "null"  channels 2 }}
    bindings {{ 0 {{ slave a  channel 0 }}  1 {{ slave a  channel 1 }} }}
}}
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
