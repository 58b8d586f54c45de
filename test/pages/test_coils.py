# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page's sound on an output that is chosen, in a real browser with a real sound server."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
import pytest
from sound_servers import CONTROLLER, RATE, SPEAKERS, Recording, SoundServer, sound_server

from browsing import Tones, chromium, shown, violations
from nightly import rest_slow
from running import wait_until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

BOTH, LEFT = "2,3", "2"
"""Choices of grips."""

TONE = 200
"""Frequency of the actual acceleration of `Tones`, Hz."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SoundServer]:
    with sound_server(tmp_path_factory.mktemp("sound")) as found:
        yield found


@pytest.fixture(scope="module")
def loud(server: SoundServer) -> Iterator[Browser]:
    with chromium(server.environment) as browser:
        yield browser


@pytest.fixture
def tones() -> Iterator[Tones]:
    made = Tones()
    yield made
    made.playing = False


@pytest.fixture
def page(loud: Browser, tones: Tones) -> Iterator[Page]:
    size = {"width": 1280, "height": 900}
    with shown(loud, tones, permissions=["microphone"], viewport=size) as opened:
        yield opened


def choose(page: Page, output: str, grips: str = "") -> None:
    """Choose an output by its name, and grips."""
    page.locator("#sound-outputs").click()
    wait_until(lambda: output in page.locator("#sound-output").inner_text(), "outputs are named")
    page.select_option("#sound-output", label=output)
    if grips:
        page.select_option("#sound-channels", grips)


def loudness(recording: Recording, seconds: float = 0.25) -> np.ndarray:
    """Return the root mean square of each channel of late."""
    samples = recording.last(seconds)
    return np.sqrt((samples**2).mean(axis=0)) if len(samples) else np.zeros(1)


def expected(page: Page, amplitude: float) -> float:
    """Return the loudness of a tone: full scale is 10 m/s² at full volume, bent by a tanh."""
    volume = float(page.locator("#sound-volume").input_value()) / 100
    phase = 2 * np.pi * np.arange(1000) / 1000
    played = np.tanh(volume**2 * amplitude / 10 * np.sin(phase))
    return float(np.sqrt((played**2).mean()))


def test_only_the_grips_carry_the_signal_at_its_level(
    page: Page, server: SoundServer, tones: Tones
) -> None:
    choose(page, CONTROLLER, BOTH)
    with server.recording(CONTROLLER) as coils, server.recording(SPEAKERS) as speakers:
        page.locator("#sound-on").click()
        assert float(page.locator("#sound-volume").input_value()) == 30  # it was 70
        level = expected(page, tones.amplitude)
        wait_until(lambda: 0 < loudness(coils)[-1] < 0.5 * level, "it begins softly")
        close = pytest.approx([0, 0, level, level], rel=0.05, abs=1e-5)
        wait_until(lambda: loudness(coils) == close, f"{loudness(coils)} is {level}")
        played = coils.last(1.0)
        assert not np.any(speakers.last(60.0))
    first, second, left, right = played.T
    assert not np.any(first)
    assert not np.any(second)
    assert np.array_equal(left, right)
    spectrum = np.abs(np.fft.rfft(left * np.hanning(len(left))))
    assert np.fft.rfftfreq(len(left), 1 / RATE)[spectrum.argmax()] == pytest.approx(TONE, abs=10)


def test_nothing_waits_for_an_output_that_does_not_run_yet(page: Page) -> None:
    choose(page, CONTROLLER, BOTH)
    page.evaluate(
        """() => {
          window.moments = [];
          const { take } = hapticSound.Stream.prototype;
          hapticSound.Stream.prototype.take = function (...given) {
            moments.push(this.context.currentTime);
            take.apply(this, given);
          };
        }"""
    )
    page.locator("#sound-on").click()
    wait_until(lambda: page.evaluate("moments.length > 60"), "it plays")
    # Frames come 60 times a second; the context's time stands still until its device runs. Later,
    # a busy machine delivers several frames at once.
    _, first = next(groupby(page.evaluate("moments")))
    assert len(list(first)) < 6


PREDICT = """() => {
  window.predicted = null;
  const take = hapticSound.take;
  hapticSound.take = (name, origin, offsets, values, rate) => {
    take(name, origin, offsets, values, rate);
    const first = values.findIndex((value) => Math.abs(value) > 0.5);
    if (name !== "actual" || predicted || first < 0) return;
    const { stream, context } = hapticSound; // the delay is that of the newest sample
    const ahead = offsets.at(-1) - offsets.at(first);
    const now = (performance.timeOrigin + performance.now()) / 1e3;
    predicted = [origin + offsets.at(first), now + stream.delay + context.outputLatency - ahead];
  };
}"""
"""Script that notes the stamp of the first sample of a tone, and when it is to sound, s."""


def test_the_coils_play_when_the_page_says(page: Page, server: SoundServer, tones: Tones) -> None:
    choose(page, CONTROLLER, BOTH)
    page.evaluate(PREDICT)
    page.locator("#sound-on").click()
    page.locator("#sound-volume").fill("60")

    with server.recording(CONTROLLER) as coils:

        def is_right() -> bool:
            """Let a tone begin, and compare; what a busy machine delays further is made again."""
            tones.amplitude = 0.0
            wait_until(
                lambda: len(coils.last(0.5)) == RATE / 2 and not coils.last(0.5).any(), "still"
            )
            coils.forget()
            page.evaluate("predicted = null")
            tones.amplitude = 3.0
            wait_until(lambda: coils.begin(2, 0.003) is not None, "the coils play")
            begun = coils.begin(2, 0.003)
            stamp, sound = page.evaluate("predicted")
            return begun - stamp == pytest.approx(sound - stamp, rel=0.3)

        wait_until(is_right, "the delay is that which the page states, within 30 %")


@pytest.mark.slow
def test_one_grip_alone_and_the_loudspeakers_again(
    page: Page, server: SoundServer, tones: Tones
) -> None:
    choose(page, CONTROLLER, LEFT)
    with server.recording(CONTROLLER) as coils, server.recording(SPEAKERS) as speakers:
        page.locator("#sound-on").click()
        page.locator("#sound-volume").fill("50")
        level = expected(page, tones.amplitude)
        close = pytest.approx([0, 0, level, 0], rel=0.05, abs=1e-5)
        wait_until(lambda: loudness(coils) == close, f"{loudness(coils)} is {level}")
        page.select_option("#sound-output", "")
        wait_until(lambda: loudness(speakers)[0] > 0.5 * level, "the loudspeakers play")
        wait_until(lambda: not np.any(coils.last(0.25)), "the coils are still")


def test_an_output_of_two_channels_offers_no_grips_and_says_why(page: Page) -> None:
    # As Chromium sees outputs of a sound server whose default is two.
    count = "'maxChannelCount', { get: () => 2 }"
    page.evaluate(f"Object.defineProperty(AudioDestinationNode.prototype, {count})")
    choose(page, CONTROLLER)
    note = page.locator("#sound-output-note")
    wait_until(lambda: note.inner_text().startswith("2 channels reach this output"), "why")
    assert page.locator("#sound-channels").is_hidden()


def test_an_output_that_goes_away_is_said_and_sound_is_off(
    page: Page, server: SoundServer
) -> None:
    extra = server.ask(
        "load-module", "module-null-sink", "sink_name=spare", "channels=4",
        "sink_properties=device.description=spare",
    )  # fmt: skip
    choose(page, "spare", BOTH)
    page.locator("#sound-on").click()
    wait_until(lambda: page.locator("#sound-delay").inner_text().startswith("delay"), "it plays")
    server.ask("unload-module", extra.strip())
    told = "The output spare is gone, and sound is off: plug it in, and choose it again."
    wait_until(lambda: told in page.locator("#message").inner_text(), "it is said")
    assert page.locator("#sound-on[aria-pressed=false]").count() == 1
    assert page.locator("#sound-output").input_value() == ""
    with server.recording(SPEAKERS) as speakers:
        wait_until(lambda: len(speakers.last(1.0)) == RATE, "recorded")
        assert not np.any(speakers.last(0.5))
        page.locator("#sound-on").click()
        wait_until(lambda: loudness(speakers)[0] > 0, "on the loudspeakers if asked to")


def test_without_permission_the_page_says_what_to_do(loud: Browser, tones: Tones) -> None:
    with shown(loud, tones) as opened:
        opened.locator("#sound-outputs").click()
        note = opened.locator("#sound-output-note")
        wait_until(lambda: "allow the microphone" in note.inner_text(), "what to do")


def test_a_browser_that_cannot_choose_says_so_in_one_sentence(loud: Browser, tones: Tones) -> None:
    as_in_firefox = "delete AudioContext.prototype.setSinkId"
    with shown(loud, tones, script=as_in_firefox) as opened:
        wait_until(lambda: opened.locator("#sound-outputs").is_hidden(), "no button")
        said = opened.locator("#sound-output-note").inner_text()
    assert said.startswith("To feel it in a game controller, open this page in Chromium, Chrome")
    assert said.count(".") == 1


@pytest.mark.parametrize("scheme", rest_slow(["light", "dark"]))
def test_no_rule_of_accessibility_is_broken(page: Page, scheme: str) -> None:
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    choose(page, CONTROLLER, BOTH)
    assert violations(page) == []
