# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Contents of a page: state of a graph, and binary frames of samples and plots, little-endian.

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
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import POSTURES, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick.device_side import LONGEST
from haptic_accel.core.tick.rigs import HAND_REACH
from haptic_accel.materials.folders import config_folder
from haptic_accel.materials.scenes import read_scene
from haptic_accel.scope.windows import LONGEST_WINDOW, GraphSettings, Metrics, Ring, Windows
from haptic_accel.setup.arguments import SCENE as SCENE_FILE
from haptic_accel.setup.arguments import SIMULATED, VIRTUAL
from haptic_accel.setup.files import POSTURE, SURFACE

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


EXPECTED = ("master_device", "slave_device", "coupler", "compensator", "recorder")
"""Nodes that are shown even if they have sent no diagnostics."""

NETWORK = (
    "delay {one-way delay (ms)} ms, loss {packet loss (%)} %, clock {clock offset (ms)} ms,"
    " energy {energy tank (mJ)} mJ"
)
"""Status line of a node with a peer host, filled with the node's reported values."""

SILENCE = 2.5
"""Time without diagnostics after which a node counts as silent, s: two missing reports, as nodes
send a report per second."""

MOST_NODES = 64
"""Maximum number of nodes shown: many more than a graph has, and few enough for a page."""

MOST_VALUES = 200
"""Maximum number of values per report: twice as many as any node sends."""

LONGEST_TEXT = 300
"""Maximum length of a shown message, name or value, characters; the rest is cut."""

LEVELS = {0: "OK", 1: "warning", 2: "error"}
"""State by diagnostic level; any other level counts as silent."""


def expected_nodes(side: str) -> list[str]:
    """Return the nodes expected on a host with the arm of `side`; empty for both arms."""
    of_peer = {"": (), "master": ("slave_device",), "slave": ("master_device", "compensator")}
    return [name for name in EXPECTED if name not in of_peer[side]]


@dataclass(frozen=True)
class NodeReport:
    """Diagnostics of a node, with the steady time of their arrival in s."""

    level: int
    message: str
    values: Mapping[str, str]
    moment: float


class NodeReports:
    """Latest report of every node; one thread writes, another may read."""

    def __init__(self) -> None:
        self._reports: dict[str, NodeReport] = {}

    def receive(self, node: str, report: NodeReport) -> bool:
        """Store a node's report, cut to what a page can show; return false beyond `MOST_NODES`.

        Expected nodes are always stored.
        """
        crowded = len(self._reports.keys() - set(EXPECTED)) >= MOST_NODES - len(EXPECTED)
        if crowded and node not in self._reports and node not in EXPECTED:
            return False
        values = {
            _clip(name): _clip(value) for name, value in islice(report.values.items(), MOST_VALUES)
        }
        report = replace(report, message=_clip(report.message), values=values)
        # Replace the dictionary, so that no reader on another thread sees it change.
        self._reports = {**self._reports, _clip(node): report}
        return True

    def forget(self) -> None:
        """Discard all reports because the graph has ended."""
        self._reports = {}

    def values(self, node: str, now: float) -> Mapping[str, str]:
        """Return the values that a node reported; empty if it has stopped reporting."""
        report = self._reports.get(node)
        return report.values if report and now - report.moment < SILENCE else {}

    def rows(self, now: float, expected: Sequence[str] = EXPECTED) -> list[dict[str, str]]:
        """Return name, state and message of every node, expected nodes first."""
        reports = self._reports
        names = [*expected, *(name for name in reports if name not in expected)]
        return [{"name": name, **_row(reports.get(name), now)} for name in names]


def _row(report: NodeReport | None, now: float) -> dict[str, str]:
    if report is None:
        return {"state": "absent", "message": "no diagnostics received yet"}
    silent = now - report.moment
    if silent >= SILENCE:
        return {"state": "silent", "message": f"no diagnostics for {silent:.0f} s"}
    state = LEVELS.get(report.level, "silent")
    if report.message != state:
        return {"state": state, "message": report.message}
    has_peer = report.values.get("one-way delay (ms)")
    values = defaultdict(lambda: "–", report.values)
    return {"state": state, "message": NETWORK.format_map(values) if has_peer else ""}


def number(text: str | None) -> float | None:
    """Return a number that a node reported; None if missing or not finite."""
    try:
        found = float(text or "nan")
    except ValueError:
        return None
    return found if math.isfinite(found) else None


def _clip(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + "…"


def choices() -> dict[str, list[str]]:
    """Return the choices of controller, surface and grip."""
    return {
        "controller": list(CONTROLLERS),
        "surface": sorted(path.stem for path in (config_folder() / "surfaces").glob("*.yaml")),
        "grip": list(POSTURES),
    }


def state_of(
    reports: NodeReports,
    expected: Sequence[str],
    values: Mapping[str, Mapping[str, Any]],
    settings: GraphSettings,
    *,
    led: bool,
    stop: Mapping[str, bool | None],
) -> dict[str, Any]:
    """Return the graph's state for a page, ready for JSON.

    Parameters
    ----------
    reports : NodeReports
    expected : sequence of str
        Nodes that are shown even if they have sent no diagnostics.
    values : mapping
        Known parameters of the nodes of `NEEDED`.
    settings : GraphSettings
    led : bool
        True if a page can lead the hand.
    stop : mapping
        State of the emergency stop: requested (``asked``), and as reported by each arm.
    """
    now = time.monotonic()
    touched = scene_of(values["slave_device"])
    coupler = reports.values("coupler", now)
    master = reports.values("master_device", now)
    return {
        "nodes": reports.rows(now, expected),
        "recorder": dict(reports.values("recorder", now)),
        "controller": values["compensator"].get("controller"),
        "surface": Path(touched).stem if touched else None,
        "grip": values["master_device"].get(POSTURE),
        "scene": touched,
        "led": led,
        "engaged": {"true": True, "false": False}.get(coupler.get("engaged", "")),
        "stop": dict(stop),
        "actuator": {
            "age_us": number(master.get("actuator force age p50 (us)")),
            "due": number(master.get("actuator force due")),
            "missed": number(master.get("actuator force deadlines missed")),
            "latest_us": number(master.get(f"actuator force {LONGEST}")),
        },
        "limits": {
            "force": settings.actuator.peak_force,
            "travel": settings.actuator.travel,
            "assumed": settings.assumed,
        },
    }


def scene_of(slave: Mapping[str, Any]) -> str | None:
    """Return the surface or scene file under the tool by the slave's parameters.

    The result is None if the surface is unknown.
    """
    name = {VIRTUAL: SCENE_FILE, SIMULATED: f"{SURFACE}name"}.get(slave.get("device", ""))
    return slave.get(name) if name else None


def drawing(slave: Mapping[str, Any]) -> dict[str, Any]:
    """Return a page's drawing of the scene, from known slave parameters, in SI units.

    It shows the plane through the tool along x and z as far as the hand reaches.

    Returns
    -------
    dict
        ``view``: first and last x and z; ``outlines``: lines by name of object; ``nodes``: speeds
        and forces of an object's texture model; ``offset``: x and z from the master's frame to
        the slave's.

    Raises
    ------
    ParameterError
        The scene's file can no longer be read.
    """
    name = scene_of(slave)
    if name is None or slave["device"] != VIRTUAL:
        (left, right), _ = HAND_REACH
        plane = {} if name is None else {name: [[[left, 0], [right, 0]]]}
        return {"view": HAND_REACH, "outlines": plane, "nodes": {}, "offset": [0, 0]}
    scene = read_scene(Path(name))
    outlines = {
        name: [line.round(5).tolist() for line in lines]
        for name, lines in scene.section(*HAND_REACH, y=scene.start[1]).items()
    }
    nodes = {
        each.name: np.column_stack([texture.speeds, texture.forces]).tolist()
        for each in scene.objects
        if (texture := each.material.texture)
    }
    x, _, z = scene.start
    return {"view": HAND_REACH, "outlines": outlines, "nodes": nodes, "offset": [x, z]}
