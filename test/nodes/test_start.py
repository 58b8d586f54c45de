# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executables of the nodes, as setuptools' scripts call them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from haptic_accel.core.outside import node_module
from running import PATIENCE

SETUP = Path(__file__).resolve().parents[2] / "setup.py"


def test_every_executable_is_a_module_of_a_node() -> None:
    found = re.search(r"^NODES = \((.*?)\)", SETUP.read_text(), flags=re.M | re.S)
    assert found
    nodes = re.findall(r'"(\w+)"', found[1])
    assert len(nodes) >= 9
    for node in nodes:
        spec = find_spec(node_module(node))
        assert spec
        assert spec.origin
        assert "\ndef main() -> None:" in Path(spec.origin).read_text()


@pytest.mark.parametrize("node", ["coupler", "recorder"])
def test_a_node_that_is_interrupted_while_it_loads_ends_without_a_word(
    node: str, tmp_path: Path
) -> None:
    (tmp_path / "rclpy.py").write_text("import time\nprint('loading', flush=True)\ntime.sleep(60)")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    program = f"from haptic_accel.nodes.start import {node} as main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        shown, errors = process.communicate(timeout=PATIENCE)
    assert (shown, errors, process.returncode) == ("", "", 0)
