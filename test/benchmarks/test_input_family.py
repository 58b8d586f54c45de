# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The family of inputs: its ranges, and that it is the same everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from input_family import CREST, ENVELOPES, MEMBERS, RMS, SPECTRA, member

SECONDS, RATE = 4.0, 1000.0


def test_every_spectrum_has_every_envelope_in_both_halves() -> None:
    found = [member(number, 0.5, RATE) for number in range(MEMBERS)]
    kinds = {(tuple(each.name.split(", ")[:2]), each.reported) for each in found}
    assert len(kinds) == 2 * len(SPECTRA) * len(ENVELOPES)
    assert sum(each.reported for each in found) == MEMBERS // 2


@pytest.mark.parametrize("number", range(0, MEMBERS, 7))
def test_level_and_crest_are_within_their_ranges(number: int) -> None:
    found = member(number, SECONDS, RATE).acceleration
    assert found.shape == (round(SECONDS * RATE),)
    assert np.isfinite(found).all()
    rms = np.sqrt(np.mean(found**2))
    assert RMS[0] / 2 <= rms <= RMS[1]  # clipping may take away some of it
    assert np.abs(found).max() <= 2.0 * CREST * rms


def test_a_member_is_the_same_again_and_differs_from_the_next() -> None:
    one, same, other = (member(n, SECONDS, RATE).acceleration for n in (12, 12, 13))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("rate", [500.0, 4000.0])
def test_a_member_keeps_its_spectrum_at_other_rates(rate: float) -> None:
    # A line at the same frequency, whatever the rate.
    peaks = []
    for each in (RATE, rate):
        found = member(8, SECONDS, each).acceleration
        power = np.abs(np.fft.rfft(found * np.hanning(len(found))))
        peaks.append(np.argmax(power) / SECONDS)
    assert peaks[0] == pytest.approx(peaks[1], rel=0.05)
