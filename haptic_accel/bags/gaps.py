"""Samples that a topic's stamps show to be missing."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.sampling import NANOSECONDS, missing_samples

STAMP = slice(4, 12)
"""Where a serialised message with a header has its stamp: behind the encapsulation, s and ns,
four bytes each (CDR, little endian)."""

ENOUGH = 20
"""Stamps from which a topic's period is known."""


class StampGaps:
    """Counts samples missing between the stamps of one topic.

    Attributes
    ----------
    missing : int
        How many so far.
    """

    def __init__(self) -> None:
        self._stamps: list[bytes] = []
        self.missing = 0

    def take(self, message: bytes) -> None:
        """Note a serialised message's stamp."""
        self._stamps.append(message[STAMP])

    def count(self) -> None:
        """Look through what was noted."""
        if len(self._stamps) < ENOUGH:
            return
        whole, rest = np.frombuffer(b"".join(self._stamps), "<u4").reshape(-1, 2).T
        self.missing += missing_samples(whole.astype(np.int64) * NANOSECONDS + rest)
        del self._stamps[:-1]

    def forget(self) -> None:
        """Begin anew: what comes does not follow what came."""
        self.count()
        self._stamps.clear()
