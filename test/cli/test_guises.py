# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Changed bags through each verb that reads bags: the same figures, or a line; no traceback."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from guises import BAG_CHANGES, Kind, Made, right_bag, write_form
from haptic_accel.core.parameters import warn_once
from verbs import status_of

VERBS = {
    "replay": ("replay", "bag", "--lockstep"),
    "info": ("bag", "info", "bag"),
    "repair": ("bag", "repair", "bag"),
    "build": ("texture", "build", "bag", "--out", "out.yaml"),
    "identify": ("identify", "--from", "bag", "--out", "out"),
}
"""Verbs that read a bag, with their words; `analyze` is tested without its plots elsewhere."""

BAGS: list[Made] = [
    [],
    [("split", 0.4, 0.0), ("clock set back", 0.5, 0.1), ("renamed", 0.0, 0.5)],
    [("a stray stamp", 0.5, 0.0), ("other storage", 0.0, 0.0)],
    [("by topic", 0.0, 0.0), ("some messages twice", 0.3, 0.5), ("no metadata", 0.0, 0.0)],
    [("split", 0.4, 0.0), ("cut off", 0.0, 0.5)],
    [("cut off", 0.0, 1.0)],
]


@pytest.mark.parametrize("verb", VERBS)
def test_each_verb_has_the_same_figures_or_a_line(
    tmp_path: Path,
    verb: str,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = []
    for number, made in enumerate(BAGS):
        (place := tmp_path / str(number)).mkdir()
        monkeypatch.chdir(place)
        write_form(Kind(right_bag, BAG_CHANGES, NotImplemented).changed(made, place), place)
        warn_once.cache_clear()
        caplog.clear()
        status = status_of(*VERBS[verb], "--json", "figures.json")
        printed = capfd.readouterr()
        said = (printed.out if status else "") + printed.err + "\n".join(caplog.messages)
        assert status in (0, 1, 2)
        assert "Traceback" not in said
        assert len(set(caplog.messages)) == len(caplog.messages)
        figures = json.loads(Path("figures.json").read_text()) if status == 0 else None
        found.append((status, figures))
        assert (status, figures) == found[0] or said or "problems" in str(figures)
