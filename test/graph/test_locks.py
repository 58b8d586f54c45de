# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One graph in a namespace of a ROS domain, and one sender of each signal."""

from __future__ import annotations

import signal
from contextlib import closing

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import MASTER_ARM_FORCE
from haptic_accel.graph.locks import lock_signal, sole_graph
from running import Start, sending
from verbs import refusal

TOPIC = f"/{MASTER_ARM_FORCE.name}"

pytestmark = pytest.mark.quiet


def test_a_signal_has_one_sender_until_that_ends_in_whatever_way(domain: int) -> None:
    with sending(domain, TOPIC) as process:
        with pytest.raises(ParameterError) as refused:
            lock_signal(domain, TOPIC)
        line = str(refused.value)
        assert f"ROS domain {domain}: has a sender of {TOPIC} already" in line
        assert f", process {process.pid} (" in line
        assert line.endswith("; stop it, or set another namespace or ROS_DOMAIN_ID")
        for _ in range(200):  # more often than it tells whose it is
            with pytest.raises(ParameterError, match="already"):
                lock_signal(domain, TOPIC)
        process.send_signal(signal.SIGKILL)
        process.wait()
        lock_signal(domain, TOPIC).close()


def test_other_domains_signals_and_namespaces_are_free(domain: int) -> None:
    long = f"/{'n' * 200}{TOPIC}"
    with (
        closing(lock_signal(domain, TOPIC)),
        closing(lock_signal(domain, f"/left{TOPIC}")),
        closing(lock_signal(domain, long)),
        closing(lock_signal(domain + 1, TOPIC)),
        pytest.raises(ParameterError),
    ):
        lock_signal(domain, long)


def test_a_graph_is_alone_in_its_namespace(domain: int) -> None:
    with sole_graph(""), sole_graph("/left"):
        for namespace, line in (("", "has a graph already"), ("/left", "has a graph in /left")):
            with pytest.raises(ParameterError, match=line), sole_graph(namespace):
                pass
    with sole_graph(""):
        pass
    for namespace in ("", "/left"):
        topic = f"{namespace}{TOPIC}"
        with (
            sending(domain, topic),
            pytest.raises(ParameterError, match=f"sender of {topic}"),
            sole_graph(namespace),
        ):
            pass
        with sending(domain, topic), sole_graph("/right"):
            pass


@pytest.mark.usefixtures("here")
def test_nodes_and_graphs_refuse_to_send_what_another_sends(start: Start, domain: int) -> None:
    coupler = start("-m", "haptic_accel.nodes.coupler")
    coupler.wait_for("waiting")
    said = f"has a sender of {TOPIC} already, process {coupler.process.pid} "
    second = start("-m", "haptic_accel.nodes.coupler")
    # A whole number will do for a real one.
    words = ("--ros-args", "-r", "__ns:=/left", "-p", "k_m:=300")
    elsewhere = start("-m", "haptic_accel.nodes.coupler", *words)
    assert second.end() == 2, second.text
    assert second.lines[-1].startswith(f"coupler: ROS domain {domain}: {said}"), second.text
    elsewhere.wait_for("waiting")
    for verb in (["teleop"], ["identify", "--out", "a"], ["experiment", "--out", "b"]):
        assert said in refusal(*verb)
    assert elsewhere.end(signal.SIGINT) == coupler.end(signal.SIGINT) == 0
