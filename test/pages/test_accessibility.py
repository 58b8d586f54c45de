# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accessibility of every page, in light and dark: axe-core finds nothing to object to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import pytest

from browsing import done, opened, shown, violations
from haptic_accel.analysis import experiment, load
from haptic_accel.analysis.frames import compared
from haptic_accel.analysis.writing import write_analysis
from haptic_accel.scope.paced_rig import PacedRig
from haptic_accel.setup.arguments import GraphArguments
from nightly import rest_slow
from running import on_thread, wait_until
from verbs import WITHOUT_FRICTION, status_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

Scheme: TypeAlias = Literal["light", "dark"]

SCHEMES = pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))


class GraphOfRig(PacedRig):
    """A rig that shows itself as a graph: nodes in every state, a recorder and a stop."""

    def __init__(self) -> None:
        super().__init__("plywood", "paper")
        self.stop: dict[str, bool | None] = {"asked": False, "master": False, "slave": False}

    def choices(self) -> dict[str, list[str]]:
        return {**super().choices(), "record": ["start", "pause", "split", "stop"]}

    def state(self) -> dict[str, Any]:
        states = ("OK", "warning", "error", "silent", "absent")
        names = ("master_device", "slave_device", "coupler", "compensator", "recorder")
        rows = [
            {"name": name, "state": state, "message": "" if state == "OK" else f"is {state}"}
            for name, state in zip(names, states, strict=True)
        ]
        recorder = {"messages": "1200", "written (bytes)": "5000000"}
        return {**super().state(), "nodes": rows, "recorder": recorder, "stop": self.stop}


@contextmanager
def scope(browser: Browser, scheme: Scheme, *, control: bool) -> Iterator[tuple[Page, GraphOfRig]]:
    """Open the live page of a graph."""
    rig, act = GraphOfRig(), done if control else None
    look = {"viewport": {"width": 1280, "height": 900}, "color_scheme": scheme}
    with on_thread(rig.run), shown(browser, rig, act, **look) as page:
        wait_until(lambda: page.locator("#nodes li").count() == len(rig.state()["nodes"]), "nodes")
        wait_until(lambda: page.locator("#nrmse").inner_text() != "–", "metrics")
        yield page, rig


@SCHEMES
@pytest.mark.slow
def test_the_live_page_without_control(browser: Browser, scheme: Scheme) -> None:
    with scope(browser, scheme, control=False) as (page, _):
        for name in ("force", "arm_force", "travel", "position"):
            page.check(f"#show-{name}")
        assert violations(page) == []


@SCHEMES
def test_the_live_page_with_control_in_a_stop_and_its_release(
    browser: Browser, scheme: Scheme
) -> None:
    with scope(browser, scheme, control=True) as (page, rig):
        assert violations(page) == []
        rig.stop |= {"asked": True, "master": True}
        wait_until(lambda: page.locator("#alarm").is_visible(), "the alarm")
        assert violations(page) == []
        page.click("#release")
        assert violations(page) == []


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a page of each kind that is written to a file."""
    folder = tmp_path_factory.mktemp("reports")
    for name in ("analysis", "experiment"):
        (folder / name).mkdir()
    every = GraphArguments(surface="text", duration=2.0)
    plan = [replace(every, controller=each) for each in ("none", "constant", "dynamic")]
    conditions = experiment.recorded_conditions(plan, folder / "bags", None, lockstep=True)
    for each in conditions:
        experiment.run_lockstep(each)
    analysis = load(folder / "bags")
    write_analysis(analysis, folder / "analysis", compared(analysis, "controller:none,dynamic"))
    arguments = {each.bag: each.arguments for each in conditions}
    live = experiment.Run(
        every, arguments, None, lockstep=False, expected=dict.fromkeys(arguments, 70.0)
    )
    experiment.write_experiment(live, analysis, folder / "experiment", "A warning.")
    words = ("--lockstep", "--grips", "pinch,hook", "trials:=2", "duration:=1")
    words += WITHOUT_FRICTION
    assert status_of("identify", *words, "--out", folder / "identification") == 0
    return folder


@SCHEMES
@pytest.mark.parametrize("name", ["analysis", "experiment", "identification"])
def test_a_report(browser: Browser, reports: Path, name: str, scheme: Scheme) -> None:
    address = (reports / name / "index.html").as_uri()
    with opened(browser, address, color_scheme=scheme) as page:
        if name in ("analysis", "experiment"):
            page.wait_for_selector("html[data-drawn='7']")
        assert violations(page) == []
