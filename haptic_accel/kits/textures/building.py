# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texture models from recordings of a tool that slides on a surface.

Recordings are divided into stationary segments by exact dynamic programming, with the minimum
description length of Davis, Lee and Rodriguez-Yam (2006). Segments with similar speed and force
share a node of the model (Culbertson, Unwin and Kuchenbecker 2014). The number of nodes follows
from cross-validation. Within a node, and beyond all of them, power grows with powers of speed and
force that are fitted to all segments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from haptic_accel import FloatArray, ParameterError, Provenance, TextureModel, core
from haptic_accel.core.parameters import check_positive_rate
from haptic_accel.core.sampling import BoolArray, IntArray

RENDER_RATE = 1000.0
"""Sampling rate of fitted models, Hz: that of the servo loop, and twice the bandwidth of touch."""

LOWEST_RATE = 500.0
"""Minimum sampling rate of a recording, Hz; at lower rates most of the perceptible signal is
missing."""

BLOCK = 0.025
"""Duration of the blocks in a segment, s."""

SHORTEST, LONGEST = 2, 40
"""Number of blocks in a segment. Shorter segments lack data for a spectrum; longer segments slow
the search."""

WIDEST = 0.15
"""Maximum range of speed and force in a segment, relative to the largest values of all
recordings."""

SLOWEST = 5e-3
"""Speed below which the tool counts as at rest, m/s."""

LIGHTEST = 0.05
"""Force below which the tool counts as out of contact, N."""

LANDING = 4
"""Number of blocks ignored after the start of contact, as a tap's vibration lasts about 0.1 s."""

QUIETEST = 1e-3
"""White noise added to segments, m/s^2: the resolution of 16 bits at 5 g. With the noise, silence
and pure tones, which are exactly predictable, have a finite description length."""

LARGEST_ORDER = 20
"""Maximum order of a model, as in the Penn Haptic Texture Toolkit."""

PILOT_ORDER = 8
"""Order for finding segments, before the model's order is known."""

FLAT = 0.01
"""Minimum reduction of Akaike's criterion per sample for a higher order: 0.04 dB of prediction
error."""

CLOSE = 0.02
"""Distance, relative to the largest speed and force, within which segments share a node, and the
edge of the segments needs no separate node: the texture hardly changes over this distance, but the
segments' noise does."""

MOST_NODES = 64
"""Maximum number of measured nodes; the Penn Haptic Texture Toolkit has 25 to 57 nodes of all
kinds."""

PRIOR = 2.0
"""Standard deviation of the zero-mean prior of the exponents with which power grows with speed and
force; vibration proportional to speed has the exponent 2. The fit is Bayesian linear regression: a
recording at one speed and force gives exponents near 0."""

BETTER = 0.9
"""Maximum error relative to that of a constant texture for a model that follows speed and force.
With segments at one condition, ratios from 0.94 to 1.08 occur."""

BAND = (20.0, 450.0)
"""Frequency band for comparing spectra, Hz."""

LAGS = 64
"""Number of lags of the compared spectra; Parzen's window makes their resolution 29 Hz at 1
kHz."""

GRID = 2048
"""Length of the discrete Fourier transform of the compared spectra."""


@dataclass(frozen=True)
class Recording:
    """Recording of a tool that slides on a surface; all arrays of shape (n,).

    Attributes
    ----------
    name : str
        Name for messages, from the file.
    rate : float
        Samples per second.
    speed : ndarray
        Tangential speed, m/s; its sign is not used.
    force : ndarray
        Normal force, N; positive if the tool presses.
    acceleration : ndarray
        Acceleration of the tool along one axis, m/s^2.

    Raises
    ------
    ParameterError
        Arrays differ in length, values are not finite, the rate is too low, or the acceleration is
        constant.
    """

    name: str
    rate: float
    speed: FloatArray
    force: FloatArray
    acceleration: FloatArray

    def __post_init__(self) -> None:
        """Check the recording."""
        check_positive_rate(self.rate)
        if self.rate < LOWEST_RATE:
            raise ParameterError(
                f"{self.name}: rate = {self.rate:g}: must be at least {LOWEST_RATE:g} Hz"
            )
        for what in ("speed", "force", "acceleration"):
            values = getattr(self, what)
            if values.shape != (len(self.acceleration),):
                raise ParameterError(
                    f"{self.name}: {what}: has shape {values.shape}, must have"
                    f" ({len(self.acceleration)},)"
                )
            if not np.isfinite(values).all():
                raise ParameterError(f"{self.name}: {what}: must be finite numbers")
        if not np.diff(self.acceleration).any():
            raise ParameterError(f"{self.name}: acceleration: must not be constant")

    def at_rate(self, rate: float) -> Recording:
        """Return the recording at a lower rate, without the hand's own motion.

        The acceleration keeps all frequencies below half the new rate. The transition band of a
        filter would be a gap in the spectrum, which takes up the order of an autoregressive model.
        """
        from scipy import signal

        own = core.without_hand_motion(self.acceleration, core.HIGH_PASS_FREQUENCY, self.rate)
        length = round(len(own) * rate / self.rate)
        acceleration = np.asarray(signal.resample(own, length)) if rate != self.rate else own
        old, new = np.arange(len(own)) / self.rate, np.arange(length) / rate
        speed, force = (np.interp(new, old, each) for each in (np.abs(self.speed), self.force))
        return Recording(self.name, rate, speed, force, acceleration)


@dataclass(frozen=True)
class Segment:
    """Stationary section of a recording.

    Attributes
    ----------
    recording : str
    begin, end : float
        Start and end in the recording, s.
    speed, force : float
        Medians, m/s and N.
    samples : int
    products : ndarray, shape (LAGS,)
        Sum of the products of samples with distances 0, 1, ..., (m/s^2)^2.
    """

    recording: str
    begin: float
    end: float
    speed: float
    force: float
    samples: int
    products: FloatArray


@dataclass(frozen=True)
class Refusal:
    """Unused section of a recording: start and end in s, and the reason."""

    recording: str
    begin: float
    end: float
    reason: str


@dataclass(frozen=True)
class HeldOut:
    """Segments at a node, compared with a model built without them.

    Attributes
    ----------
    speed, force : float
        Means over the segments, m/s and N.
    seconds : float
        Total duration of the segments.
    frequency : ndarray, shape (k,)
        Hz.
    measured, modelled : ndarray, shape (k,)
        Power spectral densities, (m/s^2)^2/Hz.
    rms, modelled_rms : float
        Root mean square over all frequencies, m/s^2.
    """

    speed: float
    force: float
    seconds: float
    frequency: FloatArray
    measured: FloatArray
    modelled: FloatArray
    rms: float
    modelled_rms: float

    @property
    def distance(self) -> float:
        """Log-spectral distance within `BAND`, dB."""
        within = _within_band(self.frequency)
        ratio = self.measured[within] / self.modelled[within]
        return float(np.sqrt(np.mean((10 * np.log10(ratio)) ** 2)))


@dataclass(frozen=True)
class Following:
    """Errors of a model, and of a constant texture, for single held-out segments.

    The constant texture has the mean spectrum of the segments that the model was built from, as an
    autoregressive model of the same order.

    Attributes
    ----------
    rms_error, constant_rms_error : float
        Typical error of the RMS, relative: root mean square of the logarithm of the ratio, and
        the ratio minus 1 that has this logarithm.
    distance, constant_distance : float
        Mean log-spectral distance within `BAND`, dB; 2 to 4 for noise from equal spectra, as
        segments are short.
    """

    rms_error: float
    distance: float
    constant_rms_error: float
    constant_distance: float

    @property
    def better(self) -> bool:
        """True if both errors of the model are below `BETTER` times those of a constant one."""
        return (
            self.rms_error < BETTER * self.constant_rms_error
            and self.distance < BETTER * self.constant_distance
        )


@dataclass(frozen=True)
class Built:
    """Texture model with information on its construction.

    Attributes
    ----------
    model : TextureModel
    order : int
    measured : int
        Number of nodes with recorded segments; these come first.
    segments : tuple of Segment
    held_out : tuple of HeldOut
        Comparisons of each half of the segments with a model of the other half.
    following : Following
        Errors for single held-out segments.
    coverage : float
        Fraction of the plane, from rest to the largest speed and force, within the hull of the
        segments.
    refused : tuple of Refusal
    """

    model: TextureModel
    order: int
    measured: int
    segments: tuple[Segment, ...]
    held_out: tuple[HeldOut, ...]
    following: Following
    coverage: float
    refused: tuple[Refusal, ...]

    @property
    def distance(self) -> float:
        """Log-spectral distance of held-out segments, dB, weighted by duration."""
        weights = [each.seconds for each in self.held_out]
        return float(np.average([each.distance for each in self.held_out], weights=weights))


def build(name: str, recordings: Sequence[Recording], provenance: Provenance) -> Built:
    """Build a texture model from recordings.

    Parameters
    ----------
    name : str
        Name of the texture.
    recordings : sequence of Recording
    provenance : Provenance

    Raises
    ------
    ParameterError
        The recordings contain fewer than two segments.
    """
    rate = min([RENDER_RATE, *(each.rate for each in recordings)])
    alike = [each.at_rate(rate) for each in recordings]
    largest = np.max([(each.speed.max(), each.force.max()) for each in alike], axis=0)
    parts = [part for each in alike for part in _parts(each, largest)]
    segments = [part for part in parts if isinstance(part, Segment)]
    refused = [part for part in parts if isinstance(part, Refusal)]
    if len(segments) < 2:
        reasons = ", ".join(dict.fromkeys(each.reason for each in refused)) or "too short"
        raise ParameterError(
            f"{', '.join(each.name for each in recordings)}: has {len(segments)} segments of"
            f" contact and motion, must have 2 at least ({reasons})"
        )
    halves = segments[::2], segments[1::2]
    folds = [(halves[0], halves[1]), (halves[1], halves[0])]
    most = min(len(halves[1]), MOST_NODES)
    order = _order(_groups(segments, most, largest))
    plane = _Plane(name, rate, order, largest, provenance)
    counts = dict.fromkeys(np.geomspace(1, most, 12).round().astype(int).tolist())
    count = min(counts, key=lambda n: sum(plane.surprise(own, n, out) for own, out in folds))
    held_out = [each for own, out in folds for each in plane.compared(own, count, out)]
    return Built(
        plane.model(segments, count),
        order,
        len(_groups(segments, count, largest)),
        tuple(segments),
        tuple(held_out),
        plane.following(folds, count),
        _hull(segments, largest)[1],
        tuple(refused),
    )


# Segments


def _parts(recording: Recording, largest: FloatArray) -> Iterator[Segment | Refusal]:
    """Yield the segments of a recording, and its unused sections."""
    size = round(BLOCK * recording.rate)
    count = len(recording.speed) // size
    medians = np.array(
        [
            np.median(each[: count * size].reshape(count, size), axis=1)
            for each in (recording.speed, recording.force)
        ]
    )
    reasons = _reasons(*medians)
    for first, last in pairwise(np.flatnonzero(np.diff(reasons, prepend=-1, append=-1)).tolist()):
        reason = _REASONS[reasons[first]]
        if not reason and last - first < SHORTEST:
            reason = f"shorter than {SHORTEST * BLOCK:g} s"
        if reason:
            yield Refusal(recording.name, first * BLOCK, last * BLOCK, reason)
            continue
        samples = recording.acceleration[first * size : last * size]
        labels = medians[:, first:last] / largest[:, None]
        for start, stop in _stationary(samples, size, labels):
            yield _segment(recording, first + start, first + stop, size)


def _segment(recording: Recording, first: int, last: int, size: int) -> Segment:
    """Return the segment of a range of blocks."""
    own = slice(first * size, last * size)
    speed, force = (float(np.median(each[own])) for each in (recording.speed, recording.force))
    products = _products(recording.acceleration[own])
    span = (first * BLOCK, last * BLOCK)
    return Segment(recording.name, *span, speed, force, (last - first) * size, products)


_REASONS = ("", "out of contact", "at rest", "landing")


def _reasons(speed: FloatArray, force: FloatArray) -> IntArray:
    """Return for each block the index in `_REASONS` of its rejection, 0 for none."""
    reasons = np.where(force < LIGHTEST, 1, np.where(speed < SLOWEST, 2, 0))
    for start in np.flatnonzero((force[:-1] < LIGHTEST) & (force[1:] >= LIGHTEST)) + 1:
        landing = slice(start, start + LANDING)
        reasons[landing] = np.where(reasons[landing] == 0, 3, reasons[landing])
    return reasons


def _products(samples: FloatArray) -> FloatArray:
    """Return the sums of products of samples with distances from 0 to LAGS - 1."""
    padded = np.concatenate([samples, np.zeros(LAGS - 1)])
    products = np.asarray(sliding_window_view(padded, LAGS).T @ samples)
    products[0] += len(samples) * QUIETEST**2
    return products


def _stationary(samples: FloatArray, size: int, labels: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield the first block, and the block after the last, of each stationary segment.

    The sum of all segments' description lengths is minimised exactly.

    Parameters
    ----------
    samples : ndarray, shape (blocks * size,)
    size : int
        Number of samples in a block.
    labels : ndarray, shape (2, blocks)
        Speed and force, relative to their largest values.
    """
    count, lags = len(samples) // size, PILOT_ORDER + 1
    ahead = sliding_window_view(np.concatenate([samples, np.zeros(lags - 1)]), lags)
    terms = ahead * samples[:, None]
    total = np.zeros((count + 1, lags))
    total[1:] = np.cumsum(terms.reshape(count, size, lags).sum(axis=1), axis=0)
    # Products of a sample before and a sample after a block's end, missing in a segment that ends
    # there.
    reach = terms.reshape(count, size, lags)[:, size - lags + 1 :]
    left = np.arange(lags - 1, 0, -1)[:, None]
    crossing = (reach * (np.arange(lags) >= left)).sum(axis=1)
    best, begin = np.full(count + 1, np.inf), np.zeros(count + 1, dtype=int)
    best[0] = 0.0
    for end in range(SHORTEST, count + 1):
        starts = np.arange(max(0, end - LONGEST), end - SHORTEST + 1)
        window = labels[:, starts[0] : end][:, ::-1]
        high, low = (each.accumulate(window, axis=1) for each in (np.maximum, np.minimum))
        wide = ((high - low).max(axis=0)[::-1][: len(starts)] > WIDEST) & (end - starts > SHORTEST)
        products = total[end] - total[starts] - crossing[end - 1]
        lengths = best[starts] + _description(products, (end - starts) * size, len(samples))
        lengths[wide] = np.inf
        index = int(np.argmin(lengths))
        best[end], begin[end] = lengths[index], starts[index]
    ends = [count]
    while ends[-1] > 0:
        ends.append(int(begin[ends[-1]]))
    edges = ends[::-1]
    yield from pairwise(edges)


def _description(products: FloatArray, samples: IntArray, total: int) -> FloatArray:
    """Return the description length of segments in nats, from their products and lengths."""
    covariance = products / samples[:, None]
    covariance[:, 0] += QUIETEST**2
    _, variances = core.levinson(covariance)
    fit = samples / 2 * np.log(2 * np.pi * variances[:, -1])
    return np.asarray((PILOT_ORDER + 2) / 2 * np.log(samples) + np.log(total) + fit)


def _order(groups: Sequence[Sequence[Segment]]) -> int:
    """Return the order at which Akaike's corrected criterion of all groups becomes flat.

    From single segments of a tenth of a second, the order would be too low for the nodes.
    """
    samples = np.array([sum(each.samples for each in group) for group in groups], dtype=float)
    covariance = np.array([_covariance(group)[: LARGEST_ORDER + 1] for group in groups])
    _, variances = core.levinson(covariance)
    orders = np.arange(LARGEST_ORDER + 1)
    penalty = 2 * (orders + 1) * samples[:, None] / (samples[:, None] - orders - 2)
    criterion = (samples[:, None] * np.log(variances) + penalty).sum(axis=0) / samples.sum()
    flat = np.flatnonzero(criterion[1:] <= criterion[1:].min() + FLAT)
    return int(flat[0]) + 1


# The plane of speed and force


@dataclass(frozen=True)
class _Plane:
    """Values common to all models of a set of recordings."""

    name: str
    rate: float
    order: int
    largest: FloatArray
    provenance: Provenance

    def model(self, segments: Sequence[Segment], count: int) -> TextureModel:
        """Return a model of some segments with a number of measured nodes, and a frame of nodes.

        Nodes at the edge of the segments, and of the frame, have the spectrum of the nearest
        measured node and follow the power law. Without nodes at the edge, the texture would fade
        below the mean force of the lightest node, within the recorded range.
        """
        groups = _groups(segments, count, self.largest)
        labels = np.array([_label(group) for group in groups])
        covariance = np.array([_covariance(group) for group in groups])[:, : self.order + 1]
        growth = _Growth(segments)
        expected = np.array([growth.mean_power(group) for group in groups])
        # A group's mean power differs from the power at its mean speed and force.
        covariance *= (growth.power(labels) / expected)[:, None]
        polynomials, variances = core.levinson(covariance)
        lsf = np.array([core.from_polynomial(each) for each in polynomials])
        deviation = np.sqrt(variances[:, -1])
        around = np.concatenate([_edge(segments, labels, self.largest), FRAME * self.largest])
        offsets = (around[:, None] - labels) / self.largest
        near = np.argmin((offsets**2).sum(axis=-1), axis=1)
        still = (around == 0).any(axis=1)
        louder = np.sqrt(growth.power(around) / growth.power(labels[near]))
        speeds, forces = np.concatenate([labels, around]).T
        return TextureModel(
            self.name,
            self.rate,
            speeds,
            forces,
            np.concatenate([lsf, lsf[near]]),
            np.concatenate([deviation, np.where(still, 0.0, louder * deviation[near])]),
            provenance=self.provenance,
        )

    def surprise(self, known: Sequence[Segment], count: int, held_out: Sequence[Segment]) -> float:
        """Return Whittle's negative log-likelihood of held-out segments for a model, nats."""
        model = self.model(known, count)
        total = 0.0
        for each in held_out:
            frequency, measured, modelled = _densities([each], model)
            within = _within_band(frequency)
            ratio = measured[within] / modelled[within]
            total += each.samples * float(np.mean(ratio + np.log(modelled[within])))
        return total

    def compared(
        self, known: Sequence[Segment], count: int, held_out: Sequence[Segment]
    ) -> Iterator[HeldOut]:
        """Yield groups of held-out segments and the spectra of a model for them."""
        model = self.model(known, count)
        for group in _groups(held_out, count, self.largest):
            frequency, measured, modelled = _densities(group, model)
            rms = [float(np.sqrt(each.mean() * self.rate / 2)) for each in (measured, modelled)]
            seconds = sum(each.samples for each in group) / self.rate
            yield HeldOut(*_label(group), seconds, frequency, measured, modelled, *rms)

    def following(
        self, folds: Sequence[tuple[Sequence[Segment], Sequence[Segment]]], count: int
    ) -> Following:
        """Return the errors for single segments of the second part of each fold."""
        weights, errors = [], []
        for known, held_out in folds:
            model = self.model(known, count)
            polynomial, variances = core.levinson(_covariance(known)[: self.order + 1])
            alike = variances[-1] * core.autocovariance(polynomial, LAGS - 1)
            for each in held_out:
                frequency, measured, modelled = _densities([each], model)
                seen = np.maximum(0, 1 - np.arange(LAGS) / each.samples)
                constant = _smoothed(alike * seen, self.rate)
                within = _within_band(frequency)
                ratios = np.log(np.array([modelled, constant]) / measured)[:, within]
                levels = np.log(
                    [np.sum(density[within]) for density in (modelled, constant, measured)]
                )
                decibels = 10 / np.log(10) * np.sqrt(np.mean(ratios**2, axis=1))
                errors.append([*((levels[:2] - levels[2]) / 2) ** 2, *decibels])
                weights.append(each.samples)
        own, others, *distances = np.average(errors, axis=0, weights=weights).tolist()
        rms_errors = [float(np.expm1(np.sqrt(each))) for each in (own, others)]
        return Following(rms_errors[0], distances[0], rms_errors[1], distances[1])


class _Growth:
    """Power law of speed and force, fitted to the powers of segments.

    Attributes
    ----------
    exponents : ndarray, shape (2,)
        Exponents of speed and force; at least 0, as no texture is louder at rest.
    """

    def __init__(self, segments: Sequence[Segment]) -> None:
        weights = np.array([each.samples for each in segments], dtype=float)
        weights /= weights.mean()
        points = np.log([(each.speed, each.force) for each in segments])
        powers = np.log([each.products[0] / each.samples for each in segments])
        points -= np.average(points, axis=0, weights=weights)
        powers -= np.average(powers, weights=weights)
        root = np.sqrt(weights)
        points, powers = points * root[:, None], powers * root
        unexplained = powers - points @ np.linalg.lstsq(points, powers)[0]
        noise = float(unexplained @ unexplained) / max(len(segments) - 3, 1)
        doubt = noise / PRIOR**2 * np.eye(2)
        # Least squares: without noise and at a single force, the matrix is singular.
        fitted = np.linalg.lstsq(points.T @ points + doubt, points.T @ powers)[0]
        self.exponents = np.maximum(fitted, 0.0)

    def power(self, points: FloatArray) -> FloatArray:
        """Return the relative power at speeds, m/s, and forces, N: shape (n,) for (n, 2)."""
        return np.asarray(np.prod(points**self.exponents, axis=1))

    def mean_power(self, group: Sequence[Segment]) -> float:
        """Return the mean relative power over segments."""
        powers = self.power(np.array([(each.speed, each.force) for each in group]))
        return float(np.average(powers, weights=[each.samples for each in group]))


FRAME = np.array([(0, 0), (1, 0), (0, 1), (1, 0.5), (0.5, 1), (1, 1)])
"""Frame nodes around the measured nodes, relative to the largest speed and force. They are silent
where speed or force is 0, and follow the nearest measured node elsewhere. A circle through the
three silent nodes contains the whole plane, so they never form a triangle."""


def _groups(segments: Sequence[Segment], count: int, largest: FloatArray) -> list[list[Segment]]:
    """Return groups of segments with similar speed and force, by Ward's criterion."""
    from scipy.cluster.hierarchy import fcluster, linkage

    if len(segments) == 1:
        return [list(segments)]
    points = np.array([(each.speed, each.force) for each in segments]) / largest
    tree = linkage(points, "ward")
    apart = 1 + int(np.count_nonzero(tree[:, 2] > CLOSE))
    numbers = fcluster(tree, min(count, apart), "maxclust")
    return [[s for s, n in zip(segments, numbers, strict=True) if n == k] for k in set(numbers)]


def _label(group: Sequence[Segment]) -> tuple[float, float]:
    """Return the mean speed and force of segments."""
    weights = [each.samples for each in group]
    speed, force = np.average(
        [(each.speed, each.force) for each in group], axis=0, weights=weights
    )
    return float(speed), float(force)


def _covariance(group: Sequence[Segment]) -> FloatArray:
    """Return the biased autocovariance of segments."""
    samples = sum(each.samples for each in group)
    return np.asarray(np.sum([each.products for each in group], axis=0) / samples)


def _densities(
    group: Sequence[Segment], model: TextureModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return frequencies, and the mean power densities of segments and of a model for them.

    Both have the resolution of `LAGS` samples; the model's is for segments of equal length.
    """
    samples = np.array([each.samples for each in group])
    frequency = np.asarray(np.fft.rfftfreq(GRID, 1 / model.rate), dtype=np.float64)
    own = np.array([model.spectrum(each.speed, each.force, frequency) for each in group])
    mean = np.average(own, axis=0, weights=samples)
    shown = np.average(
        np.maximum(0, 1 - np.arange(LAGS) / samples[:, None]), axis=0, weights=samples
    )
    exact = np.fft.irfft(mean * model.rate / 2)[:LAGS]
    measured, modelled = (
        _smoothed(each, model.rate) for each in (_covariance(group), exact * shown)
    )
    return frequency, measured, modelled


def _smoothed(covariance: FloatArray, rate: float) -> FloatArray:
    """Return the power density of `LAGS` autocovariances at the frequencies of `GRID`."""
    from scipy.signal.windows import parzen

    covariance = covariance * parzen(2 * LAGS - 1)[LAGS - 1 :]
    padded = np.concatenate([covariance, np.zeros(GRID + 1 - 2 * LAGS), covariance[:0:-1]])
    return np.asarray(np.fft.rfft(padded).real * 2 / rate)


def _within_band(frequency: FloatArray) -> BoolArray:
    return np.asarray((frequency >= BAND[0]) & (frequency <= BAND[1]))


def _edge(segments: Sequence[Segment], labels: FloatArray, largest: FloatArray) -> FloatArray:
    """Return the corners of the segments' hull that are not at a label, shape (n, 2)."""
    corners = _hull(segments, largest)[0]
    away = np.abs(corners[:, None] - labels / largest).max(axis=-1).min(axis=-1, initial=np.inf)
    return np.asarray(corners[away > CLOSE] * largest)


def _hull(segments: Sequence[Segment], largest: FloatArray) -> tuple[FloatArray, float]:
    """Return corners of the hull of segments, relative to the largest values, and its area.

    The hull of segments at one speed, or one force, is a line.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.array([(each.speed, each.force) for each in segments]) / largest
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # fewer than three segments, or collinear ones
        order = np.lexsort(points.T)
        return points[order[[0, -1]]], 0.0
    return points[hull.vertices], float(hull.volume)
