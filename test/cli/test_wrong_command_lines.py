# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Command lines that are refused, each in the one line that tells the user why."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from bag_maker import BagContent, write_bag
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.topics import MASTER_POSITION
from haptic_accel.kits.study.templates import templates
from studies import TEXT
from verbs import refusal, tells

DATA = Path(__file__).parents[1] / "data"

CONTROLLED = ", ".join(CONTROLLERS)
TEMPLATES = ", ".join(templates())

LONG = "x" * 300
"""Name longer than a file can have; in the table, LONG."""

SAMPLES = "".join(f"{index},60,1,{index % 7}\n" for index in range(2000))

FILES = {
    "axis.csv": f"t [ms],speed,force,ax [g]\n{SAMPLES}",
    "drag.csv": f"index,speed,force,accel\n{SAMPLES}",
    "slow.csv": "force,accel\n1,2\n",
    "timed.csv": f"t [ms],speed,force,accel\n{SAMPLES}",
    "file": "",
    "junk.mcap": "\0\1\2" * 1000,
    "misspelt/study.yaml": TEXT.replace("adaptive", "adaptve"),
    "blank/study.yaml": TEXT.replace("I agree to take part.", '"[[ blank: purpose ]] I agree."'),
    "study/study.yaml": TEXT,
    "untested/study.yaml": TEXT.partition("tests:")[0],
    "mass.yaml": "compensator: {ros__parameters: {constant: {mass: .nan}}}",
    "peak.yaml": "compensator: {ros__parameters: {actuator: {peak_force: -6.6}}}",
    "pek.yaml": "compensator: {ros__parameters: {pek_force: 6.6}}",
    "node.yaml": "compensater: {ros__parameters: {}}",
    "k_mm.yaml": "/**: {ros__parameters: {k_mm: 3}}",
    "k_m.yaml": "coupler: {k_m: 3}",
    "ice.yaml": "slave_device: {ros__parameters: {simulated: {surface: {friction: -1}}}}",
    "open.yaml": "a: [",
    "zero.yaml": "\0",
    "words.yaml": "just words",
}
"""Text of files in the working folder."""

REFUSED = {
    "": "a verb is missing; there are touch, teleop, ...",
    "dance": "dance: no such verb; there are touch, teleop, ...",
    "telepo": "telepo: no such verb (did you mean teleop?); there are touch, teleop, ...",
    "analyze LONG": "LONG: no such file or folder",
    "analyze nothing": "nothing: no such file or folder",
    "analyze empty": "empty: must be a bag, or a folder with bags in it",
    "analyze junk.mcap --out report": "junk.mcap: must be a bag: ...: it is not an MCAP file",
    "analyze text --shift soon": "shift = 'soon': must be granted, paper, ...",
    "analyze text --compare": "compare: needs two bags or folders...",
    "analyze text --compare surface:a,b": "compare = 'surface:a,b': leave out to compare ...",
    "analyze text --out empty": "out = 'empty': must be a new folder",
    "analyze text --json no/where.json": "json = 'no/where.json': No such file or directory",
    "bag info LONG": "LONG: must be the folder of a bag",
    "bag info missing": "missing: must be the folder of a bag",
    "bag info file": "file: must be the folder of a bag",
    "bag info empty": "empty: must be a bag: it has no .mcap or .db3 file",
    "bag info text --json LONG": "json = 'LONG': File name too long",
    "bag repair": "Missing argument ...BAG...",
    "bag repair LONG": "LONG: must be the folder of a bag",
    "bag repair missing": "missing: must be the folder of a bag",
    "bag repair file": "file: must be the folder of a bag",
    "bag repair empty": "empty: must be a bag: it has no .mcap or .db3 file",
    "bench latncy": "latncy: no such verb (did you mean latency?); there are latency, ...",
    "bench latency --rate -5": "rate = -5.0: must be from 50 to 20000 Hz",
    "bench latency --pairs 0": "Invalid value for '--pairs': 0 is not in the range...",
    "bench latency --seconds 0.5": "seconds = 0.25: must leave at least 1 s for each run",
    "bench latency bag:=x": "bag: set by the benchmark",
    "bench latency --rates 100,fast": "Invalid value for '--rates': '100,fast': must be ...",
    "bench latency --rates 100,0": "rate = 0.0: must be from 50 to 20000 Hz",
    "bench fidelity taps": "fidelity: is now python benchmarks/fidelity.py in the source",
    "bringup redo:=paint": "redo = 'paint': must be one of ...",
    "bringup master:=violin": "master = 'violin': must be one of simulated, ...",
    "bringup params_file:=nowhere.yaml": "params_file: .../nowhere.yaml: ...: No such file ...",
    "bringup rate:=5": "rate = 5.0: must be from 100 to 10000 Hz",
    "calibrate": "port = '': must be given, or usb_serial, and not both",
    "calibrate port:=none file:=no/a.yaml": "file = 'no/a.yaml': must be a file in ...",
    "calibrate port:=none --update no.yaml": "...'--update': File 'no.yaml' does not exist...",
    "control": "control: must be given one of controller, ...",
    "control surface:=jelly": "surface = 'jelly': must be one of plywood, ...",
    "control surface:=drag.csv": "surface = 'drag.csv': must be chosen when the graph starts",
    "control surface:=ice.yaml": "simulated.surface.friction = -1: must be from 0 to 2",
    "control grip:=fist": "grip = 'fist': must be one of keep, average, pinch, hook",
    "control engage:=perhaps": "engage = 'perhaps': must be one of keep, true, false",
    "control frozen:=perhaps": "frozen = 'perhaps': must be one of keep, true, false",
    "control controler:=adaptive": "controler: no such argument (did you mean controller?); ...",
    "control controller:=magic": f"controller = 'magic': must be one of keep, {CONTROLLED}",
    "design controller:=none": "controller = 'none': must be one of inverse, feedback, adaptive",
    "design rig:=mine": "rig = 'mine': must be one of ideal, ..., or a .yaml file",
    "design --json no/such.json": "json = 'no/such.json': No such file or directory",
    "doctor --json no/such.json": "json = 'no/such.json': No such file or directory",
    "emulate can faults:=fire": "faults: 'fire': must be NAME or NAME@SECONDS of drop, ...",
    "emulate can kinematics:=delta": "kinematics = 'delta': must be one of stage, planar, arm",
    "emulate can interface:=tin": "can.interface = 'tin': must be one of ...",
    "emulate can surface:=cheese": "surface = 'cheese': must be one of plywood, ...",
    "emulate can folder:=/dev/null": "folder = '/dev/null': must be a folder or new: File exists",
    "emulate can speed:=3": "speed: no such argument...",
    "emulate network delay:=-1": "delay = -1.0: must be from 0 to 10 s",
    "emulate serial faults:=fire": "faults: 'fire': must be NAME or NAME@SECONDS of garbage, ...",
    "emulate serial surface:=ice": "surface = 'ice': must be one of plywood, ...",
    "emulate serial folder:=file": "folder = 'file': must be a folder or new: File exists",
    "emulate serial rate:=1000": "rate: no such argument; ...",
    "estop release:=perhaps": "release = 'perhaps': must be true or false",
    "estop relase:=true": "relase: no such argument (did you mean release?); ...",
    "estop namespace:=a-b": "namespace = 'a-b': must be letters, digits and _, ...",
    "experiment --seedz": "No such option...--seedz...Did you mean...--seeds...?",
    "experiment --seeds": "Option...--seeds...requires an argument...",
    "experiment --seeds two": "Invalid value for '--seeds': 'two' is not a valid ...",
    "experiment --delay 20 --jitter 10": "...a simulated network needs --lockstep",
    "experiment master:=pointer": "master = 'pointer': an experiment has no user to move it",
    "experiment --lockstep duration:=0": "duration = 0: must be at least 1 s in an experiment",
    "experiment --lockstep bag:=x": "bag: set by an experiment, ...",
    "experiment --lockstep slave:=replay": "slave = 'replay': must be simulated ...",
    "experiment --lockstep controller:=magic": "controller = 'magic': must be one of none, ...",
    "experiment --lockstep --out .": "out = '.': must be a new folder",
    "experiment --lockstep --json no/a.json": "json = 'no/a.json': No such file or directory",
    "identify --lockstep --trials 0": "trials = 0: must be a whole number, from 1 to 1000",
    "identify --lockstep --end-frequency 600": "end_frequency = 600: must be below half ...",
    "identify end_frequency:=300 --end-frequency 300": "end_frequency: given twice",
    "identify --lockstep rig:=nothing": "rig = 'nothing': must be one of ideal, ...",
    "identify --lockstep rig:=three_axis --grips pinch,hook": (
        "grips = pinch, hook: must be one for three axes"
    ),
    "identify --lockstep --grips pinch,fist": "...'--grips': 'fist': must be one of average, ...",
    "identify --lockstep --from bag": "from: not with --lockstep, ...",
    "identify --lockstep --out .": "out = '.': must be a new folder",
    "identify --lockstep --json no/such.json": "json = 'no/such.json': No such file or directory",
    "identify --lockstep --update no.yaml": "...'--update': File 'no.yaml' does not exist...",
    "record split name:=x": "name: no such argument ...",
    "record rewind": "...'rewind': must be one of start, pause, split, stop, status",
    "record strat": "...'strat': must be one of ... (did you mean start?)",
    "replay": "bag = '': must be a bag, or a CSV or WAV file",
    "replay nowhere": "bag = 'nowhere': no such bag or file",
    "replay bag:=LONG": "bag = 'LONG': no such bag or file",
    "replay text bag:=plywood bag:=text": "bag: given twice",
    "replay text plywood": "bag = text plywood: must be one, without --lockstep",
    "replay text rate:=11": "rate = 11.0: must be from 0.1 to 10",
    "replay text rate:=fast": "rate = 'fast': must be from 0.1 to 10",
    "replay text controller:=magic": "controller = 'magic': must be one of none, ...",
    "replay text speed:=2": "speed: no such argument (did you mean seed?); there are bag, ...",
    "replay text replay_speed:=2": "replay_speed: no such argument; ...",
    "replay text duration:=0.1": "duration = 0.1: must be 0, or 0.2 s at least",
    "replay text start:=1": "start = 1: must leave 0.2 s of 1.1 s, ...",
    "replay text sampling_rate:=20": "sampling_rate = 20.0: must be from 50 to 20000 Hz",
    "replay text slave:=simulated": "slave = 'simulated': must be replay, ...",
    "replay text source:=radio": "source = 'radio': must be one of device, topics",
    "replay text source:=topics rate:=2": "rate = 2: must be 1 with source:=topics, ...",
    "replay text source:=topics --lockstep": "source, slave: not with --lockstep, ...",
    "replay text loop:=true --lockstep": "loop = true: not with --lockstep, ...",
    "replay text master:=replay --lockstep": "master = 'replay': not with --lockstep, ...",
    "replay text --controllers none": "--controllers: only with --lockstep",
    "replay text --lockstep --controllers magic": "...: 'magic': must be one of none, ...",
    "replay text text --lockstep --controllers none --out out": (
        "out: two bags would be called text_none"
    ),
    "replay toolless": "toolless: has no message of slave/tool/acceleration",
    "replay toolless --lockstep": "toolless: has no message of slave/tool/acceleration",
    "replay drag.csv": "recording_rate = 0: must be given for a CSV file ...drag.csv, ...",
    "replay drag.csv source:=topics": "bag = 'drag.csv': must be a bag with source:=topics",
    "scope port:=70000": "port = 70000: must be a whole number, from 0 to 65535",
    "scope control:=perhaps": "control = 'perhaps': must be true or false",
    "scope ports:=1": "ports: no such argument (did you mean port?); ...",
    "study new --template gain mine": f"...: must be one of {TEMPLATES} (did you mean gain_jnd?)",
    "study check empty": "empty: must be a study's folder, ...",
    "study simulate empty": "empty: must be a study's folder, ...",
    "study status empty": "empty: must be a study's folder, ...",
    "study analyze empty": "empty: must be a study's folder, ...",
    "study export empty": "empty: must be a study's folder, ...",
    "study check misspelt": "misspelt/study.yaml:6: factors.controller = 'adaptve': ...",
    "study simulate untested": "untested/study.yaml: tests = nothing: must be there for a power",
    "study run blank --participant P07": (
        "blank/study.yaml:5: consent.text: must have its 1 blanks filled in: purpose"
    ),
    "study run study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
    "study resume study --participant Anna": "participant = 'Anna': must be a pseudonym ...",
    "teleop --fast": "No such option...--fast...",
    "teleop fast": "'fast': must have the form key:=value",
    "teleop speed:=3": "speed: no such argument (did you mean seed?); ...controller, ...",
    "teleop surfce:=text": "surfce: no such argument (did you mean surface?); there are ...",
    "teleop controller:=magic": f"controller = 'magic': must be one of {CONTROLLED}",
    "teleop controller:=dynamc": "controller = 'dynamc': must be ... (did you mean dynamic?)",
    "teleop rate:=-1": "rate = -1.0: must be from 50 to 20000 Hz",
    "teleop rate:=fast": "rate = 'fast': must be from 50 to 20000 Hz",
    "teleop rate:=nan": "rate = 'nan': must be from 50 to 20000 Hz",
    "teleop rate:=inf": "rate = 'inf': must be from 50 to 20000 Hz",
    "teleop rate:=500 rate:=600": "rate: given twice",
    "teleop seed:=1.5": "seed = '1.5': must be a whole number, ...",
    "teleop record:=perhaps": "record = 'perhaps': must be true or false",
    "teleop bag:=empty duration:=1": "bag = 'empty': must be a new folder",
    "teleop master:=omni": "master = 'omni': must be one of simulated, ...",
    "teleop rig:=LONG.yaml": "rig = 'LONG.yaml': must be one of ideal, ..., or a .yaml file",
    "teleop surface:=jelly": "surface = 'jelly': must be one of plywood, ...",
    "teleop surface:=no.csv recording_rate:=1000": "surface = 'no.csv': ... .csv or .wav file",
    "teleop surface:=no.csv slave:=virtual": "surface = 'no.csv': ... come with slave:=simulated",
    "teleop params_file:=LONG": "params_file: ...: must be a readable file: File name too long",
    "teleop params_file:=.": "params_file: ...: must be a readable file: is a folder",
    "teleop params_file:=nowhere.yaml": "params_file: .../nowhere.yaml: ...: No such file ...",
    "teleop params_file:=mass.yaml": "constant.mass = '.nan': must be at least 0 kg",
    "teleop params_file:=peak.yaml": "actuator.peak_force = -6.6: must be from 0 to 100 N",
    "teleop params_file:=pek.yaml": (
        "params_file: ...pek.yaml:1: compensator.ros__parameters.pek_force = 6.6: no such ..."
    ),
    "teleop params_file:=node.yaml": "params_file: ...node.yaml:1: compensater: must be ...",
    "teleop params_file:=k_mm.yaml": "params_file: ...:1: /**.ros__parameters.k_mm = 3: ...",
    "teleop params_file:=k_m.yaml": "params_file: ...:1: coupler: must hold ros__parameters, ...",
    "teleop params_file:=open.yaml": "params_file: ...open.yaml: must be YAML: ...",
    "teleop params_file:=zero.yaml": "params_file: ...zero.yaml: must be YAML: ...",
    "teleop params_file:=words.yaml": "params_file: ...:1: must map nodes to ros__parameters",
    "texture build drag.csv --out a.yaml": "rate = 0: must be given for a CSV file ...",
    "texture build text --rate 500 --out a.yaml": "rate = 500: a bag states its own: leave ...",
    "texture build text --axes x,y,z --out a.yaml": "axes = x,y,z: a bag states its own: ...",
    "texture build no.csv --rate 1000 --out a.yaml": "no.csv: No such file or directory, ...",
    "texture build drag.csv --rate 100 --out a.yaml": "...must be at least 500 Hz...",
    "texture build drag.csv --rate 1000": "Missing option ...--out...",
    "texture build drag.csv --rate 1000 --out no/a.yaml": "out = 'no/a.yaml': No such file ...",
    "texture build drag.csv --rate 1000 --axes a,b --out a.yaml": "axes = a,b: must be 3 ...",
    "texture build drag.wav --out a.yaml": "drag.wav: is a WAV file, must be a CSV file ...",
    "texture build timed.csv --rate 2000 --out a.yaml": (
        "timed.csv: column t [ms] says 1000 Hz, rate = 2000: must agree"
    ),
    "texture import axis.csv --out a.yaml": (
        "axis.csv: column = acceleration or ...: no such column; there are t [ms], ..., ax [g]"
    ),
    "texture build axis.csv --out a.yaml": (
        "axis.csv: ...there are t [ms], speed, force, ax [g]; choose one with --axes X,Y,Z"
    ),
    "texture build slow.csv --rate 1000 --out a.yaml": (
        "slow.csv: column = speed: no such column; there are force, accel"
    ),
    "texture show oak": "texture = 'oak': must be one of plywood, text, vinyl, ...",
    "texture render vinyl --speed -1 --force 1 --out a.wav": "...--speed...: -1.0 is not in ...",
    "touch --surface ice": "surface = 'ice': must be one of plywood, ...",
    "touch --port 70000": "Invalid value for '--port': 70000 is not in the range...",
}
"""Line of each command line, in which ... stands for any text."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the files that the command lines name; return their folder."""
    folder = tmp_path_factory.mktemp("folder")
    (folder / "empty").mkdir()
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    wavfile.write(folder / "drag.wav", 1000, np.zeros(2000))
    for bag in ("text", "plywood"):
        (folder / bag).symlink_to(DATA / bag)
    signals = {MASTER_POSITION.name: np.zeros((300, 3))}
    write_bag(folder / "toolless", BagContent(signals, arms=False))
    return folder


@pytest.mark.parametrize(
    ("words", "line"), REFUSED.items(), ids=[f"haptic-accel {words}" for words in REFUSED]
)
def test_a_wrong_command_line_is_refused_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: str, line: str
) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    said = refusal(*shlex.split(words.replace("LONG", LONG))).replace(LONG, "LONG")
    assert tells(said, line), said
    assert sorted(folder.rglob("*")) == before
