"""``haptic-accel emulate serial``: handle and tool that are not there, with the virtual rig."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptic_accel.cli.emulation import (
    emulation_folder,
    until_stopped,
    virtual_rig,
    write_parameters,
)
from haptic_accel.cli.options import Verb, words
from haptic_accel.core.model import AccelerometerParameters
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.process import DONE, FAILED
from haptic_accel.core.trial import RigParameters
from haptic_accel.devices.serial.device import (
    FORCE_CONSTANT,
    HIGHEST_RATE,
    MISSING_LIBRARY,
)
from haptic_accel.emulators.serial_faults import FAULTS, parse_faults
from haptic_accel.graph.arguments import (
    grip_argument,
    rig_argument,
    seed_argument,
)
from haptic_accel.graph.words import parse_words

if TYPE_CHECKING:
    from haptic_accel.emulators.serial_line import EmulatedBoard
    from haptic_accel.emulators.serial_rig import Emulator

MASTER, SLAVE = "master", "slave"

FIRMWARE = (1, 0, 0)
"""That an emulated board says it has."""


@dataclass(frozen=True)
class EmulateSerialArguments(Checked):
    """What a user may say of the emulated boards."""

    rig: str = rig_argument()
    grip: str = grip_argument()
    surface: str = parameter(
        "plywood", "what the tool touches: plywood, text, vinyl, or a .yaml file"
    )
    seed: int = seed_argument()
    folder: str = parameter(
        "", "for the ports and the parameter file; empty for one below the temporary folder"
    )
    faults: str = parameter(
        "",
        "NAME for now and then, or NAME@SECONDS after the hand begins, with commas between: "
        + "; ".join(f"{name}: {text}" for name, text in FAULTS.items()),
    )
    fault_board: str = parameter(MASTER, "which board has the faults", choices=(MASTER, SLAVE))
    fault_seconds: float = parameter(
        1.0, "how long one lasts that has a time", unit="s", low=0.001, high=1e6
    )
    master_gravity: float = parameter(
        0.0,
        "added to what the handle's accelerometer says, to calibrate it",
        unit="m/s^2",
        low=-10.0,
        high=10.0,
    )
    duration: float = parameter(
        0.0, "until the end; 0 = until stopped", unit="s", low=0.0, high=1e6
    )


@click.command(cls=Verb, name="serial", examples=["haptic-accel emulate serial duration:=60"])
@words(EmulateSerialArguments)
def emulate_serial(words: Sequence[str]) -> int:
    """Emulate the boards of handle and tool on pseudo-terminals until Ctrl-C."""
    arguments = parse_words(words, EmulateSerialArguments)
    faults = parse_faults(arguments.faults)
    rig = virtual_rig(arguments.rig, arguments.grip, arguments.surface, arguments.seed)
    try:
        from haptic_accel.emulators.serial_rig import Emulator
    except ImportError:
        print(f"haptic-accel: serial: {MISSING_LIBRARY}", file=sys.stderr)
        return FAILED
    folder = emulation_folder(arguments.folder, "serial")
    boards = _boards(arguments, rig, folder)
    emulator = Emulator(
        rig,
        boards[MASTER],
        boards[SLAVE],
        force_constant=FORCE_CONSTANT,
        faults=faults,
        faulty=boards[arguments.fault_board],
        fault_seconds=arguments.fault_seconds,
        seed=arguments.seed,
    )
    try:
        _tell(folder)
        _run(emulator, arguments)
    finally:
        for board in boards.values():
            board.close()
    return DONE


def _boards(
    arguments: EmulateSerialArguments, rig: RigParameters, folder: Path
) -> dict[str, EmulatedBoard]:
    from haptic_accel.devices.serial.protocol import Identity, axes_bits
    from haptic_accel.emulators.serial_line import EmulatedBoard

    def board(
        side: str, sensor: AccelerometerParameters, full_scale_current: float
    ) -> EmulatedBoard:
        identity = Identity(
            FIRMWARE,
            axes_bits("xyz"),
            HIGHEST_RATE,
            sensor.range,
            full_scale_current,
            f"emulated-{side}",
        )
        return EmulatedBoard(identity, folder / side, arguments.seed)

    boards = {
        MASTER: board(
            MASTER, rig.master.accelerometer, rig.master.actuator.peak_force / FORCE_CONSTANT
        ),
        SLAVE: board(SLAVE, rig.slave.accelerometer, 0.0),
    }
    boards[MASTER].gravity = arguments.master_gravity
    return boards


def _tell(folder: Path) -> None:
    """Write the parameter file of a graph that uses the boards, and say how to start it."""
    path = folder / "serial.yaml"
    write_parameters(
        path, "serial", {side: {"port": str(folder / side)} for side in (MASTER, SLAVE)}
    )
    print(
        "emulating two boards; in another terminal:\n"
        f"  haptic-accel teleop master:=serial slave:=serial config:={path}",
        flush=True,
    )


def _run(emulator: Emulator, arguments: EmulateSerialArguments) -> None:
    """Go on until a signal, or the end of the duration."""
    # A board is never kept waiting by the nodes that it serves. Only here is ROS waited for.
    from haptic_accel.nodes.scheduling import ask_for_realtime, sharpen_timers

    sharpen_timers()
    ask_for_realtime()
    with until_stopped(
        arguments.duration, lambda: emulator.exploring, "the hand begins to explore"
    ) as ended:
        emulator.run(ended)
