# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The coupler in a graph: gains that change while the arms are coupled."""

from __future__ import annotations

import signal
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.topics import MASTER, SLAVE
from observing import Observer
from running import Start


@pytest.mark.slow
def test_gains_fade_in_while_the_arms_are_coupled(
    haptic_accel: Start, observer: Observer, tmp_path: Path
) -> None:
    def wait_for_forces(count: int) -> None:
        name = "arm force count"
        so_far = int(observer.status("master_device")[name])
        observer.status("master_device", least={name: so_far + count})

    graph = haptic_accel("teleop", "bag:=bag", "latency:=2")
    graph.wait_for("engaged")
    for values, samples in (
        ({"scale": 2.0}, 500),
        # The damper needs velocities, which nobody has asked for so far.
        ({"scale": 1, "k_m": 400.0, "k_sl": 300.0, "damping": 2.0}, 2000),
    ):
        wait_for_forces(200)
        parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        request = SetParameters.Request(parameters=parameters)
        (result, *_) = observer.call(SetParameters, "coupler/set_parameters", request).results
        assert result.successful, result.reason
        wait_for_forces(samples)
    assert graph.end(signal.SIGINT) == 0, graph.text
    found = read_bag(tmp_path / "bag").signals
    force = found[MASTER.arm_force.name]
    # Without a fade, 1 N in contact would become 1.6 N from one sample to the next.
    coupled = np.any(force.values != 0.0, axis=1)
    following = coupled[1:] & coupled[:-1] & (np.diff(force.stamps) < 1_500_000)
    steps = np.linalg.norm(np.diff(force.values, axis=0), axis=1)[following]
    assert 0 < steps.max() < 0.2
    # The gains are those of the forces: f = -k_m lag - b slip, along the actuator.
    start, rate = int(force.stamps[-1]) - 1_500_000_000, 1000.0
    measured = MASTER.position, SLAVE.position, MASTER.velocity, SLAVE.velocity
    topics = (MASTER.arm_force, *measured)
    (pull, felt), *motion = (found[each.name].on_grid(start, rate, 1400) for each in topics)
    there = np.logical_and.reduce([felt, *(here for _, here in motion)])
    m, s, m_velocity, s_velocity = (values[there] for values, _ in motion)
    columns = np.stack([s - m, s_velocity - m_velocity, np.ones(len(m))], axis=1)
    (stiffness, damping, _), *_ = np.linalg.lstsq(columns, pull[there], rcond=None)
    assert (stiffness, damping) == pytest.approx((400.0, 2.0), rel=0.02)


def test_a_passive_coupling_keeps_account_and_takes_other_gains_of_its_own_alone(
    haptic_accel: Start, observer: Observer, tmp_path: Path
) -> None:
    graph = haptic_accel("teleop", "bag:=bag", "coupling:=passive")
    graph.wait_for("engaged")
    for name, refused in (("k_m", "k_m: the coupling is passive"), ("stiffness", "")):
        parameters = [Parameter(name, value=200.0).to_parameter_msg()]
        request = SetParameters.Request(parameters=parameters)
        (result, *_) = observer.call(SetParameters, "coupler/set_parameters", request).results
        assert (result.successful, result.reason) == (not refused, refused)
    observer.collect((SLAVE.arm_force,), 1000)
    assert graph.end(signal.SIGINT) == 0, graph.text
    bag = read_bag(tmp_path / "bag")
    force, height = (bag.signals[topic.name].values for topic in (SLAVE.arm_force, SLAVE.position))
    assert np.any(force)
    assert height[-1, 2] < height[0, 2] - 5e-3, "the slave follows the hand to the surface"
    own = [each.values for each in bag.diagnostics if each.node == "coupler"]
    arms = ("master", "slave")
    energies = [float(each[f"{arm} energy (mJ)"]) for each in own for arm in arms]
    assert energies
    assert all(map(np.isfinite, energies))
