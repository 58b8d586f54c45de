# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Comparison of the compiled tick with plain Python, bit for bit.

``python benchmarks/tick_bits.py`` runs short trials in lockstep with every controller, rig, rate,
surface and coupling in both, and a million random ticks of the safety layer.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from itertools import cycle, product
from pathlib import Path
from types import ModuleType
from typing import Any

UNIT = "haptic_accel.core.tick._compiled"

CONTROLLERS = ("none", "constant", "dynamic", "inverse", "feedback", "adaptive")
OF_ONE_AXIS = ("constant", "feedback")
RIGS = ("paper", "ideal", "three_axis", "three_axis_ideal")
SURFACES = ("text", "vinyl", "plywood")
RATES = (500.0, 1000.0, 2000.0, 4000.0)
OTHERS = (
    "controller:=inverse coupling:=passive",
    "controller:=adaptive slave:=virtual",
    "controller:=dynamic slave:=virtual rig:=three_axis",
    "controller:=inverse slave:=virtual surface:=worktop",
    "controller:=inverse composed:=false",
    "controller:=inverse reduction:=axis",
    "controller:=dynamic reduction:=sum grip:=hook",
    "controller:=adaptive reduction:=principal rig:=three_axis grip:=pinch",
)
SAMPLES = 200
"""Length of a trial in samples: the tool lands, and each part of a sample has run."""


def trials() -> Iterator[tuple[str, float]]:
    """Yield the words and the rate of each trial."""
    surfaces, rates = cycle(SURFACES), cycle(RATES)
    for controller, rig in product(CONTROLLERS, RIGS):
        if rig.startswith("three") and controller in OF_ONE_AXIS:
            continue
        # The plants of presets with three axes are identified at 1 kHz.
        rate = 1000.0 if rig.startswith("three") else next(rates)
        yield f"controller:={controller} rig:={rig} surface:={next(surfaces)}", rate
        if rig == "paper":
            yield from ((f"controller:={controller} surface:=text", rate) for rate in RATES)
    yield from ((words, 1000.0) for words in OTHERS)


def digests() -> dict[str, str]:
    """Return the SHA-256 of the signals of each trial."""
    from dataclasses import replace

    import numpy as np

    from haptic_accel import Setup, lockstep_trial
    from haptic_accel.setup.arguments import parse_arguments

    found = {}
    for words, rate in trials():
        arguments = replace(parse_arguments(words.split()), rate=rate, duration=SAMPLES / rate)
        trial = lockstep_trial(Setup.of(arguments))
        signals = [
            *(trial.time, trial.tool_acceleration, trial.desired_acceleration),
            *(trial.handle_acceleration, trial.actuator_force, *trial.arms.values()),
        ]
        texts = [np.ascontiguousarray(signal).tobytes() for signal in signals]
        found[f"{words} at {rate:g} Hz"] = hashlib.sha256(b"".join(texts)).hexdigest()
    return found


def loaded(path: Path) -> ModuleType:
    """Return the unit of a file, without its taking the place of plain Python."""
    spec = importlib.util.spec_from_file_location(UNIT, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"{path}: no extension of Python")
    unit = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(unit)
    return unit


def differing_trials(path: Path) -> list[str]:
    """Return the trials whose signals differ between a unit and plain Python."""
    plain, compiled = (
        subprocess.Popen(
            [sys.executable, __file__, "digests", *words],
            env={**os.environ, "HAPTIC_ACCEL_PLAIN": "" if words else "1"},
            stdout=subprocess.PIPE,
        )
        for words in ([], [str(path)])
    )
    known, found = json.loads(plain.communicate()[0]), json.loads(compiled.communicate()[0])
    return [name for name, digest in known.items() if found[name] != digest]


def differing_sums(unit: ModuleType) -> list[int]:
    """Return the lengths of products, up to 5000, whose sum differs from plain Python's."""
    import numpy as np

    from haptic_accel.core.tick.kernels import dot

    past = np.random.default_rng(1).normal(size=5010)
    taps = past[::-1].copy()
    lengths = [*range(1, 1100), *range(1100, 5000, 41)]
    given = ((taps[:count], past, count % 10, np.empty(count)) for count in lengths)
    return [len(each[0]) for each in given if unit.dot(*each) != dot(*each)]


class SafetyPair:
    """Safety layers of plain Python and of a unit under the same random commands.

    Parameters
    ----------
    unit : module
    seed : int
    axes : str
        Axes of the actuator.

    Attributes
    ----------
    forces : list of float
        Forces after the latest tick, N.
    """

    def __init__(self, unit: ModuleType, seed: int, axes: str) -> None:
        from haptic_accel import Axes
        from haptic_accel.core import actuator
        from haptic_accel.core.tick import SafetyLayer

        self._random = random.Random(seed)
        choose = self._random.choice
        self.parameters = actuator.MasterSafetyParameters(
            recovery=choose(["automatic", "manual"]),
            arm=actuator.ArmLimits(slew_rate=choose([0.0, 500.0])),
            actuator=actuator.ActuatorCommandLimits(slew_rate=choose([0.0, 3000.0])),
        )
        kinds = (SafetyLayer, unit.SafetyLayer)
        self._layers: list[Any] = [
            kind(self.parameters, 1000.0, Axes.parsed(axes)) for kind in kinds
        ]
        self._scale, self._count = 2.0, 0
        self.forces: list[float] = []
        for layer in self._layers:
            layer.enable(0.0, True)

    def tick(self) -> bool:
        """Advance both by one tick; return whether they agree, to the last bit."""
        chance, choose = self._random.random(), self._random.choice
        force, measured = self._numbers(self._scale), self._numbers(20.0 * self._scale)
        age, known = 3e-3, True
        if chance < 0.01:
            force[choose((0, 1, 2))] = choose((math.nan, math.inf, 1e300))
        elif chance < 0.02:
            age = choose((1.0, -1.0, math.nan))
        elif chance < 0.03:
            known = False
        elif chance < 0.04:
            measured = [math.inf, math.nan, 1e9]
        elif chance < 0.05:
            self._scale = choose((0.0, 0.1, 2.0, 20.0, 1e300))
        now, active = self._count / 1000.0, self._random.random() < 0.7
        commanded = (self._count // 200) % 7 != 3
        states: list[list[object]] = []
        for layer in self._layers:
            if commanded:
                layer.arm_limit.command(now, age, *force)
                layer.actuator_limit.command(now, age, *force)
            layer.arm_limit.expires(now)
            layer.actuator_limit.tick(now, known, *measured)
            if chance > 0.9995:
                layer.enable(now, active)
            limits = layer.arm_limit, layer.actuator_limit
            self.forces = [each for one in limits for each in (one.x, one.y, one.z)]
            states.append([*self.forces])
            if self._count % 50 == 0:
                states[-1] += [layer.warnings(), layer.diagnostics(), layer.news(now)]
        self._count += 1
        return repr(states[0]) == repr(states[1])

    def within_limits(self) -> bool:
        """Return whether all forces are finite, and below their peaks."""
        arm, coils = math.hypot(*self.forces[:3]), self.forces[3:]
        peak = self.parameters.hardware.peak_force
        # A comparison with NaN is false.
        return arm <= self.parameters.arm.peak_force * (1.0 + 1e-9) and all(
            abs(force) <= peak for force in coils
        )

    def _numbers(self, scale: float) -> list[float]:
        return [self._random.gauss(0.0, scale) for _ in range(3)]


def first_difference(unit: ModuleType, ticks: int, seed: int = 0, axes: str = "z") -> int | None:
    """Return the first tick of the safety layer that differs or breaks a limit; None if none."""
    pair = SafetyPair(unit, seed, axes)
    return next((n for n in range(ticks) if not (pair.tick() and pair.within_limits())), None)


def main(words: list[str]) -> int:
    """Print digests of this process, or compare plain Python with the installed unit."""
    if words[:1] == ["digests"]:
        if words[1:]:
            sys.modules[UNIT] = loaded(Path(words[1]))
        print(json.dumps(digests()))
        return 0
    os.environ["HAPTIC_ACCEL_PLAIN"] = "1"
    import haptic_accel.core.tick

    path = next(Path(haptic_accel.core.tick.__path__[0]).glob("_compiled*.so"), None)
    if path is None:
        print("tick_bits.py: no compiled tick is installed", file=sys.stderr)
        return 1
    found: list[object] = [*differing_trials(path), *differing_sums(loaded(path))]
    for seed, axes in enumerate(("z", "x, y, z")):
        tick = first_difference(loaded(path), 500_000, seed, axes)
        found += [] if tick is None else [f"safety layer, axes {axes}: tick {tick}"]
    print(*found, f"{len(found)} differences", sep="\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
