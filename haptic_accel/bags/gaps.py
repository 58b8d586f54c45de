"""Samples that a topic's stamps show to be missing."""

from __future__ import annotations

from haptic_accel.core.cdr import STAMP_BYTES, unpack_stamps
from haptic_accel.core.sampling import missing_samples

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
        self._stamps.append(message[STAMP_BYTES])

    def count(self) -> None:
        """Look through what was noted."""
        if len(self._stamps) < ENOUGH:
            return
        self.missing += missing_samples(unpack_stamps(b"".join(self._stamps)))
        del self._stamps[:-1]

    def forget(self) -> None:
        """Begin anew: what comes does not follow what came."""
        self.count()
        self._stamps.clear()
