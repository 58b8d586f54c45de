# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The person's answers during a bring-up, without boards."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from haptic_accel.core.parameters import from_flat
from haptic_accel.kits.bringup import bench
from haptic_accel.kits.bringup.bench import BringUpArguments, Watched
from haptic_accel.kits.bringup.command_line import BringUp
from haptic_accel.setup.files import (
    note_step,
    noted_steps,
    read_parameter_file,
    update_parameter_file,
)


class Typist:
    """A person who types given answers, each once; the others stay empty or skip."""

    def __init__(self, at_resistor: list[str]) -> None:
        self._at_resistor = at_resistor
        self.lines: list[str] = []
        self.requests: list[str] = []
        self.asked = 0

    def begin(self, number: int, step: str, purpose: str) -> None: ...

    def tell(self, line: str) -> None:
        self.lines.append(line)

    def show(self, watched: Watched | None) -> None: ...

    def request(self, line: str) -> None: ...

    def ask(self, request: str, skip: str = "") -> str:
        if "resistor" in request:
            self.asked += 1
            return self._at_resistor.pop(0)
        if "without moving it" in request:
            raise EOFError
        return "s" if skip else ""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """Return a rig whose boards are calibrated, and not there."""
    path = tmp_path / "rig.yaml"
    board = {"serial": {"port": str(tmp_path / "none")}}
    update_parameter_file(path, {"master_device": {"device": "serial", **board}})
    for step in ("connect", "calibrate"):
        note_step(path, step, "before")
    return path


def test_only_s_skips_the_measurement_of_the_current_and_the_file_says_so(rig: Path) -> None:
    typist = Typist(["ok", "yes", "0.1", " S "])
    with pytest.raises(EOFError):
        BringUp(from_flat(BringUpArguments, {"file": str(rig)}), typist).run()
    assert typist.asked == 4
    for answer in ("ok", "yes", "0.1"):
        assert f"{answer}: must be Enter or s and Enter" in typist.lines
    assert "SKIPPED: current not measured" in typist.lines
    assert not any(line.startswith("ok: current") for line in typist.lines)
    assert "SKIPPED: current not measured; NOT PASSED: " in noted_steps(rig)["make_safe"]


VERB = """
import json, sys
from pathlib import Path
from haptic_accel.core.process import FULL_SCALE, PROGRESS, UNUSABLE, notify_supervisor

verb, *words = sys.argv[1:]
calls = Path("calls.json")
called = json.loads(calls.read_text()) if calls.exists() else []
calls.write_text(json.dumps([*called, [verb, *words]]))
number = sum(each[0] == verb for each in called)
print("words in any language")
if verb == "identify":
    notify_supervisor(PROGRESS, text="trial 1")
    if number == 0:
        notify_supervisor(UNUSABLE, reason="no coherence")
        sys.exit("no coherence; next: a command")
    if number == 1:
        notify_supervisor(FULL_SCALE, value=2.0)
else:
    late = 50 if number == 0 else 0
    counts = {"actuator force": {"due": 1000, "missed": late}}
    conditions = [
        {"controller": name, "nrmse_percent": error, "limited_bound_percent": 3.0,
         "missed_deadlines": counts}
        for name, error in (("none", 100.0), ("adaptive", 5.0))
    ]
    Path(words[words.index("--json") + 1]).write_text(json.dumps({"conditions": conditions}))
"""
"""Stand-in for the program: the first recording is unusable, the first comparison late."""


class Willing(Typist):
    """A person who does as told, with a handle of 0.2 kg."""

    def ask(self, request: str, skip: str = "") -> str:
        self.requests.append(request)
        return "0.2" if "mass" in request else ""


@pytest.mark.smoke
def test_verbs_tell_by_events_what_is_next(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "COMMAND", [sys.executable, "-c", VERB])
    rig = here / "rig.yaml"
    update_parameter_file(rig, {"master_device": {"device": "simulated"}})
    for step in ("connect", "calibrate", "make_safe"):
        note_step(rig, step, "before")
    person = Willing([])
    BringUp(from_flat(BringUpArguments, {"file": str(rig)}), person).run()
    calls = json.loads((here / "calls.json").read_text())
    assert [each[0] for each in calls] == ["identify"] * 3 + ["experiment"] * 2
    values = read_parameter_file(rig)
    assert values["master_device"]["audio.full_scale"] == 2.0 * 0.2
    assert values["coupler"]["latency"] == 2  # one sample more than by default
    assert "no coherence; press Enter to try again, or type s to stop" in person.requests
    assert person.lines.count("trial 1") == 3
    assert any("5.0 % of the actuator forces took effect late" in line for line in person.lines)
