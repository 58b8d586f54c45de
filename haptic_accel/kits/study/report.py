# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Analysis of a study, and its report as a page, figures and tidy tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from haptic_accel.analysis import csv_text, page_provenance, pictures, plots
from haptic_accel.core.evaluation.statistics import CONFIDENCE
from haptic_accel.core.parameters import defined
from haptic_accel.kits.study import results as findings
from haptic_accel.kits.study.planned_tests import PlannedResult, counted, planned_tests
from haptic_accel.kits.study.protocol import Protocol
from haptic_accel.kits.study.tables import SIMULATED, Tables, exclusions, tables, titled
from haptic_accel.kits.study.trials import SessionRecord
from haptic_accel.pages import write

PAGE = "index.html"

PEOPLE = (
    *("participant", "observer", "ended", "main_trials", "counted_trials", "left_out_percent"),
    *("catch_correct_percent", "exposure_m_s2"),
)
"""Columns of the sessions on the page."""


@dataclass(frozen=True)
class StudyResult:
    """Analysis of a study.

    Attributes
    ----------
    protocol : Protocol
    tables : Tables
        All attempts of all participants.
    excluded : dict of str
        Broken rules by excluded participant.
    planned : tuple of PlannedResult
    results : tuple of Result
        Planned tests, then exploratory results, then delivered stimuli.
    """

    protocol: Protocol
    tables: Tables
    excluded: Mapping[str, str]
    planned: tuple[PlannedResult, ...]
    results: tuple[findings.Result, ...]


def analyse_study(protocol: Protocol, sessions: Sequence[SessionRecord]) -> StudyResult:
    """Analyse the sessions of a study by its protocol; titles mention simulated observers."""
    protocol = titled(protocol, sessions)
    found, trials = tables(protocol, sessions), counted(protocol, sessions)
    planned = tuple(planned_tests(protocol, sessions))
    results = (
        *findings.planned_results(planned),
        *findings.exploratory_results(protocol, trials),
        *findings.delivered_results(found),
    )
    if any(each.simulated for each in sessions):
        results = tuple(
            replace(
                each,
                title=f"{each.title} (simulated observers)",
                rows=[row | {"observer": SIMULATED} for row in each.rows],
            )
            for each in results
        )
    return StudyResult(protocol, found, exclusions(protocol, sessions), planned, results)


def write_report(result: StudyResult, folder: Path, unblinded: str = "") -> Path:
    """Write the page of an analysis to a folder, together with figures, tables and results.

    Parameters
    ----------
    result : StudyResult
    folder : Path
    unblinded : str
        Time and reason of the unblinding; it also distinguishes people from simulated
        participants.

    Returns
    -------
    Path
        Page ``folder/index.html``. The folder also has the figures as PNG and PDF, the tables as
        CSV, and ``results.json``.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = {each.name: each.figure for each in result.results if each.figure}
    shown = pictures({f"{name}.png": figure for name, figure in figures.items()}, folder)
    frames = result.tables.by_name | {
        each.name: pd.DataFrame(each.plain) for each in result.results
    }
    for name, frame in frames.items():
        (folder / f"{name}.csv").write_text(csv_text(frame), encoding="utf-8")
    content = json.dumps(as_json(result), indent=2, allow_nan=False)
    (folder / "results.json").write_text(content + "\n", encoding="utf-8")
    drawn = plots.save_plots(figures, folder)
    files = [*drawn, *(f"{name}.csv" for name in frames), "results.json"]
    write(
        folder / PAGE,
        "study_report.html.j2",
        result=result,
        protocol=result.protocol,
        pictures=shown,
        unblinded=unblinded,
        people=findings.reading_table(
            findings.frame_rows(result.tables.sessions[list(PEOPLE)]), "Sessions"
        ),
        files=files,
        settings={**_settings(result.protocol), **page_provenance()},
    )
    return folder / PAGE


def as_json(result: StudyResult) -> dict[str, Any]:
    """Return all results for a program; undefined numbers are null."""
    content = {
        "study": _settings(result.protocol),
        "confidence": CONFIDENCE,
        "excluded": dict(result.excluded),
        "participants": {each.test.name: each.values for each in result.planned},
        **{each.name: each.plain for each in result.results},
    }
    return dict(defined(content))


def _settings(protocol: Protocol) -> dict[str, str]:
    return {
        "title": protocol.title,
        "version of the protocol": protocol.digest,
        "task": protocol.task,
        "question": protocol.question,
        "procedure": protocol.procedure.kind,
        "order": protocol.order.kind,
        "consent": protocol.consent.version,
    }
