# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Families of handles that differ from their description, and random hands.

A member is a rig that plays one kind of difference, while the controllers have the description of
a shipped rig. The ranges, where no source is given, are assumed:

- structural modes: 60 to 450 Hz, from the lowest band that the supervision judges to the highest
  that textures excite; damping ratios of 0.01 (a bare metal bracket) to 0.2 (held by a hand; the
  fit to the paper's rig has 0.105). A mode drifts by half an octave to an octave within 0.5 to 4 s
  (assumed: a hand that slides along a stylus, a screw that comes loose);
- force and handle constants: within 30 %, as a coil's force constant falls with travel and
  temperature, and as a suspension that was never identified;
- delay: up to 0.6 ms more (half a period of USB 2.0's 1 ms frames, rounded up);
- dry friction of the bearing: 0.03 to 0.08 N, two to five times that of the paper's rig;
- noise: 2 to 10 times that of the paper's accelerometer; 10 times, 2.5 mg/sqrt(Hz), is that of a
  sensor for high ranges (ADXL377 data sheet: 2.7 mg/sqrt(Hz));
- travel: 1 to 10 mm, which the controllers know: short and long voice coils around the paper's
  3.8 mm;
- grips: another hand twice a second;
- polarity: swapped wires of the coil.

A member of the second family, `strange`, has two to five of these differences at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Any, TypeAlias

import numpy as np
from input_family import Random, log_uniform

from haptic_accel import HandleParameters, MountParameters, Plant
from haptic_accel.core.model import AccelerometerParameters
from haptic_accel.core.trial import GripChange

STRANGE = 80
"""Random stream of handles with several differences."""

MODE_FREQUENCY = 60.0, 450.0
"""Range of structural modes, Hz; log-uniform."""

MODE_DAMPING = 0.01, 0.2
"""Range of their damping ratios; log-uniform."""

DRIFT_STEP = 0.01
"""Relative change of frequency from one step of a drifting mode to the next."""

FORCE_DEVIATION = 0.1, 0.3
"""Range of the relative deviation of the force constant, in either direction."""

HANDLE_FACTOR = 0.7, 1.3
"""Range of the handle's constants relative to the described ones."""

MORE_DELAY = 0.1e-3, 0.6e-3
"""Range of the delay in addition to the described one, s."""

FRICTION = 0.03, 0.08
"""Range of the bearing's dry friction, N."""

NOISE_FACTOR = 2.0, 10.0
"""Range of the accelerometer's noise relative to the paper's; log-uniform."""

TRAVEL = 1e-3, 10e-3
"""Range of the actuator's travel, m; log-uniform."""

HANDS_EVERY = 0.5
"""Time between grips, s."""

SPREAD = {"m_h": (0.7, 1.3), "k_u": (0.5, 2.0), "b_u": (0.5, 2.0)}
"""Ranges of random hands relative to Table I: mass uniform, stiffness and damping log-uniform."""

WIDE = {"m_h": (0.4, 3.0), "k_u": (0.2, 8.0), "b_u": (0.2, 6.0)}
"""Ranges of unusual hands, from a light touch to a firm grip."""

Values: TypeAlias = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Played:
    """Differences of a rig, as it is played, from its description.

    Attributes
    ----------
    name : str
        Numbers of the difference.
    changes : dict
        Values by node and dotted name.
    grips : tuple of GripChange
        Changes of grip or mount within a trial.
    """

    name: str
    changes: Values = field(default_factory=dict)
    grips: tuple[GripChange, ...] = ()


def member(kind: str, number: int, described: Plant, seconds: float, seed: int = 0) -> Played:
    """Return one member of the family.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    number : int
        Number of the member of this kind.
    described : Plant
        Description of the rig: handle, delay and bandwidth.
    seconds : float
        Duration of the trial, s.
    seed : int
        Seed of all draws.

    Examples
    --------
    >>> member("friction", 0, Plant(), seconds=8.0).name
    '0.068 N'
    """
    random = np.random.default_rng((seed, number, list(KINDS).index(kind)))
    return KINDS[kind](random, described, seconds)


def strange(number: int, described: Plant, seconds: float, seed: int = 0) -> Played:
    """Return a handle with several differences at once; parameters as for `member`.

    Four of five have a difference of modes; the others are drawn from `AT_ONCE`.
    """
    random = np.random.default_rng((seed, number, STRANGE))
    kinds = [str(random.choice(MODES))] if random.uniform() < 0.8 else []
    more = random.permutation(list(AT_ONCE))[: int(random.integers(2 - len(kinds), 5))]
    kinds += [str(kind) for kind in more]
    names: list[str] = []
    changes: Values = {}
    grips: list[GripChange] = []
    for kind in kinds:
        played = {**KINDS, **AT_ONCE}[kind](random, described, seconds)
        names.append(f"{kind} {played.name}")
        for node, values in played.changes.items():
            changes.setdefault(node, {}).update(values)
        grips += played.grips
    return Played("; ".join(names), changes, tuple(grips))


def hand(
    seed: int, number: int, spread: Mapping[str, tuple[float, float]] = SPREAD
) -> HandleParameters:
    """Return a random hand within given ranges."""
    return _hand(np.random.default_rng((seed, number)), HandleParameters(), spread)


def _hand(
    random: Random, average: HandleParameters, spread: Mapping[str, tuple[float, float]]
) -> HandleParameters:
    factors = {"m_h": random.uniform(*spread["m_h"])}
    factors |= {name: log_uniform(random, *spread[name]) for name in ("k_u", "b_u")}
    return replace(average, **{name: getattr(average, name) * f for name, f in factors.items()})


def _mode(random: Random) -> MountParameters:
    return MountParameters(
        log_uniform(random, *MODE_FREQUENCY), log_uniform(random, *MODE_DAMPING)
    )


def _with(prefix: str, **values: Any) -> Values:
    """Return values of the master by their names below a prefix."""
    return {"master_device": {f"simulated.{prefix}.{name}": v for name, v in values.items()}}


def _two(random: Random, rigid: bool, **second: Any) -> Played:
    """Return a mount, unless it is rigid, and a second mode."""
    mount = MountParameters() if rigid else _mode(random)
    other = _mode(random)
    values = _with("mount", **vars(mount))["master_device"]
    values |= _with("second", **vars(other), **second)["master_device"]
    both = [mount, other][rigid:]
    name = " and ".join(f"{each.frequency:.0f} Hz, {each.damping:.2g}" for each in both)
    return Played(name, {"master_device": values})


def _one_mode(random: Random, described: Plant, seconds: float) -> Played:
    mount = _mode(random)
    return Played(f"{mount.frequency:.0f} Hz, {mount.damping:.2g}", _with("mount", **vars(mount)))


def _in_series(random: Random, described: Plant, seconds: float) -> Played:
    return _two(random, rigid=False, share=1.0, on_mount=True)


def _in_parallel(random: Random, described: Plant, seconds: float) -> Played:
    return _two(random, rigid=False, share=random.uniform(0.2, 0.8), on_mount=False)


def _pair(random: Random, described: Plant, seconds: float) -> Played:
    """Return a resonance beside an antiresonance: a mode in parallel to the rigid handle."""
    return _two(random, rigid=True, share=random.uniform(0.2, 0.8), on_mount=False)


def _drift(random: Random, described: Plant, seconds: float) -> Played:
    mount = _mode(random)
    low, high = MODE_FREQUENCY
    ratio = 2.0 ** random.uniform(0.5, 1.0)
    # In the direction that stays within the range.
    falls = mount.frequency / ratio > low and (
        mount.frequency * ratio > high or random.uniform() < 0.5
    )
    begin, length = random.uniform(1.0, 2.5), log_uniform(random, 0.5, 4.0)
    steps = math.ceil(math.log(ratio) / DRIFT_STEP)
    factor = ratio ** ((-1.0 if falls else 1.0) / steps)
    grips = tuple(
        (begin + length * step / steps, replace(mount, frequency=mount.frequency * factor**step))
        for step in range(1, steps + 1)
    )
    end = mount.frequency * factor**steps
    name = f"{mount.frequency:.0f} to {end:.0f} Hz, {mount.damping:.2g}, in {length:.1f} s"
    return Played(name, _with("mount", **vars(mount)), grips)


def _force_constant(random: Random, described: Plant, seconds: float) -> Played:
    factor = 1.0 + random.choice([-1.0, 1.0]) * random.uniform(*FORCE_DEVIATION)
    return Played(f"{factor:.2f}", _with("drive", force_scale=float(factor)))


def _handle_constants(random: Random, described: Plant, seconds: float) -> Played:
    factors = {name: random.uniform(*HANDLE_FACTOR) for name in vars(described.handle)}
    values = {name: getattr(described.handle, name) * f for name, f in factors.items()}
    return Played(
        ", ".join(f"{name} {f:.2f}" for name, f in factors.items()), _with("handle", **values)
    )


def _more_delay(random: Random, described: Plant, seconds: float) -> Played:
    more = random.uniform(*MORE_DELAY)
    return Played(f"{1e3 * more:.2f} ms", _with("drive", delay=described.delay + more))


def _friction(random: Random, described: Plant, seconds: float) -> Played:
    friction = random.uniform(*FRICTION)
    return Played(f"{friction:.3f} N", _with("drive", coulomb_friction=friction))


def _noise(random: Random, described: Plant, seconds: float) -> Played:
    factor = log_uniform(random, *NOISE_FACTOR)
    # The same noise of a sample, whatever the bandwidth of the described sensor.
    paper = AccelerometerParameters()
    density = factor * paper.noise_density * math.sqrt(paper.bandwidth / described.bandwidth)
    return Played(f"{factor:.1f}", _with("accelerometer", noise_density=density))


def _another_hand(random: Random, described: Plant, seconds: float) -> Played:
    grip = _hand(random, described.handle, SPREAD)
    values = {name: getattr(grip, name) for name in SPREAD}
    name = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
    return Played(name, _with("handle", **values))


def _travel(random: Random, described: Plant, seconds: float) -> Played:
    travel = log_uniform(random, *TRAVEL)
    told = {node: {"actuator.travel": travel} for node in ("master_device", "compensator")}
    return Played(f"{1e3 * travel:.1f} mm", told)


def _grips(random: Random, described: Plant, seconds: float) -> Played:
    return Played("twice a second", {}, tuple(_hands(random, described.handle, seconds)))


def _hands(random: Random, average: HandleParameters, seconds: float) -> Iterator[GripChange]:
    for number in count(1):
        if number * HANDS_EVERY >= seconds:
            return
        yield number * HANDS_EVERY, _hand(random, average, SPREAD)


def _polarity(random: Random, described: Plant, seconds: float) -> Played:
    return Played("-1", _with("drive", force_scale=-1.0))


NAMES = {
    "one mode": "a mode near",
    "modes in series": "a mode near",
    "modes in parallel": "a mode near",
    "resonance and antiresonance": "a mode near",
    "drifting mode": "a mode near",
    "more delay": "later than described",
    "noise": "of noise",
    "polarity": "in the opposite direction",
}
"""Part of the warning that names a kind of difference; other kinds have no name."""

FALSE_NAMES = (
    *dict.fromkeys(NAMES.values()),
    "the force per mass is",
    "accelerometer is turned",
    "axes do not match",
)
"""Parts of warnings of which a handle as described, with one axis or three, should have none."""

KINDS: dict[str, Callable[[Random, Plant, float], Played]] = {
    "one mode": _one_mode,
    "modes in series": _in_series,
    "modes in parallel": _in_parallel,
    "resonance and antiresonance": _pair,
    "drifting mode": _drift,
    "force constant": _force_constant,
    "handle constants": _handle_constants,
    "more delay": _more_delay,
    "friction": _friction,
    "noise": _noise,
    "travel": _travel,
    "grips": _grips,
    "polarity": _polarity,
}
"""Functions from a described rig and a duration, s, to what is played, by kind of difference."""

MODES = list(KINDS)[:5]
"""Kinds of which a strange handle has at most one."""

AT_ONCE = {
    **{kind: KINDS[kind] for kind in ("force constant", "more delay", "friction", "noise")},
    "another hand": _another_hand,
}
"""Differences that occur together, and with modes, by kind."""
