# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Entry points of other packages, whatever they declare and whatever their code does."""

from __future__ import annotations

import logging
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from unittest.mock import patch

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foreign_packages import GROUPS, declare
from fuzzing import ODD_TEXTS, fuzz, mutated
from haptic_accel.cli.commands import COMMANDS_GROUP, SECTIONS, LazyGroup
from haptic_accel.cli.output import StoppedError
from haptic_accel.core.control.channel import build_controller
from haptic_accel.core.control.compensation import Compensation, CompensationParameters
from haptic_accel.core.control.controllers import (
    CONTROLLERS,
    CONTROLLERS_GROUP,
    RESERVED,
    Controller,
    Loop,
)
from haptic_accel.core.outside import (
    OutsideError,
    guard,
    node_module,
    parameters_problem,
    with_outside,
)
from haptic_accel.core.parameters import ParameterError, warn_once
from haptic_accel.devices import Device, DeviceError
from haptic_accel.devices.interface import MASTERS_GROUP, driver_problem
from haptic_accel.devices.simulated import SimulatedMaster
from running import python

OBJECTS = """
from haptic_accel.cli.commands import KitVerb, LazyGroup
from haptic_accel.core.control.controllers.interface import Controller
from haptic_accel.core.model import ZERO
from haptic_accel.devices.interface import Device, DeviceDescription, NoParameters, Sample
import click

VERB = KitVerb("Devices", "weigh a handle", __name__)
GROUP = KitVerb("Devices", "weigh handles", group=LazyGroup("weigh", {"Verbs": {"one": "once"}}))
NO_VERBS = KitVerb(3, None), KitVerb("", "", []), KitVerb("Devices", "weigh", group=7), None, ""

@click.command("weigh")
def weigh():
    click.echo("0.064 kg")

class Half(Controller):
    def __init__(self, parameters, loop):
        self.loop = loop

    def force(self, desired_acceleration, measured_acceleration):
        return 0.064 * desired_acceleration

class Arm(Device):
    Parameters = NoParameters
    description = DeviceDescription()

    def __init__(self, parameters, rate, seed): ...

    def open(self): ...

    def read(self, time):
        return Sample(ZERO, ZERO, ZERO)

    def write(self, time, *, arm_force=None, actuator_force=None): ...

    def close(self): ...

class Undressed(BaseException):
    def __str__(self):
        raise self

class Odd(type):
    def __getattribute__(cls, name):
        raise Undressed

class Bad(metaclass=Odd): ...

def main(): ...
"""

FAULTS = (
    "raise SystemExit",
    "import sys; sys.exit(3)",
    "raise GeneratorExit",
    "raise StopIteration('\\x1b[2J\\n')",
    "raise Undressed",
    "def again(): again()\nagain()",
    "def __getattr__(name): raise SystemExit(name)",
    "import no_such_module",
    "1 / 0",
    "this is no Python",
    "Half.Parameters = Arm.Parameters = dict",
    "Half.Parameters = property(lambda _: 1 / 0)",
    "Arm.description = Undressed()",
    "Arm.__init__ = Half.__init__ = lambda *_: Undressed.__str__(Undressed())",
    "Arm.__init__ = Half.__init__ = lambda *_: exit(5)",
    "VERB = GROUP = Arm = Half = Bad",
    "weigh = Bad",
    "\0",
    "\udce9",
)
"""Lines at the end of a module."""

TARGETS = ("VERB", "GROUP", "NO_VERBS", "Half", "Arm", "Bad", "no_such", "weigh.name", "")
NAMES = ("weigh", "half", "lab", "teleop", "study", "link", "compensator", "none", "simulated")
ENTRY = st.builds(
    "{} = {}:{}".format, st.sampled_from(NAMES), st.just("MODULE"), st.sampled_from(TARGETS)
)
FILE = st.builds(
    lambda group, entries: "\n".join([f"[haptic_accel.{group}]", *entries, ""]),
    st.sampled_from(GROUPS),
    st.lists(ENTRY, min_size=1, max_size=3),
)
PIECES = st.sampled_from([*ODD_TEXTS, *FAULTS, "[haptic_accel.nodes]\n", ":", "\n"])
PACKAGES = st.lists(
    st.tuples(
        mutated(FILE, PIECES),
        st.builds(lambda fault: OBJECTS + fault, st.sampled_from(["", *FAULTS]))
        | mutated(st.just(OBJECTS), PIECES),
        st.sampled_from(["Name: MODULE"] * 4 + ["Name: Haptic-Accel", "Name: \udce9", "", "Name"]),
    ),
    min_size=5,
    max_size=15,
)


@pytest.mark.parametrize(
    "error", [SystemExit(3), GeneratorExit(), StopIteration(), ValueError("a\x1b\nb")]
)
def test_whatever_foreign_code_raises_is_one_line(error: BaseException) -> None:
    with pytest.raises(OutsideError) as caught, guard("lab"):
        raise error
    assert str(caught.value).startswith(f"lab: {type(error).__name__}")
    assert str(caught.value).isprintable()


def test_ctrl_c_and_faults_of_this_package_pass() -> None:
    with pytest.raises(KeyboardInterrupt), guard():
        raise KeyboardInterrupt
    with pytest.raises(SystemExit), guard("haptic_accel.core"):
        raise SystemExit
    with pytest.raises(OutsideError), guard("haptic_accel_of_others"):
        raise SystemExit


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder that Python looks for packages in, before all others."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


def run(*words: str) -> tuple[int, str, list[str]]:
    """Run Python; return exit status, output and lines of errors."""
    done = python(*words)
    return done.returncode, done.stdout, done.stderr.splitlines()


MAIN = "-c", "from haptic_accel.cli.start import main; main()"


def test_a_package_that_exits_takes_no_verb_away(site: Path) -> None:
    (site / "evil.py").write_text("raise SystemExit(3)")
    for group in GROUPS:
        module = "evil.node" if group == "nodes" else "evil:Thing"
        declare(site, f"evil_{group}", {"evil": module}, group)
    status, shown, said = run(*MAIN, "--help")
    assert (status, said) == (0, ["haptic-accel: evil: package evil_commands: SystemExit: 3"])
    assert "teleop" in shown
    status, _, (line,) = run(*MAIN, "teleop", "controller:=evil", "record:=false")
    assert status == 2
    assert line.endswith("controller = 'evil': package evil_controllers: SystemExit: 3")
    status, _, (line,) = run(*MAIN, "teleop", "master:=evil", "record:=false")
    assert (status, line.endswith("package evil_masters: SystemExit: 3")) == (2, True)
    status, _, said = run("-c", "from haptic_accel.nodes.start import evil as main; main()")
    assert (status, said) == (1, ["evil: SystemExit: 3"])


def test_no_package_takes_a_name_of_this_one(site: Path) -> None:
    (site / "evil.py").write_text("raise SystemExit(3)")
    names = {"commands": "study", "nodes": "link", "controllers": "adaptive"}
    for group, name in names.items():
        declare(site, f"evil_{group}", {name: "evil"}, group)
    status, shown, (line,) = run(*MAIN, "study", "--help")
    assert (status, "participant" in shown) == (0, True)
    assert line.startswith("haptic_accel.commands: 'study' of package evil_commands: not used")
    find = "from haptic_accel.core.outside import node_module; print(node_module('link'))"
    status, shown, (line,) = run("-c", find)
    assert shown == "haptic_accel.kits.link.link\n"
    assert "'link' of package evil_nodes: not used" in line
    find = "from haptic_accel.core.control.controllers import *; print(CONTROLLERS['adaptive'])"
    status, shown, (line,) = run("-c", find)
    assert "controllers.adaptive.AdaptiveController" in shown
    assert "'adaptive' of package evil_controllers: not used" in line


@fuzz
@given(PACKAGES)
def test_no_package_takes_more_than_its_own_entry_away(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    packages: list[tuple[str, str, str]],
) -> None:
    """About ten generated packages a case, each of which ends in one line or works."""
    site = tmp_path / "site"
    modules = [f"foreign_{number}" for number in range(len(packages))]
    for name, (entries, code, metadata) in zip(modules, packages, strict=True):
        (about := site / f"{name}-1.0.dist-info").mkdir(parents=True)
        written = {site / f"{name}.py": code, about / "METADATA": metadata}
        written[about / "entry_points.txt"] = entries
        for path, text in written.items():
            path.write_text(text.replace("MODULE", name), "utf-8", "surrogateescape")
    warn_once.cache_clear()
    try:
        with monkeypatch.context() as patched, caplog.at_level(logging.WARNING):
            patched.setattr(sys, "path", [str(site)])
            controllers = use_every_group()
        with patch.dict(CONTROLLERS, controllers):
            # A graph prepares all controllers, and runs although some cannot be built.
            Compensation(CompensationParameters("none"), 1000.0, prepared=tuple(controllers))
    finally:
        shutil.rmtree(site)
        for name in modules:
            sys.modules.pop(name, None)
    assert all(record.getMessage().isprintable() for record in caplog.records)
    caplog.clear()


def use_every_group() -> dict[str, type[Controller]]:
    """Ask for all that the packages declare; what is this package's must remain.

    Return the controllers of the packages.
    """
    verbs = LazyGroup("haptic-accel", SECTIONS, entry_points=COMMANDS_GROUP)
    context = click.Context(verbs)
    shown = verbs.get_help(context)
    assert "run the teleoperation graph" in shown
    for name in verbs.kits:
        try:
            assert isinstance(verbs.get_command(context, name), click.Command)
        except StoppedError as error:
            assert str(error).isprintable()
    assert node_module("compensator") == "haptic_accel.nodes.compensator"
    with suppress(OutsideError):
        assert node_module("link").partition(":")[0] in ("", *sys.modules)
    masters = with_outside({"simulated": SimulatedMaster}, MASTERS_GROUP, Device, driver_problem)
    assert masters["simulated"] is SimulatedMaster
    for name in masters.keys() - {"simulated"}:
        try:
            options = {name: masters[name].Parameters()}
            assert isinstance(masters[name].from_options(name, options, 1000.0, 0), Device)
        except (DeviceError, ParameterError) as error:
            assert str(error).isprintable()
    known = with_outside(
        CONTROLLERS,
        CONTROLLERS_GROUP,
        Controller,
        lambda kind, _: parameters_problem(kind.Parameters),
        RESERVED,
    )
    assert known.items() >= CONTROLLERS.items()
    controllers = {name: kind for name, kind in known.items() if name not in CONTROLLERS}
    with patch.dict(CONTROLLERS, controllers):
        for name in controllers:
            try:
                assert isinstance(build_controller(name, Loop(1000.0)), Controller)
            except ParameterError as error:
                assert str(error).startswith("controller = ")
                assert str(error).isprintable()
    return controllers
