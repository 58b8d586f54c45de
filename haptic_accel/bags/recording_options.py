"""How a bag is recorded: what a user may choose, named as `ros2 bag record` names it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from haptic_accel.core.parameters import Checked, ParameterError, parameter

MCAP, SQLITE3 = "mcap", "sqlite3"
NONE, FILE, MESSAGE = "none", "file", "message"
ZSTD = "zstd"
ZSTD_FAST = "zstd_fast"


@dataclass(frozen=True)
class RecordingOptions(Checked):
    """What is recorded besides the graph's own topics, and in which form."""

    storage: str = parameter(MCAP, "form of the bag", choices=(MCAP, SQLITE3))
    compression_mode: str = parameter(
        NONE,
        "what compression_format compresses: files once they are full, or each message",
        choices=(NONE, FILE, MESSAGE),
    )
    compression_format: str = parameter(ZSTD, "of compression_mode", choices=(ZSTD,))
    storage_preset_profile: str = parameter(
        NONE, "zstd_fast compresses the chunks of an MCAP file", choices=(NONE, ZSTD_FAST)
    )
    max_bag_size: int = parameter(
        0, "size from which another file follows, bytes; 0 for one file", low=0
    )
    max_bag_duration: float = parameter(
        0.0, "time after which another file follows; 0 for one file", unit="s", low=0.0, high=1e6
    )
    topics: str = parameter("", "topics to record besides the graph's own, with commas between")
    regex: str = parameter("", "regular expression; topics it is found in are recorded too")
    exclude_regex: str = parameter("", "regular expression; what regex found is not recorded")
    start_paused: bool = parameter(False, "whether to wait for haptic-accel record start")

    def __post_init__(self) -> None:
        """Check all fields, and whether they go together.

        Raises
        ------
        ParameterError
            A value is not allowed, or not with the others.
        """
        super().__post_init__()
        for name in ("regex", "exclude_regex"):
            _check_expression(name, getattr(self, name))
        if self.exclude_regex and not self.regex:
            raise ParameterError(f"exclude_regex = {self.exclude_regex!r}: must come with regex")
        if self.storage == SQLITE3 and self.storage_preset_profile != NONE:
            raise ParameterError(
                f"storage_preset_profile = {self.storage_preset_profile!r}: must be {NONE} with"
                f" storage:={SQLITE3}"
            )

    @property
    def named_topics(self) -> list[str]:
        """The words of `topics`."""
        return self.topics.replace(",", " ").split()

    def finds(self, topic: str) -> bool:
        """Whether the expressions ask for a topic, by its full name."""
        if not self.regex or not re.search(self.regex, topic):
            return False
        return not (self.exclude_regex and re.search(self.exclude_regex, topic))


def _check_expression(name: str, expression: str) -> None:
    try:
        re.compile(expression)
    except re.error as error:
        raise ParameterError(
            f"{name} = {expression!r}: must be a regular expression: {error}"
        ) from None
