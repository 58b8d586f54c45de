# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Time from one condition of a study to the next, and what is delivered, on this machine.

``python benchmarks/study_conditions.py`` presents controllers at two gains by a live graph with a
hand that strokes by itself.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.kits.study.live import LiveRig
from haptic_accel.kits.study.protocol import Condition, Consent, Protocol
from haptic_accel.kits.study.trials import PresentedStimulus

SECONDS = 2.0
"""Duration of a stimulus, s."""

ROUNDS = 4
"""Presentations of each condition."""

CONDITIONS = tuple(
    Condition((("controller", controller), ("gain", gain)))
    for controller, gain in itertools.product(("none", "inverse", "adaptive"), (0.5, 1.0))
)


def main() -> None:
    """Present all conditions in turn, and print times and measures."""
    protocol = Protocol(
        title="benchmark",
        task="identification",
        question="",
        graph={"rig": "ideal"},
        factors={},
        conditions=CONDITIONS,
        pairs=(),
        consent=Consent("", ""),
        instructions="",
        digest="",
        source=Path("study.yaml").absolute(),
        content="",
    )
    presented: list[tuple[Condition, PresentedStimulus]] = []
    with tempfile.TemporaryDirectory() as folder:
        begun = time.monotonic()
        with LiveRig(protocol, Path(folder)) as rig:
            print(f"start of the graph: {time.monotonic() - begun:.1f} s")
            for condition in CONDITIONS * ROUNDS:
                presented.append((condition, rig.present(condition, SECONDS)))
                print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    pauses = sorted(
        (after.begin - before.end) / NANOSECONDS
        for (_, before), (_, after) in itertools.pairwise(presented)
    )
    print(f"from stimulus to stimulus: {median(pauses):.2f} s, at most {pauses[-1]:.2f} s")
    for condition in CONDITIONS:
        own = [each for which, each in presented if which == condition]
        errors = [each.error for each in own if each.error is not None]
        lates = max(each.late for each in own)
        lost = max(each.lost for each in own)
        shown = f"{median(errors):.1f} %" if errors else "none"
        print(f"{condition}: error {shown}, late at most {lates:.1f} %, lost {lost:.2f} %")


if __name__ == "__main__":
    main()
