# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Make the golden bags of the tests, and the figures of their lockstep replay.

``python benchmarks/make_golden.py`` runs the simulated rig in lockstep and keeps what the slave
gave, and the handle's acceleration; for when what the bags hold is to change. With ``--figures``
the bags stay and only the figures are made again, which a change of rig or controller may ask for,
and whoever reads the change then sees.
"""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test/support"))
from bag_maker import BagContent, write_bag
from haptic_accel import FloatArray, GraphArguments, Setup, Vector
from haptic_accel.core import Compensation, topics
from haptic_accel.core.rig.master_rig import MasterRig
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.core.tick import PositionPositionCoupling
from haptic_accel.core.topics import SLAVE_SIGNALS, Topic
from verbs import status_of

FOLDER = Path(__file__).resolve().parents[1] / "test/data"
FIGURES = FOLDER / "golden.json"
SURFACES = ("plywood", "text")
TOPICS = (*SLAVE_SIGNALS, topics.HANDLE_ACCELERATION)
CONTROLLERS = ("none", "constant", "dynamic", "inverse")
PRESENTED = 1_255_392_000_000_000_000
"""First stamp: 13 October 2009, when the paper was presented; ns."""

SKIPPED, KEPT = 1.0, 1.1
"""s; after the first second the tool drags over the surface."""


def main() -> None:
    """Write the files."""
    bags = [FOLDER / surface for surface in SURFACES]
    if "--figures" not in sys.argv:
        for bag in bags:
            arguments = GraphArguments(surface=bag.name, rig="paper")
            shutil.rmtree(bag, ignore_errors=True)
            stated = {"arguments": asdict(arguments)}
            signals = {topic.name: rows for topic, rows in samples(arguments).items()}
            recorded = BagContent(signals, arguments.rate, stated, arms=False, start=PRESENTED)
            write_bag(bag, recorded, compressed=True)
    words = ["replay", *bags, "--lockstep", "--controllers", ",".join(CONTROLLERS)]
    assert status_of(*words, "--json", FIGURES) == 0
    content = json.loads(FIGURES.read_text(encoding="utf-8"))
    for condition in content["conditions"]:
        condition["bag"] = Path(condition["bag"]).name
    FIGURES.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def samples(arguments: GraphArguments) -> dict[Topic, FloatArray]:
    """Return what the topics carry, with numbers of single precision: they compress well."""
    rows: dict[Topic, list[Vector]] = {topic: [] for topic in TOPICS}
    setup = Setup.of(arguments)
    rig = setup.rig()
    around, controllers = setup.node("compensator")
    master = MasterRig(rig.master, arguments.rate, arguments.seed)
    slave = SlaveRig(rig.slave, arguments.rate, arguments.seed)
    coupling = PositionPositionCoupling(rig.coupling)
    compensation = Compensation(around, arguments.rate, controllers, latency=0)
    before = None
    for index in range(round((SKIPPED + KEPT) * arguments.rate)):
        for side in (master, slave):
            side.advance(index / arguments.rate)
        handle, tool = master.measure(), slave.measure()
        if not coupling.engaged:
            coupling.engage(handle.position, tool.position)
        on_master, on_slave = coupling.forces(handle.position, tool.position)
        _, force = compensation.process(tool.acceleration, before)
        master.apply_arm_force(on_master)
        slave.apply_arm_force(on_slave)
        master.apply_actuator_force(force)
        before = handle.acceleration
        if index >= SKIPPED * arguments.rate:
            rows[topics.HANDLE_ACCELERATION].append(handle.acceleration)
            rows[topics.SLAVE_POSITION].append(tool.position)
            rows[topics.SLAVE_VELOCITY].append(tool.velocity)
            rows[topics.TOOL_ACCELERATION].append(tool.acceleration)
    return {topic: np.array(vectors, np.float32).astype(float) for topic, vectors in rows.items()}


if __name__ == "__main__":
    main()
