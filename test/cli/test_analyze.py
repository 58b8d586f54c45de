# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel analyze`` through what it prints and writes; its page in a real browser."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from bag_maker import BagContent, of_trial, write_bag
from haptic_accel.analysis import load
from haptic_accel.analysis.plots import EMBEDDED
from haptic_accel.analysis.writing import write_page
from haptic_accel.core import topics
from haptic_accel.core.trial import Trial
from nightly import rest_slow
from verbs import output_of, refusal, status_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser

RATE = 1000.0
GAINS = {"none": 0.0, "constant": 0.6, "inverse": 0.9}


def content(controller: str, surface: str, seed: int = 0, seconds: float = 3.0) -> BagContent:
    generator = np.random.default_rng([seed, len(surface)])
    desired = np.convolve(generator.normal(0, 5, round(seconds * RATE)), [1, 0, -1], "same")
    handle = GAINS[controller] * np.concatenate([[0.0], desired[:-1]])
    time = np.arange(len(desired)) / RATE
    trial = Trial(surface, controller, RATE, time, desired, desired, handle, 0.1 * desired)
    return of_trial(trial, seed=seed)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags")
    for seed in range(3):
        for controller in GAINS:
            name = f"seed{seed}/plywood_{controller}"
            write_bag(folder / name, content(controller, "plywood", seed))
    write_bag(folder / "vinyl_none", content("none", "vinyl"))
    return folder


@pytest.fixture(scope="module")
def report(bags: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a report on all bags, and ``figures.json`` beside it."""
    folder = tmp_path_factory.mktemp("report") / "out"
    json_file = folder.parent / "figures.json"
    words = ("--compare", "controller:constant,inverse", "--out", folder, "--json", json_file)
    with pytest.MonkeyPatch.context() as settings:
        settings.setitem(EMBEDDED, "pdf.fonttype", 42)  # as for a user
        assert status_of("analyze", bags, *words) == 0
    return folder


def test_everything_is_written(report: Path) -> None:
    names = {file.name for file in report.iterdir()}
    figures = ("fig9_time", "fig10_regression", "fig11_spectra", "bands")
    assert names == {
        "index.html",
        "trials.csv",
        "groups.csv",
        "comparison.csv",
        *(f"{name}.{suffix}" for name in figures for suffix in ("png", "pdf")),
    }
    for name in figures:
        with Image.open(report / f"{name}.png") as picture:
            inches = picture.width / 300
            assert inches in (pytest.approx(7.16, abs=0.02), pytest.approx(3.5, abs=0.02))
        content = (report / f"{name}.pdf").read_bytes()
        assert content.startswith(b"%PDF")
        assert b"/Type3" not in content  # which publishers refuse


def test_tables_and_json_agree(report: Path) -> None:
    with (report / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    figures = json.loads((report.parent / "figures.json").read_text())
    assert len(rows) == len(figures["trials"]) == 10
    assert len({row["trial"] for row in rows}) == 10
    for row, trial in zip(rows, figures["trials"], strict=True):
        assert row["trial"] == trial["trial"]
        assert float(row["nrmse_percent"]) == pytest.approx(trial["nrmse_percent"])
    by_key = {(group["controller"], group["surface"]): group for group in figures["groups"]}
    assert by_key["inverse", "plywood"]["trials"] == 3
    assert by_key["inverse", "plywood"]["nrmse_percent"] == pytest.approx(10.0, abs=1.0)
    overall = figures["comparison"][0]
    assert (overall["pairs"], overall["p_wilcoxon"]) == (3, None)
    assert overall["difference_percent"] == pytest.approx(-30.0, abs=1.0)


def test_bags_side_by_side_give_the_same_and_each_is_told_as_it_ends(
    ran: Callable[..., str], bags: Path, tmp_path: Path
) -> None:
    found = {}
    for jobs in ("1", "3"):
        words = ("--jobs", jobs, "--shift", "measured", "--json", f"{jobs}.json", "--out", jobs)
        text = ran("analyze", bags / "seed0", *words)
        assert "3 of 3: plywood_none: none on plywood 100.0 % (limited bound " in text
        found[jobs] = json.loads((tmp_path / f"{jobs}.json").read_text())
    assert found["1"] == found["3"]
    assert "Table II" in text
    assert re.search(r"constant .*40\.\d ", text)
    assert "1 trial: too few for an interval" in " ".join(text.split())
    assert "3 trials from 3 bags" in text
    assert "No sample was lost." in text


def test_a_bag_that_says_nothing_has_bounds_with_a_rig(tmp_path: Path) -> None:
    bare = content("inverse", "plywood")
    bare.metadata.clear()
    write_bag(tmp_path / "bare", bare)
    file = tmp_path / "figures.json"
    words = ("--rig", "ideal", "--rate", "1000", "--json", file)
    assert status_of("analyze", tmp_path / "bare", *words, "--out", tmp_path / "out") == 0
    (trial,) = json.loads(file.read_text())["trials"]
    assert 0.0 < trial["bound_percent"] <= trial["limited_bound_percent"] < 100.0


def test_rig_and_rate_of_bags_that_state_theirs_are_refused(bags: Path, tmp_path: Path) -> None:
    bag = bags / "seed0" / "plywood_none"
    out = ("--out", tmp_path / "out")
    assert "describes its own handle" in refusal("analyze", bag, "--rig", "ideal", *out)
    assert not (tmp_path / "out").exists()
    assert "rate = 500: must be 1000 Hz" in refusal("analyze", bag, "--rate", "500", *out)


def test_a_bag_with_markup_in_its_name_is_only_a_name(tmp_path: Path) -> None:
    write_bag(tmp_path / "<script>alert(1)[bold]", content("none", "vinyl", seconds=2.0))
    write_page(load(tmp_path), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "&lt;script&gt;alert(1)[bold]" in page
    assert "<script>alert" not in page


def test_of_bags_of_which_nothing_can_be_said_the_status_is_one(tmp_path: Path) -> None:
    foreign = BagContent({topics.SLAVE_POSITION.name: np.ones(2000)}, RATE, arms=False)
    write_bag(tmp_path / "bags" / "foreign", foreign)
    (tmp_path / "bags" / "empty").mkdir()
    (tmp_path / "bags" / "empty" / "metadata.yaml").write_text("")
    json_file = tmp_path / "figures.json"
    words = ("--out", tmp_path / "out", "--json", json_file)
    printed = output_of("analyze", tmp_path / "bags", *words, status=1)
    assert "Nothing could be determined from 2 bags." in printed
    assert "foreign: none of the signals of this graph" in printed
    assert "it is of another rig" in (tmp_path / "out" / "index.html").read_text()
    assert set(json.loads(json_file.read_text())["problems"]) == {"empty", "foreign"}


# The page in a browser


PLOTS = ("time", "error", "cloud", "spectra", "coherence", "force", "travel")

# How many pixels of a plot are not of the colour of its first.
INK = """id => {
  const canvas = document.querySelector(`#${id} canvas`);
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) if (pixels[i + 3] > 0) count += 1;
  return count;
}"""


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_the_page_draws_and_answers(report: Path, browser: Browser, scheme: str) -> None:
    page = browser.new_page(color_scheme=scheme)
    complaints: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto((report / "index.html").as_uri())
    page.wait_for_selector("html[data-drawn='7']")
    page.wait_for_function(f"document.querySelectorAll('canvas').length == {len(PLOTS)}")
    for plot in PLOTS:
        page.wait_for_function(f"({INK})('{plot}') > 500")
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (background == "rgb(255, 255, 255)") == (scheme == "light")

    before = page.evaluate("document.querySelector('#time canvas').toDataURL()")
    page.get_by_role("button", name="next trial").click()
    moved = "drawn => document.querySelector('#time canvas').toDataURL() != drawn"
    page.wait_for_function(moved, arg=before)
    assert page.locator("tr.chosen").count() == 1
    page.get_by_role("button", name="whole trial").press("Enter")
    page.get_by_role("button", name="other controllers too").click()
    assert page.locator("#spectra .u-series").count() == 2 + len(GAINS)

    heading = page.locator("#all th", has_text="NRMSE")
    heading.get_by_role("button").click()
    assert heading.get_attribute("aria-sort") == "ascending"
    cells = page.locator("#all tbody tr td:nth-child(4)")
    shown = cells.evaluate_all("cells => cells.map(cell => Number(cell.dataset.sort))")
    assert shown == sorted(shown)

    toggle = page.locator("#time .u-legend th[role=button]").first
    toggle.press("Enter")
    first = "document.querySelector('#time .u-legend th[role=button]')"
    page.wait_for_function(f"{first}.getAttribute('aria-pressed') == 'false'")
    page.emulate_media(media="print", color_scheme=scheme)
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert complaints == []
    assert [url for url in requests if not url.startswith("file:")] == []
    page.close()
