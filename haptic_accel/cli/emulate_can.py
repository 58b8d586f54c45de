"""``haptic-accel emulate can``: two arms of ODrives that are not there, with the virtual rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from haptic_accel.cli.emulation import (
    emulation_folder,
    until_stopped,
    virtual_rig,
    write_parameters,
)
from haptic_accel.cli.options import Verb, words
from haptic_accel.core.parameters import Checked, from_flat, parameter
from haptic_accel.core.process import DONE
from haptic_accel.core.rig.master_rig import MasterRig
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.devices.can.bus import bus_configuration, open_bus
from haptic_accel.devices.can.parameters import KINEMATICS, CanParameters
from haptic_accel.devices.connection import AUTO
from haptic_accel.emulators.can_arm import EmulatedArm, NewRig
from haptic_accel.emulators.can_bus import BusPort, Emulator, Port, SlcanPort
from haptic_accel.emulators.can_faults import FAULTS, parse_faults
from haptic_accel.graph.arguments import (
    grip_argument,
    rig_argument,
    seed_argument,
)
from haptic_accel.graph.words import parse_words

MASTER, SLAVE = "master", "slave"

SLCAN_OPTIONS = '{"sleep_after_open": 0}'
"""python-can waits two seconds for boards that start anew when they are opened; this does not."""


PATIENCE = {
    "start_timeout": 10.0,
    "heartbeat_timeout": 1.0,
    "estimates_timeout": 0.5,
    "rearm": AUTO,
}
"""Parameters of the driver: what is emulated shares its machine with the graph, and may stall."""


@dataclass(frozen=True)
class EmulateCanArguments(Checked):
    """What a user may say of the emulated arms."""

    rig: str = rig_argument()
    grip: str = grip_argument()
    surface: str = parameter(
        "plywood", "what the slave touches: plywood, text, vinyl, or a .yaml file"
    )
    seed: int = seed_argument()
    kinematics: str = parameter("arm", "of one, two or three joints each", choices=KINEMATICS)
    rate: float = parameter(
        500.0, "of estimates and of the virtual rig", unit="Hz", low=50.0, high=1000.0
    )
    watchdog: float = parameter(
        0.5, "silence after which an axis lets go; 0 for never", unit="s", low=0.0, high=10.0
    )
    folder: str = parameter(
        "", "for the adapters and the parameter file; empty for one below the temporary folder"
    )
    interface: str = parameter(
        "", "of python-can, both arms on one bus; empty for two slcan adapters"
    )
    channel: str = parameter("", "of the interface")
    faults: str = parameter(
        "",
        "NAME for all the time, or NAME@SECONDS after the arms are coupled, with commas between: "
        + "; ".join(f"{name}: {text}" for name, text in FAULTS.items()),
    )
    fault_arm: str = parameter(SLAVE, "which arm has the faults", choices=(MASTER, SLAVE))
    fault_seconds: float = parameter(
        2.0, "how long one lasts that has a time", unit="s", low=0.001, high=1e6
    )
    duration: float = parameter(
        0.0, "until the end; 0 = until stopped", unit="s", low=0.0, high=1e6
    )


@click.command(cls=Verb, name="can", examples=["haptic-accel emulate can kinematics:=stage"])
@words(EmulateCanArguments)
def emulate_can(words: Sequence[str]) -> int:
    """Emulate master and slave arms of ODrives on CAN until Ctrl-C.

    They are behind slcan adapters on pseudo-terminals or on any bus of python-can.
    """
    arguments = parse_words(words, EmulateCanArguments)
    faults = parse_faults(arguments.faults, arguments.fault_seconds)
    folder = emulation_folder(arguments.folder, "can")
    given = {arm: _given(arguments, arm, folder) for arm in (MASTER, SLAVE)}
    parameters = {arm: from_flat(CanParameters, values) for arm, values in given.items()}
    arms = _arms(arguments, parameters)
    lines: list[tuple[Port, list[EmulatedArm]]]
    if arguments.interface:
        configuration = bus_configuration(parameters[MASTER])
        lines = [(BusPort(lambda: open_bus(configuration, [])), list(arms.values()))]
    else:
        lines = [(SlcanPort(folder / arm), [arms[arm]]) for arm in (MASTER, SLAVE)]
    emulator = Emulator(lines, faults, arms[arguments.fault_arm], arguments.seed)
    try:
        _tell(arguments, folder, given)
        with until_stopped(
            arguments.duration, lambda: emulator.driven, "the arms have torques"
        ) as ended:
            emulator.run(arguments.rate, ended)
    finally:
        emulator.close()
    return DONE


def _given(arguments: EmulateCanArguments, arm: str, folder: Path) -> dict[str, Any]:
    """Return what the driver of an arm must be told, by dotted name."""
    if not arguments.interface:
        return {
            "interface": "slcan",
            "channel": str(folder / arm),
            "options": SLCAN_OPTIONS,
            "kinematics": arguments.kinematics,
            **PATIENCE,
        }
    # Both are on one bus: the slave's nodes follow the master's.
    first = 0 if arm == MASTER else len(KINEMATICS)
    return {
        "interface": arguments.interface,
        "channel": arguments.channel,
        "kinematics": arguments.kinematics,
        **PATIENCE,
        **{f"joint{number + 1}.node_id": first + number for number in range(len(KINEMATICS))},
    }


def _arms(
    arguments: EmulateCanArguments, parameters: dict[str, CanParameters]
) -> dict[str, EmulatedArm]:
    """Return both sides of the virtual rig behind axes."""
    rate, seed = arguments.rate, arguments.seed
    rig = virtual_rig(arguments.rig, arguments.grip, arguments.surface, seed)
    new: dict[str, NewRig] = {
        MASTER: lambda: MasterRig(rig.master, rate, seed),
        SLAVE: lambda: SlaveRig(rig.slave, rate, seed),
    }
    return {
        arm: EmulatedArm(
            parameters[arm], new[arm], rate=rate, watchdog=arguments.watchdog, seed=seed + place
        )
        for place, arm in enumerate((MASTER, SLAVE))
    }


def _tell(arguments: EmulateCanArguments, folder: Path, given: dict[str, dict[str, Any]]) -> None:
    """Write the parameter file of a graph that uses the arms, and say how to start it."""
    path = folder / "can.yaml"
    write_parameters(path, "can", given)
    print(
        "emulating two arms; in another terminal:\n"
        f"  haptic-accel teleop master:=can slave:=can rate:={arguments.rate:g} config:={path}",
        flush=True,
    )
