# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command lines that are refused, each in the one line that tells the user why."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bag_maker import BagContent, write_bag
from haptic_accel.core.control.controllers import CONTROLLERS, CONTROLLERS_GROUP
from haptic_accel.core.topics import MASTER_POSITION
from refusals import assert_refused, rows, written

CONTROLLED = f"{', '.join(CONTROLLERS)}; packages add more by the entry point {CONTROLLERS_GROUP}"

SAMPLES = "".join(f"{index},60,1,{index % 7}\n" for index in range(2000))

FILES = {
    "drag.csv": f"index,speed,force,accel\n{SAMPLES}",
    "xyz.csv": f"ax,ay,az,t_ms\n{''.join(f'1,2,{i % 7},{i}' + chr(10) for i in range(2000))}",
    "junk.mcap": "\0\1\2" * 1000,
    "peak.yaml": "compensator: {ros__parameters: {actuator: {peak_force: -6.6}}}",
    "pek.yaml": "compensator: {ros__parameters: {pek_force: 6.6}}",
    "node.yaml": "compensater: {ros__parameters: {}}",
    "k_mm.yaml": "/**: {ros__parameters: {k_mm: 3}}",
    "k_m.yaml": "coupler: {k_m: 3}",
    "ice.yaml": "slave_device: {ros__parameters: {simulated: {surface: {friction: -1}}}}",
    "open.yaml": "a: [",
    "words.yaml": "just words",
}
"""Text of files in the working folder."""

REFUSED = {
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
    "bag info empty": "empty: must be a bag: it has no .mcap or .db3 file",
    "bag info text --json LONG": "json = 'LONG': File name too long",
    "bag repair": "Missing argument ...BAG...",
    "bag repair missing": "missing: must be the folder of a bag",
    "bag repair empty": "empty: must be a bag: it has no .mcap or .db3 file",
    "bench latncy": "latncy: no such verb (did you mean latency?); there are latency",
    "bench latency --rate -5": "rate = -5.0: must be from 50 to 20000 Hz",
    "bench latency --pairs 0": "Invalid value for '--pairs': 0 is not in the range...",
    "bench latency --seconds 0.5": "seconds = 0.25: must leave at least 1 s for each run",
    "bench latency bag:=x": "bag: set by the benchmark",
    "bench latency --rates 100,fast": "Invalid value for '--rates': '100,fast': must be ...",
    "bench latency --rates 100,0": "rate = 0.0: must be from 50 to 20000 Hz",
    "bench fidelity taps": "fidelity: is now python benchmarks/fidelity.py in the source",
    "bench network": "network: is now python benchmarks/coupling_over_networks.py in the source",
    "calibrate": "port = '': must be given, or usb_serial, and not both",
    "calibrate port:=none file:=no/a.yaml": "file = 'no/a.yaml': must be a file in ...",
    "calibrate port:=none --update no.yaml": "...'--update': File 'no.yaml' does not exist...",
    "calibrate port:=none --update words.yaml": "params_file: ...:1: must map nodes to ...",
    "control": "control: must be given one of controller, ...",
    "control surface:=jelly": "surface = 'jelly': must be one of plywood, ...",
    "control surface:=drag.csv": "surface = 'drag.csv': must be chosen when the graph starts",
    "control surface:=ice.yaml": "simulated.surface.friction = -1: must be from 0 to 2",
    "control grip:=fist": "grip = 'fist': must be one of keep, average, pinch, hook",
    "control engage:=perhaps": "engage = 'perhaps': must be one of keep, true, false",
    "control controler:=adaptive": "controler: no such argument (did you mean controller?); ...",
    "design controller:=none": "controller = 'none': must be one of inverse, feedback, adaptive",
    "design rig:=mine": "rig = 'mine': must be one of ideal, ..., or a .yaml file",
    "design --json no/such.json": "json = 'no/such.json': No such file or directory",
    "doctor radio": "Invalid value for '[audio]': 'radio': must be one of audio...",
    "doctor audio preset:=ps4": "preset = 'ps4': must be one of dualsense, ...",
    "doctor audio device:=x file:=no/a.yaml": "file = 'no/a.yaml': No such file or directory",
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
    "experiment --lockstep --out .": "out = '.': must be a new folder",
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
    "identify --lockstep --update no.yaml": "...'--update': File 'no.yaml' does not exist...",
    "record split name:=x": "name: no such argument ...",
    "record rewind": "...'rewind': must be one of start, pause, split, stop, status",
    "record strat": "...'strat': must be one of ... (did you mean start?)",
    "replay": "bag = '': must be a bag, or a CSV or WAV file",
    "replay nowhere": "bag = 'nowhere': no such bag or file",
    "replay bag:=LONG": "bag = 'LONG': no such bag or file",
    "replay text bag:=plywood bag:=text": "bag: given twice",
    "replay text plywood": "bag = text plywood: must be one bag, without --lockstep",
    "replay text rate:=11": "rate = 11.0: must be from 0.1 to 10",
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
    "teleop --fast": "No such option...--fast...",
    "teleop fast": "'fast': must have the form key:=value",
    "teleop speed:=3": "speed: no such argument (did you mean seed?); ...controller, ...",
    "teleop surfce:=text": "surfce: no such argument (did you mean surface?); there are ...",
    "teleop controller:=magic": f"controller = 'magic': must be one of {CONTROLLED}",
    "teleop controller:=dynamc": "controller = 'dynamc': must be ... (did you mean dynamic?)",
    "teleop rate:=-1": "rate = -1.0: must be from 50 to 20000 Hz",
    "teleop rate:=500 rate:=600": "rate: given twice",
    "teleop bag:=empty duration:=1": "bag = 'empty': must be a new folder",
    "teleop master:=omni": "master = 'omni': must be one of simulated, ...",
    "teleop rig:=LONG.yaml": "rig = 'LONG.yaml': must be one of ideal, ..., or a .yaml file",
    "teleop surface:=jelly": "surface = 'jelly': must be one of plywood, ...",
    "teleop surface:=xyz.csv recording_column:=ax,ay,az": "...xyz.csv: column = ax,ay,az: must be"
    " one column, as the tool measures along z only; ...",
    "teleop surface:=no.csv recording_rate:=1000": "surface = 'no.csv': ... .csv or .wav file",
    "teleop surface:=no.csv slave:=virtual": "surface = 'no.csv': ... come with slave:=simulated",
    "teleop params_file:=LONG": "params_file: ...: must be a readable file: File name too long",
    "teleop params_file:=.": "params_file: ...: must be a readable file: is a folder",
    "teleop params_file:=nowhere.yaml": "params_file: .../nowhere.yaml: ...: No such file ...",
    "teleop params_file:=peak.yaml": "actuator.peak_force = -6.6: must be from 0 to 100 N",
    "teleop params_file:=pek.yaml": (
        "params_file: ...pek.yaml:1: compensator.ros__parameters.pek_force = 6.6: no such ..."
    ),
    "teleop params_file:=node.yaml": "params_file: ...node.yaml:1: compensater: must be ...",
    "teleop params_file:=k_mm.yaml": "params_file: ...:1: /**.ros__parameters.k_mm = 3: ...",
    "teleop params_file:=k_m.yaml": "params_file: ...:1: coupler: must hold ros__parameters, ...",
    "teleop params_file:=open.yaml": "params_file: ...open.yaml: must be YAML: ...",
    "teleop params_file:=words.yaml": "params_file: ...:1: must map nodes to ros__parameters",
    "touch --surface ice": "surface = 'ice': must be one of plywood, ...",
}
"""Line of each command line, in which ... stands for any text."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files that the command lines name."""
    folder = written(tmp_path_factory.mktemp("folder"), FILES)
    signals = {MASTER_POSITION.name: np.zeros((300, 3))}
    write_bag(folder / "toolless", BagContent(signals, arms=False))
    return folder


@rows(REFUSED)
def test_a_wrong_command_line_is_refused_in_one_line(folder: Path, words: str, line: str) -> None:
    assert_refused(folder, words, line)
