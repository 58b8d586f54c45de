# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Binary frames sent to a page: samples and plots, little-endian.

A frame of samples: kind, number of the axis, number of samples of each trace (uint32 each), age of
the newest sample in s at creation of the frame (float32; negative if stamped in the future),
steady time of creation in s (float64), origin in s since 1970 (float64), then for each trace the
times after the origin in s and the values (float32 each). A frame of plots: kind, number of points
of the spectra, number of points of the cloud (uint32 each), then frequency, desired and actual of
the spectra, desired and actual of the cloud (float32 each). A frame of positions: kind (uint32),
then x and z of each of `VECTORS` (float32, NaN for unknown).
"""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Iterable, Mapping

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.model import Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.scope.windows import LONGEST_WINDOW, Metrics, Ring, Windows

SAMPLES, PLOTS, PLACED = 1, 2, 3
"""Kinds of frames."""

ALWAYS = ("desired", "actual", "force", "travel")
"""Signals that every page receives: m/s^2, m/s^2, N, m."""

CHOSEN = ("arm_force", "position")
"""Signals that a page receives on request, N and m; each adds a subscriber to the nodes."""

TRACES = (*ALWAYS, *CHOSEN)
"""Signals of a frame of samples, in this order."""

SCENE = "scene"
"""Name by which a page requests the frames of positions (`VECTORS`)."""

SOUND = "sound"
"""Name by which a page that plays sound requests a higher frame rate."""

AXES = {f"axis_{name}": name for name in NAMES}
"""Names by which a page requests the signals along an axis; default: the actuator's axis."""

ON_DEMAND = (*CHOSEN, SCENE, SOUND, *AXES)
"""Requests that a page may make."""

VECTORS = ("tool", "tool_velocity", "handle", "contact_force")
"""Vectors of a frame of positions: m, m/s, m, N; the tool's in the slave's base frame."""

EVERYTHING = frozenset((*TRACES, *ON_DEMAND, *VECTORS))
"""Signals, requests and positions of a page without restrictions."""

_SAMPLES_HEADER = struct.Struct("<8Ifdd")
_PLOTS_HEADER = struct.Struct("<3I")

_LARGEST = float(np.finfo(np.float32).max)


class Cursor:
    """Position up to which one page has received the traces.

    Parameters
    ----------
    windows : Windows
        Signals to send.
    admitted : frozenset of str
        Part of `EVERYTHING` that the page may receive.

    Attributes
    ----------
    shown : frozenset of str
        Signals that the page receives.
    axis : str
        Axis of the signals, if the rig has it.
    """

    def __init__(self, windows: Windows, admitted: frozenset[str] = EVERYTHING) -> None:
        self._windows = windows
        self._admitted = admitted
        self._sent = dict.fromkeys(TRACES, 0)
        self.shown = self._admitted.intersection(ALWAYS)
        self.axis = windows.axis
        self._sending = windows
        self._placed = b""

    @property
    def windows(self) -> Windows:
        """Signals along the axis that the page shows."""
        return self._windows.by_axis.get(self.axis, self._windows)

    def choose(self, names: Iterable[str]) -> None:
        """Select the signals of `ON_DEMAND` to send, from their next sample on."""
        self.shown = self._admitted.intersection((*ALWAYS, *names))
        self.axis = next((AXES[name] for name in AXES if name in self.shown), self._windows.axis)
        self._placed = b""

    def vectors(self) -> bytes | None:
        """Return the frame of the latest positions; None if not shown, or unchanged since then."""
        vectors = self._windows.vectors.items()
        admitted = {name: vector for name, vector in vectors if name in self._admitted}
        before, self._placed = self._placed, vectors_frame(admitted)
        return self._placed if SCENE in self.shown and self._placed != before else None

    def frame(self) -> bytes | None:
        """Return samples since the last frame, at most the longest window; None if empty.

        After a change of the axis, all samples of the longest window are returned.
        """
        before, self._sending = self._sending, self.windows
        if self._sending is not before:
            self._sent = dict.fromkeys(TRACES, 0)
        self._sending.advance()
        parts = []
        for name in TRACES:
            ring: Ring = getattr(self._sending, name)
            sent = self._sent[name] if name in self.shown else ring.count
            self._sent[name], stamps, values = ring.since(sent)
            recent = stamps >= ring.newest - int(LONGEST_WINDOW * NANOSECONDS)
            parts.append((stamps[recent], values[recent]))
        if not any(len(stamps) for stamps, _ in parts):
            return None
        origin = min(int(stamps[0]) for stamps, _ in parts if len(stamps))
        newest = max(int(stamps[-1]) for stamps, _ in parts if len(stamps))
        header = _SAMPLES_HEADER.pack(
            SAMPLES,
            NAMES.index(self._sending.axis),
            *(len(stamps) for stamps, _ in parts),
            (time.time_ns() - newest) / NANOSECONDS,
            time.monotonic(),
            origin / NANOSECONDS,
        )
        blocks = [
            _float32(block)
            for stamps, values in parts
            for block in ((stamps - origin) / NANOSECONDS, values)
        ]
        return b"".join([header, *blocks])


def plots_frame(metrics: Metrics) -> bytes:
    """Return spectra and cloud as bytes."""
    found = metrics.spectra
    lines = (found.frequency, found.desired, found.actual) if found else ()
    header = _PLOTS_HEADER.pack(PLOTS, len(lines[0]) if lines else 0, len(metrics.desired))
    return b"".join([header, *map(_float32, (*lines, metrics.desired, metrics.actual))])


def vectors_frame(vectors: Mapping[str, Vector]) -> bytes:
    """Return the latest vectors of `VECTORS` as bytes."""
    found = [vectors.get(name, (math.nan,) * 3) for name in VECTORS]
    return struct.pack("<I", PLACED) + _float32(np.array([(x, z) for x, _, z in found]))


def _float32(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> bytes:
    """Return values as bytes, limited to the range of float32."""
    return np.clip(values, -_LARGEST, _LARGEST).astype("<f4").tobytes()
