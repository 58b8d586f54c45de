# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Surprises without end: a graph that is right after the first has to be right after the tenth.

``CHAOS_SEED=7 CHAOS_MINUTES=10 python -m pytest --slow -s -p no:rerunfailures test/chaos`` goes on
for so long with other surprises in each of the three arrangements; without, there is one of each
kind in the first.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from random import Random

import pytest

from chaos.acts import Acts
from chaos.live_graph import ARRANGEMENTS, LiveGraph
from observing import Observer

SEED = int(os.environ.get("CHAOS_SEED", "1"))
MINUTES = float(os.environ.get("CHAOS_MINUTES", "0"))

ROUND = 480
"""Time for one act of each kind on a machine that is very slow, s."""


@pytest.mark.slow
@pytest.mark.timeout(MINUTES * 60 + ROUND)
@pytest.mark.parametrize("arrangement", ARRANGEMENTS if MINUTES else ARRANGEMENTS[:1])
def test_every_promise_is_kept_after_every_surprise(
    domain: int, observer: Observer, tmp_path: Path, arrangement: str
) -> None:
    random = Random(SEED)
    began = time.monotonic()
    told = [f"seed {SEED}"]

    def tell(what: str) -> None:
        told.append(f"{time.monotonic() - began:7.2f} s  {what}")
        print(told[-1], flush=True)

    controller = random.choice(("constant", "dynamic", "adaptive"))
    graph = LiveGraph(tmp_path, observer, controller, arrangement)
    acts = Acts(graph, random, tell)
    deck = random.sample(acts.kinds, len(acts.kinds))
    done = 0
    try:
        while deck or time.monotonic() < began + MINUTES * 60:
            graph.wait_for(graph.flow(), "forces flow")
            graph.forget()
            deck = deck or random.sample(acts.kinds, len(acts.kinds))
            deck.pop()()
            done += 1
        graph.wait_for(graph.flow(), "forces flow")
        assert graph.viewed, "the live page was never seen"
        graph.end_all()
        tell(f"{done} acts, no promise broken")
    except AssertionError as broken:
        raise AssertionError("\n".join((*told, f"promise broken: {broken}"))) from broken
    finally:
        graph.kill_all()
