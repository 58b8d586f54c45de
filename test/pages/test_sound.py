# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's sound in a real browser, without a graph: what is played, and from when on."""

from __future__ import annotations

import re
import socket
from collections.abc import Container, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from browsing import LISTEN, Tones, opened
from haptic_accel.scope.connections import Access
from haptic_accel.scope.server import ScopeServer
from running import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

FRAME = 1 / 60
"""Interval between frames, s."""

RESERVE = 0.008
"""Least that is left to play when samples come evenly, s."""

FILTER = 4
"""Samples by which the interpolation delays."""


@pytest.fixture(scope="module")
def tones() -> Iterator[Tones]:
    made = Tones()
    yield made
    made.playing = False


@pytest.fixture(scope="module")
def page(browser: Browser, tones: Tones) -> Iterator[Page]:
    # As a phone in the same network sees the page.
    server = ScopeServer(tones, Access("0.0.0.0"), "0.0.0.0", 0)
    address = server.start().replace("0.0.0.0", socket.gethostname())
    with opened(browser, address) as shown:
        assert not shown.evaluate("isSecureContext")
        yield shown
    server.stop()


OFFLINE = """async ([arrivals, rate, contextRate, seconds]) => {
  const context = new OfflineAudioContext(1, Math.ceil(seconds * contextRate), contextRate);
  const stream = new hapticSound.Stream(context, context.destination);
  const delays = [];
  for (const [at, first, end] of arrivals) {
    const numbers = Array.from({ length: end - first }, (_, i) => first + i);
    context.suspend(at).then(() => {
      const values = numbers.map((n) => Math.sin((2 * Math.PI * 100 * n) / rate));
      const estimate = rate * (1 + 1e-4 * (first % 2));
      stream.take(numbers.map((n) => 1.8e9 + n / rate), Float32Array.from(values), estimate);
      delays.push(stream.delay);
      context.resume();
    });
  }
  const sound = (await context.startRendering()).getChannelData(0);
  const start = Array.from(sound.subarray(0, 2 * contextRate));
  return { sound: start, delays, underruns: stream.underruns };
}"""


def played(
    page: Page,
    arrivals: list[float],
    rate: int = 1000,
    context_rate: int = 48000,
    lost: Container[int] = (),
) -> tuple[Any, Any, int]:
    """Return what is played of a tone of 100 Hz, at most 2 s, with delays (s) and underruns.

    At each arrival come all samples so far, but for those of arrivals that are lost.
    """
    counts = [int(at * rate) for at in [arrivals[0] - FRAME, *arrivals]]
    frames = [[at, *pair] for at, pair in zip(arrivals, pairwise(counts), strict=True)]
    frames = [frame for k, frame in enumerate(frames) if k not in lost]
    found = page.evaluate(OFFLINE, [frames, rate, context_rate, arrivals[-1] + FRAME])
    return np.array(found["sound"]), np.array(found["delays"]), found["underruns"]


@pytest.mark.parametrize(("rate", "context_rate"), [(1000, 44100), (10000, 48000)])
def test_a_tone_that_comes_in_frames_is_played_as_one_tone(
    page: Page, rate: int, context_rate: int
) -> None:
    arrivals = [FRAME * (k + 1) for k in range(110)]
    sound, delays, underruns = played(page, arrivals, rate, context_rate)
    assert underruns == 0
    # What waits: a frame, the reserve and the filter's samples; the browser works in blocks.
    assert max(delays) < FRAME + RESERVE + FILTER / rate + 3 * 128 / context_rate
    inner = sound[context_rate // 2 : -context_rate // 2]
    power = np.abs(np.fft.rfft(inner * np.blackman(len(inner)))) ** 2
    is_tone = np.abs(np.fft.rfftfreq(len(inner), 1 / context_rate) - 100) < 5
    assert power[~is_tone].sum() < 1e-4 * power.sum()
    assert np.std(inner) == pytest.approx(1 / np.sqrt(2), rel=0.02)


def test_samples_that_are_late_once_are_heard_softly_and_soon_forgotten(page: Page) -> None:
    arrivals = [FRAME * (k + 1) for k in range(360) if k not in (54, 55, 56)]
    sound, delays, underruns = played(page, arrivals)
    assert underruns == 1
    before, after, end = (delays[np.array(arrivals) < moment][-1] for moment in (0.9, 1.1, 6))
    late = 3 * FRAME - RESERVE  # what the reserve did not cover
    assert after - before == pytest.approx(late, abs=0.01)
    assert end - before == pytest.approx(0, abs=0.01)
    # No step is much larger than the tone's own.
    assert np.abs(np.diff(sound)).max() < 1.5 * 2 * np.pi * 100 / 48000


def test_samples_that_are_often_late_are_waited_for(page: Page) -> None:
    arrivals = [FRAME * (k + 1) for k in range(720) if k % 180 not in (54, 55, 56)]
    _, delays, underruns = played(page, arrivals)
    assert underruns == 2
    assert min(delays[np.array(arrivals) > 4]) > 0.06


def test_where_samples_are_lost_is_silence_and_no_delay(page: Page) -> None:
    arrivals = [FRAME * (k + 1) for k in range(110)]
    sound, delays, underruns = played(page, arrivals, lost=(54, 55, 56))
    assert underruns == 0
    assert max(delays) - min(delays) < 0.01
    middle = round(48000 * (56 * FRAME + delays[-1]))
    assert np.abs(sound[middle - 500 : middle + 500]).max() == 0
    assert np.abs(np.diff(sound)).max() < 2 * 2 * np.pi * 100 / 48000


def test_what_is_chosen_is_heard_while_there_is_contact(page: Page, tones: Tones) -> None:
    def heard(low: float, high: float, loud: bool = True) -> bool:
        frequency, level = page.evaluate("heard()")
        return (low < frequency < high and level > -60) if loud else level < -90

    def wait(*wanted: Any) -> None:
        wait_until(lambda: heard(*wanted), f"{wanted}: {page.evaluate('heard()')}")

    page.locator("#sound-on").click()
    page.evaluate(LISTEN)
    wait(190, 210)
    page.locator("[data-sound=desired]").click()
    wait(70, 90)
    tones.amplitude = 0.0
    wait(0, 0, False)
    tones.amplitude = 3.0
    wait(70, 90)
    page.locator("#sound-mute").click()
    wait(0, 0, False)
    page.locator("#sound-mute").click()
    wait(70, 90)
    shown = page.locator("#sound-delay")
    pattern = r"delay: buffer \d+ ms, output \d+ ms; underruns: \d+"
    wait_until(lambda: bool(re.fullmatch(pattern, shown.inner_text())), "the delay is shown")
    page.locator("#sound-on").click()
    wait_until(lambda: shown.inner_text() == "off", "off")


def test_while_sound_comes_late_the_page_draws_less(page: Page) -> None:
    page.locator("#sound-on").click()
    wait_until(lambda: page.evaluate("hapticSound.stream.rate") is not None, "sound is played")
    # As on a machine on which drawing holds up what is to be played.
    page.evaluate(
        "Object.defineProperty(hapticSound.stream, 'delay', { get: () => 0.1, set: () => {} })"
    )
    drawn, seconds = page.evaluate(
        """async () => {
          const [before, begin] = [hapticScope.counters.drawn, performance.now()];
          await new Promise((resolve) => setTimeout(resolve, 1000));
          return [hapticScope.counters.drawn - before, (performance.now() - begin) / 1e3];
        }"""
    )
    assert 1 <= drawn <= seconds / 0.045 + 2
    page.locator("#sound-on").click()
