# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Leader and follower with coil and accelerometers on one sound card of JACK, without hardware."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kits.lerobot.plug_ins import PlugIns, child, connected, plug_ins

from haptic_accel.devices import DeviceError
from running import wait_until
from sound_cards import SOUND_RIG, sound_world

TEXTURE = 2.0
"""Acceleration of the world's tool, m/s^2 RMS."""

SCALE = 100.0
"""Acceleration at the card's full scale, m/s^2."""


class Bench:
    """Plug-ins at a card, and a listener at the handle's accelerometer."""

    def __init__(self, built: PlugIns, words: str) -> None:
        import jack

        self.built, self.words = built, words
        self._client = jack.Client("listener")
        port = self._client.inports.register("handle")
        self._power, self._count = 0.0, 0

        def listen(frames: int) -> None:
            heard = SCALE * port.get_array().astype(float)
            self._power += float(heard @ heard)
            self._count += frames

        self._client.set_process_callback(listen)
        self._client.activate()
        self._client.connect("world:handle", port)

    def moved(self, seconds: float = 1.0, leader: Any = None) -> float:
        """Return the handle's acceleration m/s^2 RMS, for a time in which a leader is asked."""
        self._power, self._count = 0.0, 0
        enough = seconds * self._client.samplerate

        def heard() -> bool:
            return (leader is None or bool(leader.get_action())) and self._count > enough

        wait_until(heard, "sound of the handle")
        return float(np.sqrt(self._power / self._count))

    def close(self) -> None:
        self._client.deactivate()
        self._client.close()


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    with sound_world(tmp_path) as (environment, _), plug_ins() as built:
        for name in ("JACK_DEFAULT_SERVER", "JACK_NO_START_SERVER"):
            monkeypatch.setenv(name, environment[name])
        file = tmp_path / "rig.yaml"
        file.write_text(SOUND_RIG)
        found = Bench(built, f"params_file:={file} rig:=ideal latency:=17 controller:=inverse")
        yield found
        found.close()


@pytest.mark.live
def test_the_handle_moves_as_the_gripper_does_while_the_leader_is_connected(bench: Bench) -> None:
    leader = bench.built.leader(bench.words)
    follower = bench.built.follower(bench.words)
    with connected(follower):
        still = bench.moved()
        samples = [follower.vibration() for _ in range(20) if bench.moved(0.05)]
        assert np.std(samples) == pytest.approx(TEXTURE, rel=0.2)
        with connected(leader):
            moving = bench.moved(leader=leader)
            assert leader.get_action() == {"joint.pos": 0.25}
        wait_until(lambda: bench.moved(0.2) < 0.1 * moving, "silence")
    assert moving == pytest.approx(TEXTURE, rel=0.3)
    assert still < 0.1 * moving


@pytest.mark.live
def test_a_sensor_that_does_not_answer_the_coil_is_told_in_one_line(bench: Bench) -> None:
    # The tool's input in place of the handle's.
    file = Path(bench.words.split()[0].partition(":=")[2])
    file.write_text(SOUND_RIG.replace('inputs: "1"', 'inputs: "2"'))
    leader = bench.built.leader(bench.words)
    with pytest.raises(DeviceError, match="handle's accelerometer does not answer") as error:
        leader.connect()
    assert "\n" not in str(error.value)
    assert not leader.is_connected


@pytest.mark.live
def test_a_leader_goes_on_when_its_card_is_lost(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    leader = bench.built.leader(bench.words)
    with connected(leader):
        caplog.clear()
        os.kill(child("jackd"), signal.SIGTERM)
        wait_until(lambda: leader.get_action() and caplog.records, "warning")
        assert leader.get_action() == {"joint.pos": 0.25}
    assert caplog.text.count("the arms go on without vibration") == 1
