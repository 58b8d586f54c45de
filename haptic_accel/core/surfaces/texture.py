# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Textures: acceleration of a sliding tool as a function of speed and normal force.

White noise passes an autoregressive filter, whose line spectral frequencies are interpolated
between recorded speeds and forces (Culbertson, Unwin, Kuchenbecker, IEEE ToH 7(3), 2014).

Line spectral frequencies (Itakura 1975; Soong, Juang 1984): a polynomial A(z) = 1 + a_1 z^-1 + ...
+ a_p z^-p is half the sum of a symmetric and an antisymmetric polynomial, whose roots lie on the
unit circle. The roots' angles in (0, pi) alternate if and only if all roots of A are inside.
Interpolation of the angles between two stable polynomials thus gives a stable one.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from operator import mul
from typing import NamedTuple

import numpy as np

from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import ParameterError, check_positive_rate
from haptic_accel.core.sampling import IntArray
from haptic_accel.core.tick.control import SampleFilter


def to_polynomial(lsf: FloatArray) -> FloatArray:
    """Return the coefficients 1, a_1 ... a_p of polynomials, shape (..., p + 1).

    Parameters
    ----------
    lsf : ndarray, shape (..., p)
        Line spectral frequencies in increasing order, rad per sample.
    """
    order = lsf.shape[-1]
    ahead = np.zeros((*lsf.shape[:-1], order + 2))
    behind = np.zeros_like(ahead)
    symmetric, antisymmetric = _product(lsf[..., 0::2]), _product(lsf[..., 1::2])
    if order % 2:  # fixed roots of the antisymmetric polynomial: 1, -1
        ahead += symmetric
        ahead[..., :-2] += antisymmetric
        behind[..., 2:] = antisymmetric
    else:  # fixed roots: -1 symmetric, 1 antisymmetric
        ahead[..., :-1] = symmetric + antisymmetric
        behind[..., 1:] = antisymmetric - symmetric
    return np.asarray((ahead - behind)[..., :-1] / 2)


def _product(angles: FloatArray) -> FloatArray:
    """Return the coefficients of the product of 1 - 2 cos(angle) z + z^2 over angles."""
    factors = np.moveaxis(-2 * np.cos(angles), -1, 0)
    product = np.zeros((2 * len(factors) + 1, *factors.shape[1:]))
    product[0] = 1.0
    for done, factor in enumerate(factors):
        before = product[: 2 * done + 1].copy()
        product[1 : 2 * done + 2] += factor * before
        product[2 : 2 * done + 3] += before
    return np.moveaxis(product, 0, -1)


def from_polynomial(polynomial: FloatArray) -> FloatArray:
    """Return the line spectral frequencies of a polynomial, rad per sample, increasing.

    Parameters
    ----------
    polynomial : ndarray, shape (p + 1,)
        Coefficients 1, a_1 ... a_p.

    Raises
    ------
    ParameterError
        A root of the polynomial is not inside the unit circle.
    """
    order = len(polynomial) - 1
    ahead, behind = np.append(polynomial, 0.0), np.append(0.0, polynomial[::-1])
    symmetric, antisymmetric = ahead + behind, ahead - behind
    if order % 2:
        antisymmetric = np.polydiv(antisymmetric, [1.0, 0.0, -1.0])[0]
    else:
        symmetric = np.polydiv(symmetric, [1.0, 1.0])[0]
        antisymmetric = np.polydiv(antisymmetric, [1.0, -1.0])[0]
    found = np.empty(order)
    found[0::2], found[1::2] = _angles(symmetric), _angles(antisymmetric)
    if not is_ordered(found):
        raise ParameterError("polynomial: a root is not inside the unit circle")
    return found


def _angles(coefficients: FloatArray) -> FloatArray:
    """Return the angles of a symmetric polynomial's roots; NaN for roots off the circle."""
    half = len(coefficients) // 2
    series = 2 * coefficients[half:]
    series[0] /= 2  # coefficients of cosines of multiples of the angle
    cosines = np.polynomial.chebyshev.chebroots(series)
    on_circle = (np.abs(cosines.imag) < 1e-7) & (np.abs(cosines.real) < 1)
    return np.sort(np.arccos(np.where(on_circle, cosines.real, np.nan)))


def is_ordered(lsf: FloatArray) -> bool:
    """Return True if frequencies increase within (0, pi) along the last axis: a stable filter."""
    ends = np.zeros((*lsf.shape[:-1], 1))
    return bool(np.all(np.diff(np.concatenate([ends, lsf, ends + np.pi], axis=-1)) > 0))


def levinson(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return prediction polynomials and innovation variances for autocovariances.

    Parameters
    ----------
    covariance : ndarray, shape (..., p + 1)
        Autocovariances at lags 0 to p; for a signal of finite length, the biased estimates.

    Returns
    -------
    polynomial : ndarray, shape (..., p + 1)
        Polynomials of order p, with 1 first; their roots are inside the unit circle.
    variances : ndarray, shape (..., p + 1)
        Variances of the prediction errors of orders 0 to p.
    """
    polynomial = np.zeros(covariance.shape)
    polynomial[..., 0] = 1.0
    variances = np.empty(covariance.shape)
    variances[..., 0] = covariance[..., 0] * (1 + _FLOOR) + np.finfo(float).tiny
    for n in range(covariance.shape[-1] - 1):
        error = (polynomial[..., : n + 1] * covariance[..., n + 1 : 0 : -1]).sum(axis=-1)
        reflection = (-error / variances[..., n])[..., None]
        before = polynomial[..., : n + 2].copy()
        polynomial[..., : n + 2] = before + reflection * before[..., ::-1]
        variances[..., n + 1] = variances[..., n] * (1 - reflection[..., 0] ** 2)
    return polynomial, variances


_FLOOR = 1e-9
"""White noise added to a covariance, relative to its variance; it keeps a pure tone stable."""


def autocovariance(polynomial: FloatArray, lags: int) -> FloatArray:
    """Return autocovariances from lag 0 on of unit white noise divided by polynomials.

    This is the inverse of `levinson`.

    Parameters
    ----------
    polynomial : ndarray, shape (..., p + 1)
        1, a_1 ... a_p; all roots inside the unit circle.
    lags : int
        Maximum lag.

    Returns
    -------
    ndarray, shape (..., lags + 1)
    """
    predictors = [polynomial]
    covariance = np.zeros((*polynomial.shape[:-1], lags + 1))
    covariance[..., 0] = 1.0
    while predictors[-1].shape[-1] > 1:  # polynomials of lower orders
        last = predictors[-1]
        unpredicted = 1 - last[..., -1:] ** 2
        predictors.append(((last - last[..., -1:] * last[..., ::-1]) / unpredicted)[..., :-1])
        covariance[..., :1] /= unpredicted
    for lag in range(1, lags + 1):
        predictor = predictors[max(0, len(predictors) - 1 - lag)][..., 1:]
        past = covariance[..., :lag][..., ::-1][..., : predictor.shape[-1]]
        covariance[..., lag] = -(predictor * past).sum(axis=-1)
    return covariance


def power_gain(forward: FloatArray, feedback: FloatArray) -> FloatArray:
    """Return the mean square of unit white noise after filters, shape (...).

    Parameters
    ----------
    forward, feedback : ndarray, shapes (..., q + 1) and (..., p + 1)
        Numerators, and denominators with 1 first and all roots inside the unit circle.
    """
    order = forward.shape[-1] - 1
    covariance = autocovariance(feedback, order)
    gain = (forward**2).sum(axis=-1) * covariance[..., 0]
    for lag in range(1, order + 1):
        gain += 2 * (forward[..., lag:] * forward[..., :-lag]).sum(axis=-1) * covariance[..., lag]
    return np.asarray(gain)


SPEED_CORNER = 20.0
"""Corner of the second-order low-pass of the speed, Hz (Culbertson and others 2014)."""

LIMIT = 100.0
"""Maximum acceleration of a texture, m/s^2: five times the RMS of the strongest of the 100
textures in the Penn Haptic Texture Toolkit."""

CELLS = 64
"""Number of cells along the ranges of speed and force; the filter is constant in a cell. If the
acceleration doubles between two nodes, an eighth of the range apart, its steps are 9 %, half of
them in each direction. The just noticeable difference of vibration is about 15 %."""

NOISE_BLOCK = 256
"""Number of random numbers drawn at a time: few enough to delay a sample by at most 10 us."""

MOST_NODES = 400
"""Maximum number of nodes in a model; Penn Haptic Texture Toolkit models have up to 60."""

HIGHEST_ORDER = 200
"""Maximum order of a filter; toolkit filters have up to 20."""

SPECTRUM_POINTS = 2**13
"""Number of frequencies for integrating a spectrum, for peaks as narrow as 1/4000 of the rate."""

FLOOR = 1e-3
"""Power density above the band of a model with a lower rate, relative to its mean density."""


@dataclass(frozen=True)
class Provenance:
    """Origin of a model, and its licence."""

    source: str = ""
    licence: str = ""
    author: str = ""
    calibration: str = ""


class Places(NamedTuple):
    """Points of the plane, each within a triangle of nodes.

    Attributes
    ----------
    corners : ndarray, shape (m, 3)
        Indices of the nodes.
    weights : ndarray, shape (m, 3)
        Weights of the nodes at the point, from 0 to 1, with the sum 1.
    affine : ndarray, shape (m, 3, 3)
        Matrix whose product with (speed, force, 1) gives the weights near the point.
    """

    corners: IntArray
    weights: FloatArray
    affine: FloatArray

    def interpolate(self, values: FloatArray) -> FloatArray:
        """Interpolate values, shape (n, ...), from the nodes to the points."""
        return np.asarray(np.einsum("mi,mi...->m...", self.weights, values[self.corners]))


class _Plane:
    """Delaunay triangles of nodes by speed and force, both relative to their largest values."""

    def __init__(self, speeds: FloatArray, forces: FloatArray) -> None:
        from scipy.spatial import Delaunay, QhullError

        self._scale = np.array([speeds.max() or 1.0, forces.max() or 1.0, 1.0])
        nodes = np.column_stack([speeds, forces, np.ones(len(speeds))]) / self._scale
        try:
            mesh = Delaunay(nodes[:, :2])
        except (QhullError, ValueError):
            raise ParameterError("nodes: must not be in line in speed and force") from None
        # For nearly collinear nodes Qhull returns triangles without an area.
        areas = np.abs(np.linalg.det(nodes[mesh.simplices]))
        self.triangles: IntArray = mesh.simplices[areas > 1e-9]
        self._affine = np.linalg.inv(nodes[self.triangles].transpose(0, 2, 1)) / self._scale
        self._starts = nodes[mesh.convex_hull[:, 0], :2]
        self._edges = nodes[mesh.convex_hull[:, 1], :2] - self._starts

    def locate(self, points: FloatArray) -> Places:
        """Return triangles and weights of points (speed, force), or of the nearest in the hull."""
        triangles, weights = self._within(points)
        affine = self._affine[triangles]
        outside = weights.min(axis=1) < -1e-9
        if outside.any():
            nearest = self._nearest(points[outside] / self._scale[:2]) * self._scale[:2]
            triangles[outside], weights[outside] = self._within(nearest)
            affine[outside] = weights[outside, :, None] * [0.0, 0.0, 1.0]
        weights = np.maximum(weights, 0.0)
        weights /= weights.sum(axis=1, keepdims=True)
        return Places(self.triangles[triangles], weights, affine)

    def _within(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the triangle that contains each point, within rounding, and its weights."""
        homogeneous = np.column_stack([points, np.ones(len(points))])
        weights = homogeneous @ self._affine.transpose(1, 2, 0)  # by corner, point, triangle
        best = weights.min(axis=0).argmax(axis=1)
        return best, weights[:, np.arange(len(points)), best].T

    def _nearest(self, points: FloatArray) -> FloatArray:
        """Return the points of the hull nearest to points outside it, in relative coordinates."""
        away = points[:, None] - self._starts
        along = np.sum(away * self._edges, axis=2) / np.sum(self._edges**2, axis=1)
        feet = self._starts + np.clip(along, 0.0, 1.0)[..., None] * self._edges
        nearest = np.sum((feet - points[:, None]) ** 2, axis=2).argmin(axis=1)
        return np.asarray(feet[np.arange(len(points)), nearest])


@dataclass(frozen=True, eq=False)
class TextureModel:
    """Texture: filters for white noise at nodes of the plane of speed and normal force.

    Attributes
    ----------
    name : str
    rate : float
        Samples per second.
    speeds, forces : ndarray, shape (n,)
        Nodes: tangential speed, m/s, and normal force, N.
    lsf : ndarray, shape (n, p)
        Line spectral frequencies of the recursive part, rad per sample, increasing within (0, pi).
    deviation : ndarray, shape (n,)
        Standard deviation of the white innovation, m/s^2; 0 where speed or force is 0.
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
        A value is invalid; the message is one line.
    """

    name: str
    rate: float
    speeds: FloatArray
    forces: FloatArray
    lsf: FloatArray
    deviation: FloatArray
    ma_lsf: FloatArray = field(default_factory=lambda: np.empty(0))
    gain: FloatArray = field(default_factory=lambda: np.empty(0))
    coulomb_friction: float | None = None
    provenance: Provenance = Provenance()

    def __post_init__(self) -> None:
        """Check all values."""
        check_positive_rate(self.rate)
        nodes = np.size(self.speeds)
        if np.size(self.ma_lsf) == 0:
            object.__setattr__(self, "ma_lsf", np.empty((nodes, 0)))
        if np.size(self.gain) == 0:
            object.__setattr__(self, "gain", np.ones(nodes))
        for name in ("speeds", "forces", "deviation", "gain"):
            self._set_checked(name, (nodes,))
        if nodes < 3:
            raise ParameterError(f"nodes = {nodes}: must be three or more")
        if nodes > MOST_NODES:
            raise ParameterError(f"nodes = {nodes}: must be at most {MOST_NODES}")
        for name in ("lsf", "ma_lsf"):
            order = (0, *np.shape(getattr(self, name)))[-1]
            if order > HIGHEST_ORDER:
                raise ParameterError(f"{name}: order {order}: must be at most {HIGHEST_ORDER}")
            self._set_checked(name, (nodes, order))
            if not is_ordered(getattr(self, name)):
                raise ParameterError(f"{name}: must increase within 0 to pi at each node")
        friction = self.coulomb_friction
        if friction is not None and not 0 <= friction < math.inf:
            raise ParameterError(f"coulomb_friction = {friction}: must be at least 0")
        self._plane  # noqa: B018 - refuses nodes in line
        still = (self.speeds == 0) | (self.forces == 0)
        if self.deviation[still].any():
            raise ParameterError("deviation: must be 0 where speed or force is 0")

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

    @cached_property
    def rms(self) -> FloatArray:
        """Root mean square of the acceleration at the nodes, m/s^2, shape (n,)."""
        gain = power_gain(to_polynomial(self.ma_lsf), to_polynomial(self.lsf))
        return np.asarray(self.deviation * self.gain * np.sqrt(gain))

    @property
    def triangles(self) -> IntArray:
        """Delaunay triangles of the plane: indices of nodes, shape (m, 3)."""
        return self._plane.triangles

    def locate(self, speeds: FloatArray, forces: FloatArray) -> Places:
        """Locate speeds, m/s, and forces, N, or the nearest points in the hull."""
        return self._plane.locate(np.column_stack([speeds, forces]))

    def spectrum(self, speed: float, force: float, frequency: FloatArray) -> FloatArray:
        """Return the one-sided power density of the acceleration, (m/s^2)^2/Hz.

        Parameters
        ----------
        speed, force : float
            Speed, m/s, and force, N.
        frequency : ndarray
            Up to half the rate, Hz.
        """
        positions = self.locate(np.array([speed]), np.array([force]))
        lsf, ma_lsf = positions.interpolate(self.lsf), positions.interpolate(self.ma_lsf)
        gain = power_gain(*map(to_polynomial, (ma_lsf, lsf)))
        shape = self._shapes(lsf, ma_lsf, frequency)[0]
        return np.asarray(positions.interpolate(self.rms) ** 2 / gain * shape)

    def _shapes(self, lsf: FloatArray, ma_lsf: FloatArray, frequency: FloatArray) -> FloatArray:
        """Return the one-sided power densities of filtered unit white noise, 1/Hz."""

        def response(angles: FloatArray) -> ComplexArray:
            delays = np.outer(np.arange(angles.shape[1] + 1), frequency) / self.rate
            return np.asarray(to_polynomial(angles) @ np.exp(-2j * np.pi * delays))

        return np.asarray(2 / self.rate * np.abs(response(ma_lsf) / response(lsf)) ** 2)

    def at_rate(self, rate: float) -> TextureModel:
        """Return the model for another rate in Hz, with the same spectrum in the common band.

        Each node's filter is autoregressive with the same number of coefficients. It has the
        autocovariance of the spectrum at the new rate.
        """
        if rate == self.rate:
            return self
        check_positive_rate(rate)
        frequency = np.linspace(0.0, rate / 2, SPECTRUM_POINTS + 1)
        known = frequency <= self.rate / 2
        density = np.empty((len(self.speeds), len(frequency)))
        density[:, known] = self._shapes(self.lsf, self.ma_lsf, frequency[known])
        density[:, ~known] = FLOOR * density[:, known].mean(axis=1, keepdims=True)
        order = self.lsf.shape[1] + self.ma_lsf.shape[1]
        polynomials, variances = levinson(np.fft.irfft(density * rate / 2)[:, : order + 1])
        return replace(
            self,
            rate=rate,
            lsf=np.array([from_polynomial(each) for each in polynomials]),
            deviation=self.deviation * self.gain * np.sqrt(variances[:, -1]),
            ma_lsf=np.empty(0),
            gain=np.empty(0),
        )


class _Cells:
    """Texture filters at the centres of equal cells in the plane.

    Attributes
    ----------
    forward, feedback : ndarray, shape ((`CELLS` + 1)^2, order)
        Coefficients without the first, 1.
    deviation : ndarray, shape ((`CELLS` + 1)^2, 3)
        Coefficients whose product with (speed, force, 1) is the innovation's deviation in a cell,
        m/s^2.
    largest : ndarray, shape ((`CELLS` + 1)^2,)
        Maximum of this deviation, for cells that extend into another triangle.
    """

    def __init__(self, model: TextureModel) -> None:
        steps = np.linspace(0.0, 1.0, CELLS + 1)
        speeds, forces = np.meshgrid(steps * model.speeds.max(), steps * model.forces.max())
        positions = model.locate(speeds.ravel(), forces.ravel())
        forward = to_polynomial(positions.interpolate(model.ma_lsf))
        feedback = to_polynomial(positions.interpolate(model.lsf))
        self.forward, self.feedback = forward[:, 1:], feedback[:, 1:]
        # Interpolate the acceleration's RMS, not the innovation's. Between nodes with different
        # spectra, peaks are wider than at either, and the same innovation gives less acceleration.
        # The power is not interpolated either: vibration grows at least in proportion to speed, so
        # linear power from rest to the slowest node is too loud in between, by 41 % in the middle.
        corners = model.rms[positions.corners] / np.sqrt(power_gain(forward, feedback))[:, None]
        self.deviation = np.einsum("mi,mij->mj", corners, positions.affine)
        self.largest = corners.max(axis=1)


@lru_cache(maxsize=32)
def _rendered(model: TextureModel, rate: float) -> tuple[TextureModel, _Cells]:
    """Return a model at a rate, and its filters; cached, as scenes may be switched repeatedly."""
    model = model.at_rate(rate)
    return model, _Cells(model)


class Texture:
    """Acceleration of a tool that slides on a texture, sample by sample.

    Parameters
    ----------
    model : TextureModel
    rate : float
        Samples per second, above twice `SPEED_CORNER`.
    seed : int
        Equal seeds, speeds and forces give equal samples.
    limit : float
        Maximum acceleration, m/s^2.

    Attributes
    ----------
    saturated : int
        Number of samples at the limit.

    Raises
    ------
    ParameterError
        The rate is too low.
    """

    def __init__(self, model: TextureModel, rate: float, seed: int, limit: float = LIMIT) -> None:
        from scipy import signal

        if not rate > 2 * SPEED_CORNER:
            raise ParameterError(f"rate = {rate:g}: must be above {2 * SPEED_CORNER:g} Hz")
        model, self._cells = _rendered(model, rate)
        self._limit = limit
        self._speed = SampleFilter(signal.butter(2, SPEED_CORNER, fs=rate, output="sos"))
        self._noise = _white_noise(seed)
        self._top_speed, self._top_force = float(model.speeds.max()), float(model.forces.max())
        self._enter(0)
        self._outputs = deque([0.0] * len(self._feedback), len(self._feedback))
        self._innovations = deque([0.0] * len(self._forward), len(self._forward))
        self.saturated = 0

    def _enter(self, cell: int) -> None:
        """Use the filter of a cell."""
        self._cell = cell
        self._deviation = self._cells.deviation[cell].tolist()
        self._largest = self._cells.largest[cell].item()
        self._forward = self._cells.forward[cell].tolist()
        self._feedback = self._cells.feedback[cell].tolist()

    def synthesize(self, speed: float, force: float) -> float:
        """Return the next acceleration, m/s^2.

        Parameters
        ----------
        speed : float
            Tangential speed, m/s.
        force : float
            Normal force, N; 0 without contact, when the texture decays.
        """
        speed = min(max(self._speed.process(speed), 0.0), self._top_speed)
        innovation = 0.0
        if force > 0:
            force = min(force, self._top_force)
            row = int(force / self._top_force * CELLS + 0.5)
            cell = row * (CELLS + 1) + int(speed / self._top_speed * CELLS + 0.5)
            if cell != self._cell:
                self._enter(cell)
            by_speed, by_force, offset = self._deviation
            deviation = by_speed * speed + by_force * force + offset
            if deviation > 0:
                innovation = min(deviation, self._largest) * next(self._noise)
        moved = innovation + sum(map(mul, self._forward, self._innovations))
        output: float = moved - sum(map(mul, self._feedback, self._outputs))
        if abs(output) > self._limit:
            self.saturated += 1
            output = math.copysign(self._limit, output)
        self._innovations.appendleft(innovation)
        self._outputs.appendleft(output)
        return output

    def block(self, speeds: FloatArray, forces: FloatArray) -> FloatArray:
        """Return the accelerations that successive calls of `synthesize` would give."""
        return np.array(list(map(self.synthesize, speeds.tolist(), forces.tolist())))


def _white_noise(seed: int) -> Iterator[float]:
    """Yield independent normal numbers of mean 0 and variance 1."""
    random = np.random.default_rng(seed)
    while True:
        yield from random.standard_normal(NOISE_BLOCK).tolist()
