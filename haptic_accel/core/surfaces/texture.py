"""Textures: what the tool's acceleration is while it slides, by speed and normal force.

Noise through an autoregressive filter whose line spectral frequencies are interpolated between
recorded speeds and forces (Culbertson, Unwin, Kuchenbecker, IEEE ToH 7(3), 2014).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import mul
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from haptic_accel.core.control.filters import SampleFilter
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, check_positive_rate
from haptic_accel.core.surfaces.line_spectrum import (
    from_polynomial,
    is_ordered,
    levinson,
    to_polynomial,
)

IntArray = npt.NDArray[np.intp]

SPEED_CORNER = 20.0
"""Corner of the second-order low-pass of the speed, Hz (Culbertson and others 2014)."""

LIMIT = 100.0
"""Largest acceleration of a texture, m/s^2: five times the RMS of the strongest of the 100
textures of the Penn Haptic Texture Toolkit."""

CELLS = 128
"""Cells along the range of speed and of force within which the filter is the same: less than
anyone feels (just noticeable differences of force and speed are several per cent)."""

NOISE_BLOCK = 256
"""Random numbers drawn at a time: few enough to delay no sample by more than 10 us."""

SPECTRUM_POINTS = 2**13
"""Frequencies at which a spectrum is integrated, for peaks as narrow as 1/4000 of the rate."""

FLOOR = 1e-3
"""Power density where a model of a lower rate knows nothing, over its mean density."""


@dataclass(frozen=True)
class Provenance:
    """Where a model comes from, and what may be done with it."""

    source: str = ""
    licence: str = ""
    author: str = ""
    calibration: str = ""


class Place(NamedTuple):
    """A point of the plane between three nodes.

    Attributes
    ----------
    corners : ndarray, shape (3,)
        Indices of the nodes.
    affine : ndarray, shape (3, 3)
        The nodes' weights are its product with (speed, force, 1), around the point.
    weights : ndarray, shape (3,)
        At the point; from 0 to 1, 1 together.
    """

    corners: IntArray
    affine: FloatArray
    weights: FloatArray


class _Plane:
    """Delaunay triangles of nodes by speed and force, both relative to their largest."""

    def __init__(self, speeds: FloatArray, forces: FloatArray) -> None:
        from scipy.spatial import Delaunay, QhullError

        self._scale = np.array([speeds.max(), forces.max(), 1.0])
        nodes = np.column_stack([speeds, forces, np.ones(len(speeds))]) / self._scale
        try:
            mesh = Delaunay(nodes[:, :2])
        except (QhullError, ValueError):
            raise ParameterError(
                f"nodes = {len(speeds)}: must be three or more, not in line in speed and force"
            ) from None
        # Of nodes all but in line, Qhull makes triangles without an area.
        areas = np.abs(np.linalg.det(nodes[mesh.simplices]))
        self.triangles: IntArray = mesh.simplices[areas > 1e-9].astype(np.intp)
        self._affine = np.linalg.inv(nodes[self.triangles].transpose(0, 2, 1)) / self._scale
        self._starts = nodes[mesh.convex_hull[:, 0], :2]
        self._edges = nodes[mesh.convex_hull[:, 1], :2] - self._starts

    def locate(self, speed: float, force: float) -> Place:
        """Return the place of a point, or of the nearest one in the nodes' convex hull."""
        point = np.array([speed, force, 1.0])
        weights = self._affine @ point
        least = weights.min(axis=1)
        best = int(least.argmax())
        if least[best] >= -1e-9:
            return Place(self.triangles[best], self._affine[best], _convex(weights[best]))
        weights = self._affine @ (self._nearest(point / self._scale) * self._scale)
        best = int(weights.min(axis=1).argmax())
        there = _convex(weights[best])
        return Place(self.triangles[best], np.outer(there, [0.0, 0.0, 1.0]), there)

    def _nearest(self, point: FloatArray) -> FloatArray:
        """Return the point of the hull nearest to one outside, relative to the largest."""
        away = point[:2] - self._starts
        along = np.sum(away * self._edges, axis=1) / np.sum(self._edges**2, axis=1)
        feet = self._starts + np.clip(along, 0.0, 1.0)[:, None] * self._edges
        foot = feet[np.argmin(np.sum((feet - point[:2]) ** 2, axis=1))]
        return np.append(foot, 1.0)


def _convex(weights: FloatArray) -> FloatArray:
    """Return weights without the rounding errors below zero."""
    positive = np.maximum(weights, 0.0)
    return np.asarray(positive / positive.sum())


def _empty() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True, eq=False)
class TextureModel:
    """A texture: filters for white noise at nodes of the plane of speed and normal force.

    Attributes
    ----------
    name : str
    rate : float
        Samples per second.
    speeds, forces : ndarray, shape (n,)
        Nodes: tangential speed, m/s, and normal force, N.
    lsf : ndarray, shape (n, p)
        Line spectral frequencies of the recursive part, rad per sample, rising within (0, pi).
    deviation : ndarray, shape (n,)
        Standard deviation of the white innovation, m/s^2; 0 where speed or force is.
    ma_lsf : ndarray, shape (n, q)
        Line spectral frequencies of the moving average; none by default.
    gain : ndarray, shape (n,)
        Factor of the moving average; 1 by default.
    coulomb_friction : float or None
        Coefficient of sliding friction.
    provenance : Provenance

    Raises
    ------
    ParameterError
        A value does not fit; in one line.
    """

    name: str
    rate: float
    speeds: FloatArray
    forces: FloatArray
    lsf: FloatArray
    deviation: FloatArray
    ma_lsf: FloatArray = field(default_factory=_empty)
    gain: FloatArray = field(default_factory=_empty)
    coulomb_friction: float | None = None
    provenance: Provenance = Provenance()

    def __post_init__(self) -> None:
        """Check everything."""
        check_positive_rate(self.rate)
        nodes = len(self.speeds)
        if np.size(self.ma_lsf) == 0:
            object.__setattr__(self, "ma_lsf", np.empty((nodes, 0)))
        if np.size(self.gain) == 0:
            object.__setattr__(self, "gain", np.ones(nodes))
        for name in ("speeds", "forces", "deviation", "gain"):
            self._set_checked(name, (nodes,))
        for name in ("lsf", "ma_lsf"):
            self._set_checked(name, (nodes, np.shape(getattr(self, name))[-1]))
            if not is_ordered(getattr(self, name)):
                raise ParameterError(f"{name}: must rise within 0 to pi at each node")
        friction = self.coulomb_friction
        if friction is not None and not 0 <= friction < math.inf:
            raise ParameterError(f"coulomb_friction = {friction}: must be at least 0")
        self._plane  # noqa: B018 - refuses nodes in line

    def _set_checked(self, name: str, shape: tuple[int, ...]) -> None:
        values = np.asarray(getattr(self, name), dtype=float)
        if values.shape != shape:
            raise ParameterError(
                f"{name}: shape {values.shape}: must be {shape}, a row for each node"
            )
        wrong = values[~(np.isfinite(values) & (values >= 0))]
        if wrong.size:
            raise ParameterError(f"{name} = {wrong[0]:g}: must be finite and at least 0")
        object.__setattr__(self, name, values)

    @cached_property
    def _plane(self) -> _Plane:
        return _Plane(self.speeds, self.forces)

    @property
    def triangles(self) -> IntArray:
        """Delaunay triangles of the plane: indices of nodes, shape (m, 3)."""
        return self._plane.triangles

    def locate(self, speed: float, force: float) -> Place:
        """Return the place of a speed in m/s and force in N, or the nearest in the nodes' hull."""
        return self._plane.locate(speed, force)

    def spectrum(self, speed: float, force: float, frequency: FloatArray) -> FloatArray:
        """Return the one-sided power density of the acceleration, (m/s^2)^2/Hz.

        Parameters
        ----------
        speed, force : float
            m/s, N.
        frequency : ndarray
            Up to half the rate, Hz.
        """
        corners, _, weights = self.locate(speed, force)
        power = weights @ self.deviation[corners] ** 2 * (weights @ self.gain[corners]) ** 2
        return power * self._shape(
            weights @ self.lsf[corners], weights @ self.ma_lsf[corners], frequency
        )

    def _shape(self, lsf: FloatArray, ma_lsf: FloatArray, frequency: FloatArray) -> FloatArray:
        """Return the one-sided power density of filtered noise of variance 1, 1/Hz."""
        delay = np.exp(-2j * np.pi * np.asarray(frequency) / self.rate)
        numerator, denominator = (
            np.polyval(to_polynomial(angles.tolist())[::-1], delay) for angles in (ma_lsf, lsf)
        )
        return np.asarray(2 / self.rate * np.abs(numerator / denominator) ** 2)

    def at_rate(self, rate: float) -> TextureModel:
        """Return the model for another rate in Hz, with the same spectrum where both have one.

        Each node's filter is that of the autocovariance which the spectrum has at the new rate.
        """
        if rate == self.rate:
            return self
        check_positive_rate(rate)
        frequency = np.linspace(0.0, rate / 2, SPECTRUM_POINTS + 1)
        known = frequency <= self.rate / 2
        lsf, deviation = [], []
        for angles, ma_angles in zip(self.lsf, self.ma_lsf, strict=True):
            density = np.zeros(len(frequency))
            density[known] = self._shape(angles, ma_angles, frequency[known])
            density[~known] = FLOOR * density[known].mean()
            covariance = np.fft.irfft(density * rate / 2)
            polynomial, variance = levinson(covariance[: len(angles) + 1])
            lsf.append(from_polynomial(polynomial))
            deviation.append(math.sqrt(variance))
        return replace(
            self,
            rate=rate,
            lsf=np.array(lsf),
            deviation=self.deviation * self.gain * deviation,
            ma_lsf=_empty(),
            gain=_empty(),
        )


class _Filter(NamedTuple):
    """The filter of a cell: variance of the innovation by speed, force and 1, and coefficients."""

    variance: tuple[float, float, float]
    gain: float
    forward: list[float]
    feedback: list[float]


class Texture:
    """The acceleration of a tool that slides over a texture, sample by sample.

    Parameters
    ----------
    model : TextureModel
    rate : float
        Samples per second, more than twice `SPEED_CORNER`.
    seed : int
        The same seed, speeds and forces give the same samples.
    limit : float
        Largest acceleration given out, m/s^2.

    Attributes
    ----------
    saturated : int
        Samples that were at the limit.
    """

    def __init__(self, model: TextureModel, rate: float, seed: int, limit: float = LIMIT) -> None:
        from scipy import signal

        self._model = model = model.at_rate(rate)
        self._limit = limit
        self._speed = SampleFilter(signal.butter(2, SPEED_CORNER, fs=rate, output="sos"))
        self._noise = _white_noise(seed)
        self._top_speed, self._top_force = float(model.speeds.max()), float(model.forces.max())
        self._outputs = deque([0.0] * model.lsf.shape[1], model.lsf.shape[1])
        self._innovations = deque([0.0] * model.ma_lsf.shape[1], model.ma_lsf.shape[1])
        self._filters: dict[tuple[int, int], _Filter] = {}
        self._filter = self._filter_of((0, 0))
        self.saturated = 0

    def sample(self, speed: float, force: float) -> float:
        """Return the next acceleration, m/s^2.

        Parameters
        ----------
        speed : float
            Tangential speed, m/s.
        force : float
            Normal force, N; 0 out of contact, where the texture rings down.
        """
        speed = min(max(self._speed.sample(speed), 0.0), self._top_speed)
        innovation = 0.0
        if force > 0:
            force = min(force, self._top_force)
            cell = (
                int(speed / self._top_speed * CELLS + 0.5),
                int(force / self._top_force * CELLS + 0.5),
            )
            self._filter = self._filters.get(cell) or self._filter_of(cell)
            by_speed, by_force, offset = self._filter.variance
            variance = by_speed * speed + by_force * force + offset
            if variance > 0:
                innovation = math.sqrt(variance) * next(self._noise)
        _, gain, forward, feedback = self._filter
        moved = innovation + sum(map(mul, forward, self._innovations))
        output: float = gain * moved - sum(map(mul, feedback, self._outputs))
        if abs(output) > self._limit:
            self.saturated += 1
            output = math.copysign(self._limit, output)
        self._innovations.appendleft(innovation)
        self._outputs.appendleft(output)
        return output

    def block(self, speeds: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the accelerations that `sample` would give one after the other."""
        return np.array(list(map(self.sample, speeds.tolist(), forces.tolist())))

    def _filter_of(self, cell: tuple[int, int]) -> _Filter:
        """Compute and keep the filter in the middle of a cell."""
        model = self._model
        speed, force = cell[0] * self._top_speed / CELLS, cell[1] * self._top_force / CELLS
        corners, affine, weights = model.locate(speed, force)
        by_speed, by_force, offset = (model.deviation[corners] ** 2 @ affine).tolist()
        found = self._filters[cell] = _Filter(
            (by_speed, by_force, offset),
            float(weights @ model.gain[corners]),
            to_polynomial((weights @ model.ma_lsf[corners]).tolist())[1:],
            to_polynomial((weights @ model.lsf[corners]).tolist())[1:],
        )
        return found


def _white_noise(seed: int) -> Iterator[float]:
    """Yield independent normal numbers of mean 0 and variance 1."""
    random = np.random.default_rng(seed)
    while True:
        yield from random.standard_normal(NOISE_BLOCK).tolist()
