# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live scope as a user meets it: a graph that runs, and its page in a real browser."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import aiohttp
import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter

from browsing import LISTEN, chromium, received
from haptic_accel.core.process import REALTIME
from haptic_accel.core.topics import MASTER_STOPPED, SLAVE_STOPPED
from haptic_accel.graph.stop_signal import PRIORITY
from haptic_accel.scope.server import METRICS_PERIOD
from running import Command, Start, free_port, nodes_of, realtime_is_allowed, wait_until
from sharing import own_domain

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from observing import Observer

pytestmark = pytest.mark.live


def button(action: str, value: str) -> str:
    """Return the selector of a button, not of that for who touches."""
    return f"[data-action={action}][data-value={value}]:not(.touching *)"


class Shared:
    """A graph with a scope in a ROS domain, and its page."""

    def __init__(self, domain: int, folder: Path, page: Page) -> None:
        self.domain = domain
        self.folder = folder
        self.page = page
        self.port = free_port()
        self.complaints: list[str] = []
        self.requested: list[str] = []
        page.on("console", self._on_console)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requested.append(request.url))
        self.graph = self.start()
        page.goto(f"http://127.0.0.1:{self.port}/")
        self.wait("state !== null && hapticScope.samples().actual > 200", "signals arrive")

    def start(self, *more: str) -> Command:
        """Start a graph whose scope has always the same port."""
        words = ["-m", "haptic_accel.cli.main", "teleop", "seed:=1", "scope:=true"]
        words += [f"scope_port:={self.port}", "scope_control:=true", *more]
        graph = Command(words, self.folder)
        graph.wait_for("engaged")
        graph.wait_for("control allowed")
        return graph

    def wait(self, expression: str, what: str) -> None:
        """Wait for an expression of the page; `state` is what it was sent last."""
        script = f"() => {{ const state = hapticScope.state; return Boolean({expression}); }}"
        wait_until(lambda: bool(self.page.evaluate(script)), what, self.graph)

    def press(self, action: str, value: str) -> None:
        self.page.locator(button(action, value)).click()

    def is_pressed(self, action: str, value: str) -> str:
        """Return the expression for a choice being shown as the graph's own."""
        return f"document.querySelector('{button(action, value)}').ariaPressed === 'true'"

    def _on_console(self, message: Any) -> None:
        # 503 is the answer to a command for which the graph is late: no fault of the page.
        if message.type in ("error", "warning") and "status of 503" not in message.text:
            self.complaints.append(message.text)


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with chromium() as browser:
        yield browser.new_page(viewport={"width": 1280, "height": 900})


@pytest.fixture(scope="module")
def shared(page: Page, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shared]:
    # Beside a browser that draws, real-time nodes would starve the recorder and the page.
    with own_domain({REALTIME: "no"}) as domain:
        made = Shared(domain, tmp_path_factory.mktemp("scope"), page)
        yield made
        made.graph.end(signal.SIGINT)


@pytest.fixture(scope="module")
def watcher(shared: Shared) -> Iterator[Observer]:
    from observing import Observer

    observer = Observer(shared.domain)
    yield observer
    observer.close()


def parameter(watcher: Observer, node: str, name: str) -> str:
    request = GetParameters.Request(names=[name])
    answer = watcher.call(GetParameters, f"{node}/get_parameters", request)
    return str(answer.values[0].string_value)


PICTURE = "document.querySelector('#time > canvas').toDataURL()"

COLOURED = """() => {
  const canvas = document.querySelector('#time > canvas');
  const { width, height } = canvas;
  // The page's own would be drawn without the graphics card once it is read again and again.
  const copy = Object.assign(document.createElement('canvas'), { width, height });
  const context = copy.getContext('2d', { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const pixels = context.getImageData(0, 0, width, height).data;
  let count = 0;
  for (let i = 3; i < pixels.length; i += 4) if (pixels[i] > 0) count++;
  return count / width;
}"""


def test_curves_move(shared: Shared, tmp_path: Path) -> None:
    page = shared.page
    before = page.evaluate(PICTURE)
    drawn = page.evaluate("hapticScope.counters.drawn")
    wait_until(lambda: page.evaluate(PICTURE) != before, "another picture")
    shared.wait(f"hapticScope.counters.drawn > {drawn + 5}", "more pictures")
    shared.wait("hapticScope.samples().actual > 2500", "a full window")
    # A bar in nearly every column of pixels.
    wait_until(lambda: page.evaluate(COLOURED) > 0.8, "a full picture")
    shared.wait("state.metrics.nrmse_percent > 0 && state.metrics.rate === 1000", "figures")
    shared.wait("state.metrics.indistinguishable_percent >= 0", "what a hand could not tell")
    for name, most in (("nrmse", 1000), ("indistinguishable", 100)):
        shown = f"parseFloat(document.querySelector('#{name}').innerText)"
        shared.wait(f"{shown} >= 0 && {shown} <= {most}", f"{name} is shown")
    shared.wait("!state.limits.assumed", "the compensator's parameters are known")
    picture = tmp_path / "scope.png"
    page.screenshot(path=picture, full_page=True)
    assert picture.stat().st_size > 20_000


def test_further_signals_are_drawn_where_chosen_and_remembered(shared: Shared) -> None:
    page = shared.page
    assert not page.locator("#forces").is_visible()
    further = ("arm_force", "position")
    for name in further:
        page.locator(f"#show-{name}").check()
    arrive = "hapticScope.samples().arm_force > 200 && hapticScope.samples().position > 200"
    shared.wait(arrive, "further signals arrive")
    page.reload()
    shared.wait(f"hapticScope.state !== null && {arrive}", "they arrive again")
    for name in further:
        assert page.locator(f"#show-{name}").is_checked()
        page.locator(f"#show-{name}").uncheck()
    assert not page.locator("#forces").is_visible()
    newest = page.evaluate("hapticScope.newest()")
    # Their number begins again with each connection.
    shared.wait(f"hapticScope.newest() > {newest} + 2", "a full window")


def test_what_is_held_can_be_read_and_zoomed(shared: Shared) -> None:
    page, reading = shared.page, shared.page.locator("#reading")
    page.locator("#hold").click()
    box = page.locator("#time .u-over").bounding_box()
    assert box

    def point(part: float) -> None:
        page.mouse.move(box["x"] + part * box["width"], box["y"] + box["height"] / 2, steps=4)

    value = r"(-?\d+\.\d+|–)"  # a dash where the busy machine lost samples
    shown = re.compile(rf"-[01]\.\d+ s: desired {value} m/s², actual {value} m/s²")
    point(0.5)
    wait_until(lambda: shown.fullmatch(reading.inner_text()), "a reading")
    text = reading.inner_text()
    assert float(text.split()[0]) == pytest.approx(-1.0, abs=0.01)
    shared.wait(f"hapticScope.newest() > {page.evaluate('hapticScope.newest()')}", "new samples")
    point(0.25)
    wait_until(lambda: reading.inner_text() != text, "another reading")
    point(0.5)
    wait_until(lambda: reading.inner_text() == text, "the same reading")
    page.mouse.down()
    point(0.75)
    page.mouse.up()
    shared.wait("hapticScope.view()[0] > -1.02 && hapticScope.view()[1] < -0.48", "half a second")
    page.locator("#hold").focus()
    before = reading.inner_text()
    page.keyboard.press("ArrowLeft")
    seconds = float(before.split()[0])
    wait_until(lambda: float(reading.inner_text().split()[0]) < seconds, "an earlier reading")
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    shared.wait("String(hapticScope.view()) === '-2,0'", "the whole window")
    page.locator("#hold").click()
    assert not reading.is_visible()


def test_a_controller_chosen_on_the_page_takes_over_in_the_graph(
    shared: Shared, watcher: Observer
) -> None:
    shared.wait(shared.is_pressed("controller", "dynamic"), "the controller is known")
    shared.press("controller", "adaptive")
    shared.wait(shared.is_pressed("controller", "adaptive"), "the page shows the new one")
    assert parameter(watcher, "compensator", "controller") == "adaptive"


POINT = """() => new Promise((done) => {
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.onopen = () => socket.send('{"point": [0, 0]}');
  socket.onmessage = ({ data }) => {
    const { refused } = typeof data === 'string' ? JSON.parse(data) : {};
    if (refused) socket.close();
    if (refused) done(refused);
  };
})"""


def test_a_hand_with_a_script_is_led_by_no_page(shared: Shared) -> None:
    shared.wait("state.led === false && state.scene === 'plywood'", "the devices are known")
    assert shared.page.evaluate(POINT) == "hand: master = simulated: must be pointer to be led"


def test_surface_and_grip_change_with_the_keyboard_alone(
    shared: Shared, watcher: Observer
) -> None:
    for action, value in (("surface", "vinyl"), ("grip", "hook")):
        shared.page.locator(button(action, value)).focus()
        shared.page.keyboard.press("Enter")
        shared.wait(shared.is_pressed(action, value), f"{action} {value}")
    assert parameter(watcher, "slave_device", "simulated.surface.name") == "vinyl"
    assert parameter(watcher, "master_device", "simulated.grip.posture") == "hook"


def test_what_is_set_elsewhere_is_shown(shared: Shared, watcher: Observer) -> None:
    given = Parameter("controller", value="constant").to_parameter_msg()
    request = SetParameters.Request(parameters=[given])
    assert watcher.call(SetParameters, "compensator/set_parameters", request).results[0].successful
    shared.wait(shared.is_pressed("controller", "constant"), "the page follows")


def value(kind: int, **content: Any) -> ParameterValue:
    return ParameterValue(type=kind, **content)


KINDS = ("STRING", "DOUBLE", "BYTE_ARRAY")
TEXT, NUMBER, BYTES = (getattr(ParameterType, f"PARAMETER_{kind}") for kind in KINDS)
HOSTILE = [
    ("compensator", "controller", value(99)),
    ("compensator", "controller", value(BYTES, byte_array_value=[b"\xff", b"\0"])),
    ("compensator", "controller", value(NUMBER, double_value=float("nan"))),
    ("compensator", "controller", value(TEXT, string_value="\x1b[2J")),
    ("compensator", "high_pass_frequency", value(NUMBER, double_value=float("inf"))),
    ("compensator", "actuator.peak_force", value(TEXT, string_value="much")),
    ("slave_device", "simulated.surface.name", value(BYTES, byte_array_value=[b"\x01"])),
    ("slave_device", "virtual.scene", value(NUMBER, double_value=float("nan"))),
    ("master_device", "device", value(255)),
    ("master_device", "\n", value(TEXT, string_value="\0")),
]
"""Parameter events that no node of the graph sends: node, name and value."""


def test_hostile_parameter_events_are_refused_and_the_page_goes_on(
    shared: Shared, watcher: Observer
) -> None:
    kept = 2 * len(HOSTILE)  # none may be replaced before a scope that is busy has taken it
    publisher = watcher.node.create_publisher(ParameterEvent, "/parameter_events", kept)
    wait_until(lambda: publisher.get_subscription_count() >= 2, "scope and recorder listen")
    for node, name, content in HOSTILE:
        changed = [ParameterMessage(name=name, value=content)]
        publisher.publish(ParameterEvent(node=f"/{node}", changed_parameters=changed))
    publisher.publish(b"\0\1\0\0 not an event")
    watcher.status("scope", least={"messages malformed": len(HOSTILE)})
    states = int(shared.page.evaluate("hapticScope.counters.states"))
    shared.wait(f"hapticScope.counters.states > {states} + 2", "states go on")
    shared.wait(shared.is_pressed("controller", "constant"), "what is true is shown")
    shared.graph.wait_for("malformed message refused.*compensator")
    said = [line for line in shared.graph.lines if "malformed message refused" in line]
    assert len([line for line in said if "compensator" in line]) == 1, said
    watcher.node.destroy_publisher(publisher)


def test_a_scope_that_is_stopped_is_missed_by_its_page(shared: Shared) -> None:
    scope = nodes_of(shared.domain)["scope"]
    os.kill(scope, signal.SIGSTOP)
    try:
        shared.wait("document.querySelector('#link').innerText.startsWith('no data for')", "said")
        shared.wait("document.querySelector('#stop-state').innerText === 'stop: unknown'", "too")
    finally:
        os.kill(scope, signal.SIGCONT)
    shared.wait("document.querySelector('#stop-state').innerText === 'no stop'", "known again")


def test_arms_are_let_go_and_taken_again_which_is_heard(shared: Shared) -> None:
    for button in ("#sound-on", "[data-sound=desired]"):
        shared.page.locator(button).click()
    shared.page.evaluate(LISTEN)
    shared.wait("heard()[1] > -60", "the tool strokes the surface")
    shared.press("engage", "false")
    shared.wait("state.engaged === false", "let go")
    shared.wait("document.querySelector('#arms').textContent === 'arms disengaged'", "said")
    shared.wait("heard()[1] < -80", "the tool rests")
    shared.press("engage", "true")
    shared.wait("state.engaged === true", "engaged")
    shared.wait("heard()[1] > -60", "the tool strokes again")
    shared.page.locator("#sound-on").click()


def test_the_recorder_pauses_and_goes_on(shared: Shared) -> None:
    shared.press("record", "pause")
    shared.wait("state.recorder.state === 'paused'", "paused")
    shared.press("record", "start")
    shared.wait("state.recorder.state === 'recording'", "recording")


def test_escape_stops_and_only_a_confirmed_release_lets_go(
    shared: Shared, watcher: Observer
) -> None:
    page = shared.page
    page.locator("h1").click()  # no control has the focus
    page.keyboard.press("Escape")
    watcher.wait_for_state(MASTER_STOPPED, True)
    watcher.wait_for_state(SLAVE_STOPPED, True)
    shared.wait("state.stop.master && state.stop.slave && !state.engaged", "the page knows")
    page.locator("#alarm").wait_for(state="visible")
    assert "no force" in page.locator("#alarm").inner_text()
    page.locator("#release").click()
    page.keyboard.press("Escape")  # closes the dialog
    assert not page.locator("#confirm").is_visible()
    page.locator("#release").click()
    page.locator("#keep").click()
    shared.wait("state.stop.master && state.stop.slave", "still stopped")
    page.locator("#release").click()
    page.locator("#really").click()
    watcher.wait_for_state(MASTER_STOPPED, False)
    watcher.wait_for_state(SLAVE_STOPPED, False)
    shared.wait("state.stop.master === false && state.engaged", "coupled again")
    page.locator("#alarm").wait_for(state="hidden")


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (390, "light"), (1280, "dark")])
def test_the_page_fits_and_the_stop_is_always_in_sight(
    shared: Shared, width: int, scheme: str
) -> None:
    page = shared.page
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    page.set_viewport_size({"width": width, "height": 800})
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    box = page.locator("#stop").bounding_box()
    assert box
    assert 0 <= box["y"] < box["y"] + box["height"] <= 800
    assert box["height"] >= 44  # what a finger hits (WCAG 2.5.5)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.emulate_media(color_scheme="light", reduced_motion="no-preference")
    page.set_viewport_size({"width": 1280, "height": 900})


def test_everything_has_a_name_for_who_does_not_see_it(shared: Shared) -> None:
    nameless = """() => [...document.querySelectorAll(
        'button, select, input, [role=img], [role=meter]')]
      .filter((e) => !(e.textContent.trim() || e.ariaLabel || e.getAttribute('aria-labelledby')
                       || e.closest('label')))
      .map((e) => e.outerHTML)"""
    assert shared.page.evaluate(nameless) == []
    hidden = "[...document.querySelectorAll('canvas')].every((e) => e.closest('[role=img]'))"
    assert shared.page.evaluate(hidden)
    # Figures that change are not read out.
    assert shared.page.locator("[aria-live]:not(.touching *)").count() == 1
    # Every state is a word.
    states = shared.page.locator("#nodes .state").all_inner_texts()
    assert set(states) <= {"OK", "warning", "error", "silent", "absent"}


def test_the_page_is_quiet_and_asks_nobody_else(shared: Shared) -> None:
    assert shared.complaints == []
    assert shared.requested
    ours = (f"http://127.0.0.1:{shared.port}/", f"ws://127.0.0.1:{shared.port}/", "data:")
    assert [url for url in shared.requested if not url.startswith(ours)] == []


def test_the_page_comes_back_with_the_graph(shared: Shared) -> None:
    assert shared.graph.end(signal.SIGINT) == 0, shared.graph.text
    status = shared.page.locator("#link")
    wait_until(lambda: "not reached" in status.inner_text(), "the page says so")
    newest = shared.page.evaluate("hapticScope.newest()")
    shared.graph = shared.start("master:=pointer")
    shared.wait(f"hapticScope.newest() > {newest}", "new samples")
    wait_until(lambda: status.inner_text().startswith("data "), "its age is shown again")


def test_the_mouse_leads_the_hand_over_the_surface(shared: Shared) -> None:
    page = shared.page
    shared.wait("state.led && state.scene === 'plywood'", "the devices are known")
    page.locator("#scene").scroll_into_view_if_needed()
    shared.wait("Number.isFinite(hapticScene.here.handle[0])", "the hand is there")
    box = page.locator("#scene").bounding_box()
    assert box
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    scale = min(box["width"] / 0.3, box["height"] / 0.1)  # pixels per m
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 0.035 * scale, steps=10)  # 5 mm below the surface
    shared.wait("hapticScene.here.tool[1] < 1e-3 && hapticScene.here.force[1] > 0.3", "contact")
    page.mouse.move(x + 0.04 * scale, y + 0.035 * scale, steps=20)
    shared.wait("hapticScene.here.tool[0] > 0.03", "the tool has gone along")
    page.mouse.up()
    shared.press("grip", "hook")
    shared.wait(shared.is_pressed("grip", "hook"), "the hand takes another grip")


FLOOD = """
import time
import rclpy
from haptic_accel.core import topics
from haptic_accel.core.cdr import StampedVector
from haptic_accel.graph.stop_signal import PRIORITY
from haptic_accel.nodes.supervised_node import message_type, offered_quality

rclpy.init()
node = rclpy.create_node("flood")
senders = [
    (node.create_publisher(message_type(topic), topic.name, offered_quality(topic)).publish,
     StampedVector(topic).pack)
    for topic in (
        topics.DESIRED_ACCELERATION, topics.HANDLE_ACCELERATION, topics.ACTUATOR_FORCE,
        topics.SLAVE_ARM_FORCE, topics.SLAVE_POSITION,
    )
]
while True:
    for publish, pack in senders:
        publish(pack(time.time_ns(), (0.0, 0.0, 1.0)))
"""
"""Sends all signals of a page as quickly as it can: some thousand of each in a second."""


@pytest.mark.slow
def test_a_flood_of_signals_does_not_silence_the_scope(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(REALTIME, raising=False)
    scope = start("-m", "haptic_accel.nodes.scope", "--ros-args", "-p", "port:=0")
    address = scope.wait_for("http").split()[0]
    start("-c", FLOOD)

    async def states() -> list[str]:
        found: list[str] = []
        async with aiohttp.ClientSession() as session:
            headers = {"Origin": address.rstrip("/")}
            given = {"headers": headers, "max_msg_size": 2**27}
            async with session.ws_connect(f"{address}live", **given) as live:
                await live.send_json(["arm_force", "position"])
                while found.count("OK") < 5 / METRICS_PERIOD:
                    message = await received(live)
                    if message.type is aiohttp.WSMsgType.TEXT:
                        rows = json.loads(message.data)["nodes"]
                        found += [row["state"] for row in rows if row["name"] == "scope"]
        return found

    # A browser of another test has an event loop in this thread.
    with ThreadPoolExecutor(1) as thread:
        assert set(thread.submit(asyncio.run, states()).result()) == {"OK"}
    # Its stop does not wait for other programs, also beside this.
    priority = os.sched_getparam(scope.process.pid).sched_priority
    assert priority == (PRIORITY if realtime_is_allowed() else 0)
