# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import re

import pytest

from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.parameters import ParameterError


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"max_bag_size": -1}, "max_bag_size = -1"),
        ({"regex": "("}, "regex = '(': must be a regular expression"),
        ({"exclude_regex": "x"}, "exclude_regex = 'x': must come with regex"),
        ({"storage_preset_profile": "lz4"}, "must be one of none, zstd_fast"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(given: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match=rf"^[^\n]*{re.escape(named)}[^\n]*$"):
        RecordingOptions(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["/a,b", "/a b", " /a, b ,"])
def test_topics_are_words(text: str) -> None:
    assert RecordingOptions(topics=text).named_topics == ["/a", "b"]


@pytest.mark.parametrize(
    ("topic", "found"),
    [("/camera/image", True), ("/left/camera", True), ("/camera/info", False), ("/arm", False)],
)
def test_an_expression_is_searched_for_and_another_excludes(topic: str, found: bool) -> None:
    assert RecordingOptions(regex="camera", exclude_regex="info$").finds(topic) == found
    assert not RecordingOptions().finds(topic)
