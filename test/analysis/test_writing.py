# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report through what it writes: page, plots, tables and signals of small trials."""

from __future__ import annotations

import csv
import io
import platform
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from bag_maker import of_trial, write_bag
from browsing import PHONE, opened
from haptic_accel import __version__
from haptic_accel.analysis import load
from haptic_accel.analysis.frames import csv_text
from haptic_accel.analysis.loading import Analysis
from haptic_accel.analysis.writing import PICTURES, Setting, signal_table, write_analysis
from haptic_accel.core.trial import Trial
from page_content import Page

if TYPE_CHECKING:
    from playwright.sync_api import Browser

FORMULAS = [*("=1+1", "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\uff1d1", "-", "'=1"), ""]
"""Texts after OWASP's list of first characters."""

TEXTS = st.one_of(
    st.sampled_from(FORMULAS),
    st.text("=+-@'\t\r\n,\";1e. a", max_size=6),
    st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=6),
)


def rows(text: str) -> list[list[str]]:
    # Line ends are those of the rows: a reader of lines would see a carriage return as one.
    return list(csv.reader(io.StringIO(text, newline="")))


def is_number(text: str) -> bool:
    try:
        return float(text) is not None and not re.search(r"[^-+.\deE]", text, re.ASCII)
    except ValueError:
        return False


@given(st.lists(TEXTS, min_size=1, max_size=4))
def test_no_cell_is_a_formula_and_taking_off_one_apostrophe_gives_the_text(
    texts: list[str],
) -> None:
    headings = list(dict.fromkeys(f"{text}{place}" for place, text in enumerate(texts)))
    frame = pd.DataFrame([texts], columns=headings)
    frame["last"] = 1
    found = rows(csv_text(frame))
    assert len(found) == 2
    for written, given_ in zip(found, ([*headings], texts), strict=True):
        assert len(written) == len(texts) + 1
        for cell, text in zip(written[:-1], given_, strict=True):
            assert not re.match("[=+@\t\n\r\uff1d\uff0b\uff0d\uff20-]", cell) or is_number(cell)
            assert cell.removeprefix("'") == re.sub("\r\n?", "\n", text)


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(-(10**9), 10**9))
def test_numbers_stay_numbers_also_as_texts(number: float, whole: int) -> None:
    frame = pd.DataFrame({"number": [number], "whole": [whole], "answer": [str(whole)]})
    _, (first, second, third) = rows(csv_text(frame))
    assert float(first) == float(f"{number:.9g}")
    assert (int(second), int(third)) == (whole, whole)


def test_an_index_with_a_name_is_a_column_and_unknown_values_are_empty() -> None:
    frame = pd.DataFrame(
        {"a": [None, 1.5], "b": ["=x", None]}, index=pd.Index(["-y", "z"], name="n")
    )
    assert rows(csv_text(frame)) == [["n", "a", "b"], ["'-y", "", "'=x"], ["z", "1.5", ""]]


SURFACES = ("plywood", "text", "vinyl")
GAINS = {"none": 0.0, "constant": 0.6, "dynamic": 0.9}
DASH = "–"
SETTING = Setting(
    "An <experiment>",
    ["The first note.", "The second {{ 7 * 7 }} note."],
    {"arguments": "rate:=1000", "<seed>": "7"},
)


def trial(surface: str, controller: str, seconds: float = 1.5, rate: float = 1000.0) -> Trial:
    """Noise as the tool's acceleration, and a handle that follows one sample later."""
    samples = round(rate * seconds)
    tool = np.convolve(np.random.default_rng(5).normal(0.0, 3.0, samples), [1, 0, -1], "same")
    return Trial(
        surface,
        controller,
        rate,
        np.arange(samples) / rate,
        tool,
        tool - tool.mean(),
        GAINS[controller] * np.concatenate([[0.0], tool[:-1]]),
        0.128 * tool,
    )


def analysed(folder: Path, *conditions: tuple[str, str]) -> Analysis:
    for surface, controller in conditions:
        write_bag(folder / f"{surface}_{controller}", of_trial(trial(surface, controller)))
    return load(folder)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a report of nine conditions, once because it is only read."""
    folder = tmp_path_factory.mktemp("results")
    analysis = analysed(folder / "bags", *((s, c) for s in SURFACES for c in GAINS))
    files = {"signals_plywood_constant.csv": signal_table(analysis.trials[0].segment)}
    write_analysis(analysis, folder, setting=SETTING, files=files)
    return folder


def test_table_two_stands_beside_the_papers(report: Path) -> None:
    page = Page(report / "index.html")
    table = page.tables[0]
    assert table[0] == ["controller", "trials per surface", *SURFACES, "average"]
    assert table[1] == ["here", "paper"] * 4
    assert page.row(0, "none")[:3] == ["1", "100.0", "99.6"]
    assert page.row(0, "constant")[2::2] == ["69.8", "80.6", "92.3", "79.1"]
    errors = [float(cell) for cell in page.row(0, "constant")[1::2]]
    assert errors == pytest.approx([40.0] * 4, abs=0.2)


def test_an_average_over_some_surfaces_is_not_compared_with_the_papers(tmp_path: Path) -> None:
    analysis = analysed(
        tmp_path / "bags", ("plywood", "none"), ("text", "none"), ("text", "constant")
    )
    page = Page(write_analysis(analysis, tmp_path))
    # Only over surfaces that all controllers were tried on.
    assert page.row(0, "none") == ["1", "100.0", "99.6", "100.0", "99.5", "100.0", DASH]
    assert page.row(0, "constant")[1:3] == [DASH, "69.8"]


def test_on_a_phone_errors_are_in_sight_and_pictures_keep_their_size(
    browser: Browser, report: Path
) -> None:
    with opened(browser, (report / "index.html").as_uri(), viewport=PHONE) as page:
        box = page.locator("#all th", has_text="NRMSE").bounding_box()
        assert box
        assert box["x"] + box["width"] <= PHONE["width"]
        assert page.locator("figure img").first.evaluate("each => each.clientWidth") == 688
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_texts_of_a_setting_stay_text(report: Path) -> None:
    page = Page(report / "index.html")
    assert page.text.count("An <experiment>") == 2
    assert page.text.index("The first note.") < page.text.index("The second {{ 7 * 7 }} note.")
    settings = page.tables[-1]
    assert settings[:2] == [["arguments", "rate:=1000"], ["<seed>", "7"]]
    told = dict(settings[2:])
    assert told["version"] == __version__
    assert platform.node() in told["machine"]
    assert Path(sys.argv[0]).name in told["command line"]
    assert ("commit" in told) == (Path(__file__).parents[2] / ".git").exists()


def test_a_wide_table_is_not_cut(browser: Browser, report: Path) -> None:
    sizes = """[...document.querySelectorAll(".scroll")].map(each => [
        each.scrollWidth > each.clientWidth,
        getComputedStyle(each).overflowX,
        getComputedStyle(each).backgroundImage.includes("gradient")])"""
    wide = {"width": 1200, "height": 800}
    with opened(browser, (report / "index.html").as_uri(), viewport=wide) as page:
        found = page.evaluate(sizes)
        # Hidden columns can be reached, and a shadow shows that there are some.
        assert [True, "auto", True] in found
        assert all(shown == ["auto", True] for _, *shown in found)
        assert page.evaluate("document.documentElement.scrollWidth") <= 1200
        page.set_viewport_size({"width": 2000, "height": 800})
        assert not any(is_wide for is_wide, *_ in page.evaluate(sizes))


def test_every_link_leads_to_a_section_or_a_file_of_the_report(report: Path) -> None:
    page = Page(report / "index.html")
    files = {unquote(link) for link in (*page.links, *page.sources) if not link.startswith("#")}
    assert all((report / name).is_file() for name in files)
    assert {"trials.csv", "signals_plywood_constant.csv", *(f"{n}.png" for n in PICTURES)} <= files
    assert {f"{name}.pdf" for name in PICTURES} <= files


def test_pictures_have_alternative_texts_that_name_the_conditions(report: Path) -> None:
    pictures = Page(report / "index.html").pictures
    alternatives = [picture["alt"] for picture in pictures]
    assert len(alternatives) == len(PICTURES)
    for text in alternatives:
        assert all(name in text for name in (*SURFACES, *GAINS))
    for name in PICTURES:
        with Image.open(report / f"{name}.png") as picture:
            assert len(picture.convert("L").getcolors() or []) > 20


def test_signals_are_written_in_named_units(report: Path) -> None:
    written = trial("plywood", "constant")
    found = pd.read_csv(report / "signals_plywood_constant.csv")
    columns = {
        "time_s": written.time,
        "tool_acceleration_m_s2": written.tool_acceleration,
        "desired_acceleration_m_s2": written.desired_acceleration,
        "handle_acceleration_m_s2": written.handle_acceleration,
        "actuator_force_N": written.actuator_force,
        "actual_acceleration_m_s2": written.actual_acceleration,
    }
    assert list(found.columns) == list(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-8, atol=1e-12)


def test_numbers_that_are_none_never_reach_the_reader(tmp_path: Path) -> None:
    samples = 1500
    zero = np.zeros(samples)
    still = Trial("text", "none", 1000.0, np.arange(samples) / 1000, zero, zero, zero, zero)
    write_bag(tmp_path / "bags" / "still", of_trial(still))
    path = write_analysis(load(tmp_path / "bags"), tmp_path)
    words = {word.lower() for word in re.findall(r"[A-Za-z]+", Page(path).text)}
    assert not {"nan", "inf"} & words
    assert ["none"] not in [row[:1] for row in Page(path).tables[0]]  # nothing was touched
    (row,) = pd.read_csv(tmp_path / "trials.csv").to_dict("records")
    assert np.isnan(row["nrmse_percent"])


@pytest.mark.parametrize("rate", [500.0, 4000.0])
def test_a_handle_at_rest_can_be_drawn(rate: float, tmp_path: Path) -> None:
    write_bag(tmp_path / "bags" / "rest", of_trial(trial("text", "none", rate=rate)))
    write_analysis(load(tmp_path / "bags"), tmp_path)
    assert (tmp_path / "fig11_spectra.png").stat().st_size > 0


def test_the_same_bags_give_the_same_files(tmp_path: Path) -> None:
    analysis = analysed(tmp_path / "bags", ("text", "constant"))
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        write_analysis(analysis, tmp_path / folder)
    for name in ("fig10_regression.png", "trials.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
