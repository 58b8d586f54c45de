"""What `ros2 bag play` publishes in the slave's place, beside the replay device."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bag_maker import NANOSECONDS, write_bag
from haptic_accel.bags.reading import Bag, Signal, read_bag
from haptic_accel.core import topics
from haptic_accel.core.topics import Topic
from running import Command

Start = Callable[..., Command]

RATE = 200.0
"""Of what is played, Hz: a busy machine then rarely misses a sample."""

SECONDS = 2.0

MEMORY = 0.3
"""After which the paper's high-pass has forgotten a lost sample but for some 1e-5, s."""


def tool_acceleration() -> np.ndarray:
    """Return a texture of three tones, quiet in its first half second."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    tones = [np.sin(2 * np.pi * frequency * time) for frequency in (21.0, 34.0, 55.0)]
    return np.where(time < 0.5, 0.0, 2.0 * np.sum(tones, axis=0))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a bag at `RATE` that knows nothing but the slave's signals."""
    samples = round(SECONDS * RATE)
    turn = np.linspace(0.0, 2 * np.pi, samples)
    path = 0.01 * np.column_stack([1 - np.cos(turn), np.zeros(samples), -np.sin(turn)])
    rows: dict[Topic, np.ndarray] = {
        topics.TOOL_ACCELERATION: np.column_stack([np.zeros((samples, 2)), tool_acceleration()]),
        topics.SLAVE_POSITION: path,
        topics.SLAVE_VELOCITY: np.gradient(path, axis=0) * RATE,
    }
    return write_bag(tmp_path / "played", rows, RATE)


def on_bag(stamps: np.ndarray, found: Signal, values: np.ndarray) -> np.ndarray:
    """Return which sample of the bag each moved stamp belongs to, by the first that is moving."""
    moving = np.flatnonzero(found.values[:, 2])[0]
    sample = np.flatnonzero(values == found.values[moving, 2])[0]
    steps = (stamps - found.stamps[moving]) * RATE / NANOSECONDS
    return np.rint(steps).astype(int) + int(sample)


def desired_by_sample(recorded: Bag) -> dict[int, float]:
    """Return the desired acceleration by sample of the bag, where nothing was lost before."""
    tool = recorded.signals[topics.TOOL_ACCELERATION.name]
    desired = recorded.signals[topics.DESIRED_ACCELERATION.name]
    values = tool_acceleration()
    places = on_bag(tool.stamps, tool, values)
    inside = (places >= 0) & (places < len(values))
    # What was played is what was recorded, to the last bit.
    assert np.array_equal(tool.values[inside, 2], values[places[inside]])
    whole = set(places.tolist())
    of_desired = on_bag(desired.stamps, tool, values)
    memory = round(MEMORY * RATE)
    return {
        place: value
        for place, value in zip(of_desired.tolist(), desired.values[:, 2], strict=True)
        if place < len(values) and whole.issuperset(range(place - memory + 1, place + 1))
    }


def test_the_device_and_played_topics_give_the_controller_the_same_input(
    haptic_accel: Start, start: Start, bag: Path, tmp_path: Path
) -> None:
    words = ("replay", bag, "controller:=constant", "rig:=ideal")
    by_device = haptic_accel(*words, "output:=device")
    assert by_device.end() == 0, by_device.text
    assert "Traceback" not in by_device.text
    by_topics = haptic_accel(*words, "source:=topics", "output:=topics")
    by_topics.wait_for("ros2 bag play .* --remap")
    by_topics.wait_for("ready: play")
    player = start(Path(__file__).parents[1] / "bag_player.py", bag)
    assert player.end() == 0, player.text
    assert by_topics.end(signal.SIGINT) == 0, by_topics.text

    from_device, from_topics = (read_bag(tmp_path / name) for name in ("device", "topics"))
    one, other = desired_by_sample(from_device), desired_by_sample(from_topics)
    both = sorted(one.keys() & other.keys())
    assert len(both) > 50
    scale = np.std(tool_acceleration())
    for place in both:
        assert other[place] == pytest.approx(one[place], abs=1e-3 * scale)
    check_what_was_recorded(from_device, bag, "replay")
    check_what_was_recorded(from_topics, bag, "topics")
    # The end brings the actuator to rest before the graph ends.
    force = from_device.signals[topics.ACTUATOR_FORCE.name].values[:, 2]
    assert np.abs(force).max() > 0.1
    assert np.abs(force[-10:]).max() < 1e-3


def check_what_was_recorded(recorded: Bag, bag: Path, slave: str) -> None:
    """Check that a bag says what was replayed, and that every force was caused by a sample."""
    assert recorded.facts["arguments"]["replay"] == str(bag)
    assert recorded.facts["arguments"]["slave"] == slave
    desired = recorded.signals[topics.DESIRED_ACCELERATION.name]
    force = recorded.signals[topics.ACTUATOR_FORCE.name]
    caused = dict(zip(desired.stamps.tolist(), desired.values[:, 2], strict=True))
    pairs = [
        (caused[stamp], value)
        for stamp, value in zip(force.stamps.tolist(), force.values[:, 2], strict=True)
        if stamp in caused
    ]
    # Table I: the constant gain is the 0.128 kg of handle and hand.
    assert all(value == pytest.approx(0.128 * cause, abs=1e-12) for cause, value in pairs)
    # Moved stamps keep the bag's spacing exactly.
    if slave == "topics":
        stamps = recorded.signals[topics.TOOL_ACCELERATION.name].stamps
        assert set(np.diff(stamps) % round(NANOSECONDS / RATE)) == {0}
