# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags played once more: in lockstep against golden figures, and what a user says of it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bag_maker import BagContent, write_bag
from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.devices.playback import ReplayParameters, read_track
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.lockstep import lockstep_trial, record_trial
from haptic_accel.setup.setup import Setup
from running import Start
from verbs import next_command, output_of, refusal, status_of

DATA = Path(__file__).parents[1] / "data"
GOLDEN = json.loads((DATA / "golden.json").read_text(encoding="utf-8"))["conditions"]
FIGURES = ("nrmse_percent", "slope_desired_on_actual", "slope_actual_on_desired", "r2")

TOLERANCE = 1e-6
"""Tolerance of figures, as a part of them and of 1. One machine gives the same bits every time,
and other kernels of its BLAS the same figures within 1e-15; another mathematical library or
processor may round otherwise. What a change of behaviour does is far larger."""


def bag_of(path: Path, topic: topics.Topic, samples: int) -> Path:
    """Return a bag that holds one signal, of zeros."""
    return write_bag(path, BagContent({topic.name: np.zeros((samples, 3))}, arms=False))


def test_golden_bags_give_their_golden_figures_and_the_same_ones_again(tmp_path: Path) -> None:
    bags = list(dict.fromkeys(condition["bag"] for condition in GOLDEN))
    controllers = list(dict.fromkeys(condition["controller"] for condition in GOLDEN))
    words = [*(DATA / bag for bag in bags), "--lockstep", "--controllers", ",".join(controllers)]
    texts = []
    for file in (tmp_path / "one.json", tmp_path / "two.json"):
        assert status_of("replay", *words, "--json", file) == 0
        texts.append(file.read_bytes())
    assert texts[0] == texts[1]
    found = json.loads(texts[0])["conditions"]
    assert len(found) == len(GOLDEN) == 8
    for one, golden in zip(found, GOLDEN, strict=True):
        assert (Path(one["bag"]).name, one["controller"]) == (golden["bag"], golden["controller"])
        assert (one["latency_samples"], one["after_samples"]) == (1, 2)
        for name in FIGURES:
            assert one[name] == pytest.approx(golden[name], rel=TOLERANCE, abs=TOLERANCE), one


def test_golden_figures_are_as_the_paper_orders_them() -> None:
    for bag in ("plywood", "text"):
        none, constant, dynamic, inverse = (
            condition["nrmse_percent"] for condition in GOLDEN if condition["bag"] == bag
        )
        assert none > 99 > constant > dynamic > inverse


def test_what_came_of_it_is_a_bag_that_says_how_it_was_made(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [DATA / "text", "--lockstep", "--controllers", "constant", "--out", out]
    assert next_command(output_of("replay", *words)) == ["analyze", str(out)]
    bag = read_bag(out / "text_constant")
    assert bag.problems == []
    arguments = bag.metadata["arguments"]
    assert (arguments["controller"], arguments["surface"]) == ("constant", "text")
    assert arguments["replay"] == str(DATA / "text")
    desired = bag.signals[topics.DESIRED_ACCELERATION.name].values[:, 2]
    force = bag.signals[topics.ACTUATOR_FORCE.name]
    # Table I: the constant gain is the 0.128 kg of handle and hand.
    assert force.values[:, 2] == pytest.approx(0.128 * desired, abs=1e-12)
    assert set(np.diff(force.stamps)) == {1_000_000}
    golden = read_bag(DATA / "text").signals[topics.TOOL_ACCELERATION.name].values
    assert np.array_equal(bag.signals[topics.TOOL_ACCELERATION.name].values[2:], golden)


def test_bags_in_which_nothing_was_recorded_are_named_and_skipped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = bag_of(tmp_path / "empty", topics.TOOL_ACCELERATION, 0)
    other = bag_of(tmp_path / "other", topics.MASTER_POSITION, 300)
    words = [empty, DATA / "text", other, DATA / "plywood", "--lockstep"]
    assert status_of("replay", *words, "--json", tmp_path / "metrics.json") == 0
    skipped = capsys.readouterr().err.splitlines()
    why = "has no message of slave/tool/acceleration"
    assert skipped == [f"skipped: {bag}: {why}" for bag in (empty, other)]
    played = json.loads((tmp_path / "metrics.json").read_text())["conditions"]
    assert [Path(each["bag"]).name for each in played] == ["text", "plywood"]
    assert refusal("replay", empty, other, "--lockstep").startswith(f"{empty}: has no message of")


def test_a_bag_of_a_virtual_tool_is_replayed_under_the_name_of_its_scene(tmp_path: Path) -> None:
    arguments = GraphArguments(slave="virtual", duration=1.5)
    setup = Setup.of(arguments)
    record_trial(tmp_path / "bag", lockstep_trial(setup), setup, 0)
    words = ["--lockstep", "controller:=constant", "--json", tmp_path / "metrics.json"]
    assert status_of("replay", tmp_path / "bag", *words) == 0
    (played,) = json.loads((tmp_path / "metrics.json").read_text())["conditions"]
    assert (played["surface"], played["controller"]) == ("workshop", "constant")


def test_a_part_of_a_bag_is_played(tmp_path: Path) -> None:
    track = read_track(ReplayParameters(str(DATA / "text")), topics.SLAVE, 1000.0)
    words = ["start:=0.3", "duration:=0.6", "--lockstep", "--controllers", "none"]
    assert status_of("replay", DATA / "text", *words, "--out", tmp_path / "out") == 0
    played = read_bag(tmp_path / "out" / "text_none").signals[topics.TOOL_ACCELERATION.name]
    # After the latency of one sample and the first force it plays.
    assert np.array_equal(played.values[2:, 2], track.acceleration[300:900])


@pytest.mark.quiet
def test_a_terminal_shows_how_far_a_replay_is(start: Start, tmp_path: Path) -> None:
    in_terminal = "import pty, sys; sys.exit(pty.spawn([sys.executable, *sys.argv[1:]]) >> 8)"
    words = ["-m", "haptic_accel.cli.main", "replay", DATA / "text", "rate:=1", "output:=bag"]
    command = start("-c", in_terminal, *words)
    command.wait_for("waiting for the arms.* 0 %")
    assert command.end() == 0, command.text
    shares = [int(share) for share in re.findall(r"replaying.*? (\d+) %", command.text)]
    assert shares == sorted(shares)
    assert shares[-1] == 100
    assert "\\x1b" not in command.text
    assert read_bag(tmp_path / "bag").problems == []
