# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The scope's page in a real browser, without a graph: how old is what it shows, and its loss."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest

from browsing import QuietGraph, shown
from haptic_accel.core.axes import Axes
from haptic_accel.core.sampling import NANOSECONDS
from running import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

RATE = 1000

PROMPT = 2.0
"""Time within which a page on a busy machine says that it gets nothing, s; it aims at 0.5 s."""


class Stroking(QuietGraph):
    """Signals without a graph, of any age, under a server that can be held up or made to fail."""

    SHOWN: ClassVar[dict[str, Any]] = {
        "nodes": [
            {"name": "recorder", "state": "OK", "message": ""},
            {"name": "master_device", "state": "warning", "message": "stalled for 30 ms"},
            {"name": "slave_device", "state": "OK", "message": ""},
        ],
        "stop": {"asked": False, "master": False, "slave": False},
        "engaged": True,
    }

    def __init__(self) -> None:
        super().__init__()
        self.late = 0.0
        self.going = threading.Event()
        self.going.set()
        self.fault: Exception | None = None
        self.playing = True
        threading.Thread(target=self._play).start()

    def state(self) -> dict[str, Any]:
        self.going.wait()  # on the server's thread, which then sends nothing
        if self.fault:
            raise self.fault
        return super().state()

    def _play(self) -> None:
        sent = time.time_ns()
        while self.playing:
            now = time.time_ns()
            while sent < now:
                stamp = sent - int(self.late * NANOSECONDS)
                for ring in (self.windows.desired, self.windows.handle):
                    ring.put(stamp, 3 * np.sin(500 * sent / NANOSECONDS))
                sent += NANOSECONDS // RATE
            time.sleep(0.005)


@pytest.fixture
def graph() -> Iterator[Stroking]:
    made = Stroking()
    yield made
    made.playing = False
    made.going.set()


@pytest.fixture
def page(browser: Browser, graph: Stroking) -> Iterator[Page]:
    with shown(browser, graph, viewport={"width": 900, "height": 900}) as opened:
        see(opened, "#link", r"data -?\d\.\d\d s old")
        see(opened, "#stop-state", "no stop")
        yield opened
        graph.going.set()  # so that the server can be stopped


def see(page: Page, place: str, pattern: str) -> str:
    """Wait until the text at a place matches a pattern."""
    found = page.locator(place)
    wait_until(lambda: bool(re.search(pattern, found.inner_text())), f"{place}: {pattern}")
    return found.inner_text()


def test_a_rig_with_several_axes_has_a_choice_of_the_one_shown(
    page: Page, graph: Stroking
) -> None:
    assert page.locator("#axes").is_hidden()
    graph.windows.show_axes(Axes(("x", "z")))
    graph.windows.by_axis["x"].force.put(time.time_ns(), -2.5)
    choices = page.locator("#axes button:visible")
    wait_until(lambda: choices.all_inner_texts() == ["x", "z"], "the axes are offered")
    choices.first.click()
    see(page, "#force-peak", r"2\.50")
    wait_until(lambda: choices.first.get_attribute("aria-pressed") == "true", "x is shown")
    samples = page.evaluate("() => hapticScope.samples()")
    assert (samples["force"], samples["desired"]) == (1, 0)
    choices.last.click()
    wait_until(
        lambda: bool(page.evaluate("() => hapticScope.samples().desired > 0")), "z is shown again"
    )


def test_the_age_of_what_is_seen_turns_amber_and_back(page: Page, graph: Stroking) -> None:
    link = page.locator("#link")
    # A busy machine may be late itself.
    wait_until(lambda: link.get_attribute("data-state") == "OK", "fresh")
    graph.late = 0.5
    wait_until(lambda: link.get_attribute("data-state") == "warning", "amber")
    assert float(link.inner_text().split()[1]) >= 0.3
    see(page, "#link", r"data 0\.[5-9]\d s old")
    graph.late = 0.0
    wait_until(lambda: link.get_attribute("data-state") == "OK", "fresh again")
    assert float(link.inner_text().split()[1]) < 0.3


def test_samples_that_end_get_older_while_states_go_on(page: Page, graph: Stroking) -> None:
    graph.playing = False
    link = page.locator("#link")
    wait_until(lambda: link.get_attribute("data-state") == "warning", "amber")
    see(page, "#link", r"data [1-9]\.\d\d s old")
    assert page.locator("#stop-state").inner_text() == "no stop"


FIRST_WORD = """() => {
  const link = document.querySelector('#link');
  const look = () => {
    const said = link.textContent;
    if (!window.firstWord && said.includes('no data')) window.firstWord = said;
  };
  new MutationObserver(look).observe(link, { childList: true, subtree: true });
}"""


def lost(page: Page) -> None:
    """Wait until a page shows that it knows nothing."""
    see(page, "#link", "no data for")
    assert page.locator("#link").get_attribute("data-state") == "error"
    assert page.locator("#stop-state").inner_text() == "stop: unknown"
    assert page.locator("#arms").inner_text() == "arms: unknown"
    assert set(page.locator("#nodes .state").all_inner_texts()) == {"unknown"}


def test_a_silent_server_is_noticed_at_once_and_its_last_states_are_unknown(
    page: Page, graph: Stroking
) -> None:
    page.evaluate(FIRST_WORD)
    graph.going.clear()
    lost(page)
    found = re.search(r"no data for (\d+\.\d) s", page.evaluate("firstWord"))
    assert found
    assert 0.5 <= float(found[1]) < PROMPT
    graph.going.set()
    see(page, "#stop-state", "no stop")
    see(page, "#link", r"data \d\.\d\d s old")
    assert page.evaluate("!document.body.classList.contains('lost')")


def test_a_tab_that_was_in_the_background_does_not_show_what_was(
    page: Page, graph: Stroking
) -> None:
    devtools = page.context.new_cdp_session(page)
    devtools.send("Page.setWebLifecycleState", {"state": "frozen"})
    graph.going.clear()
    time.sleep(0.6)  # nothing runs in the page that could be waited for
    devtools.send("Page.setWebLifecycleState", {"state": "active"})
    lost(page)


def test_a_page_that_cannot_be_served_says_so_and_connects_again(
    page: Page, graph: Stroking, caplog: pytest.LogCaptureFixture
) -> None:
    graph.fault = TypeError("a value that no page can have")
    see(page, "#link", "the scope failed, see its log, no data for")
    lost(page)
    # It tries again, and fails again, in silence.
    states = page.evaluate("hapticScope.counters.states")
    graph.fault = None
    wait_until(lambda: page.evaluate("hapticScope.counters.states") > states, "states go on")
    see(page, "#stop-state", "no stop")
    assert [record.message for record in caplog.records if "page" in record.message] == [
        f"page: TypeError at {record_place(caplog)}: a value that no page can have"
    ]


def record_place(caplog: pytest.LogCaptureFixture) -> str:
    """Return file and line that the only message names."""
    found = re.search(r" at (test_scope\.py:\d+)", caplog.text)
    assert found, caplog.text
    return found[1]


@pytest.mark.slow
def test_a_connection_that_broke_without_a_word_is_renewed(page: Page, graph: Stroking) -> None:
    page.evaluate(
        """() => {
          const open = WebSocket;
          window.opened = 0;
          window.WebSocket = class extends open {
            constructor(...given) {
              super(...given);
              window.opened++;
            }
          };
        }"""
    )
    graph.going.clear()
    wait_until(lambda: page.evaluate("opened") == 1, "another connection is tried")
    graph.going.set()
    see(page, "#stop-state", "no stop")


PERIODS = """() => [...document.querySelectorAll('.metrics tr:not(.period)')].map((row) => {
  let above = row;
  while (above && !above.classList.contains('period')) above = above.previousElementSibling;
  return [row.querySelector('th').textContent, above?.textContent.trim() ?? ''];
})"""


def test_each_number_tells_what_it_counts_and_since_when(page: Page) -> None:
    periods = dict(page.evaluate(PERIODS))
    assert set(periods.values()) == {"in the last 2 s", "since the arms engaged"}
    assert periods["actuator forces after their deadline"] == "since the arms engaged"
    for card in ("nodes", "recorder"):
        note = page.locator(f"section:has(#{card}) .note")
        assert re.search("since", note.last.inner_text())
