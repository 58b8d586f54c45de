# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options of a recording, named as in `ros2 bag record`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter

NONE = "none"
ZSTD_FAST = "zstd_fast"


@dataclass(frozen=True)
class RecordingOptions(Checked):
    """Format of a bag, and additional topics."""

    storage_preset_profile: str = parameter(
        NONE,
        "preset of the MCAP file's storage; zstd_fast compresses its chunks",
        choices=(NONE, ZSTD_FAST),
    )
    max_bag_size: int = parameter(
        0, "file size at which the bag is split; 0 for one file", "bytes", low=0
    )
    max_bag_duration: float = parameter(
        0.0, "duration after which the bag is split; 0 for one file", unit="s", low=0.0, high=1e6
    )
    topics: str = parameter("", "topics to record besides the graph's own, separated by commas")
    regex: str = parameter("", "regular expression of further topics to record")
    exclude_regex: str = parameter(
        "", "regular expression of topics to leave out of those that regex finds"
    )
    start_paused: bool = parameter(False, "wait for haptic-accel record start before recording")

    def __post_init__(self) -> None:
        """Check all fields and their combination.

        Raises
        ------
        ParameterError
            A value is invalid, alone or in combination.
        """
        super().__post_init__()
        for name in ("regex", "exclude_regex"):
            try:
                re.compile(expression := getattr(self, name))
            except re.error as error:
                raise ParameterError(
                    f"{name} = {expression!r}: must be a regular expression: {error}"
                ) from None
        if self.exclude_regex and not self.regex:
            raise ParameterError(f"exclude_regex = {self.exclude_regex!r}: must come with regex")

    @property
    def named_topics(self) -> list[str]:
        """Topic names in `topics`."""
        return self.topics.replace(",", " ").split()

    def finds(self, topic: str) -> bool:
        """Return whether the expressions select a topic by its full name."""
        if not self.regex or not re.search(self.regex, topic):
            return False
        return not (self.exclude_regex and re.search(self.exclude_regex, topic))
