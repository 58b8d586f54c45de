# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel emulate``: boards or arms with the virtual rig."""

from __future__ import annotations

import itertools
import math
import random
import shlex
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from haptic_accel import Axes, Checked, GraphArguments, Setup, Vector, commands, parameter
from haptic_accel.core import ALL_AXES, GRAVITY, ZERO, RigParameters, located
from haptic_accel.core.parameters import from_flat, like
from haptic_accel.core.tick import PositionPositionCoupling
from haptic_accel.devices import SimulatedDevice, SimulatedMaster, SimulatedSlave
from haptic_accel.devices.can import KINEMATICS, CanParameters, bus_configuration, open_bus
from haptic_accel.devices.serial import HIGHEST_BOARD_RATE, MISSING_LIBRARY
from haptic_accel.kits.emulators import ports
from haptic_accel.kits.emulators.can_line import BusPort, CanLine, EmulatedArm, SlcanPort
from haptic_accel.kits.emulators.ports import FaultKind, Faults
from haptic_accel.setup import parameter_text

if TYPE_CHECKING:
    from haptic_accel.kits.emulators.serial_line import EmulatedBoard, SerialLines

MASTER, SLAVE = SIDES = "master", "slave"

TIMEOUTS = {"start_timeout": 10.0, "heartbeat_timeout": 1.0, "estimates_timeout": 0.5}
"""Time-outs of the CAN driver; the emulator shares the machine with the graph, and may stall."""

WATCHDOG = 0.5
"""Time-out of the axes' watchdogs, s."""

KEYS = (
    "u, d: hold both boards still, all axes up or down; 1 to 6: only x up, x down, y up, y down, z"
    " up, z down; l: put them back; h, t: tap the handle or the tool; m: read the meters for the"
    " coils' currents; x: unplug one board"
)
"""Keys in the terminal of the emulated boards, in place of a person's hands."""

TAP, TAP_DECAY = 20.0, 5e-3
"""Acceleration of a tap with a finger, m/s^2, and the time constant of its decay, s (assumed)."""

SLCAN_OPTIONS = '{"sleep_after_open": 0}'
"""Options of python-can without its wait of two seconds for adapters that restart when opened."""


def faults_argument(kinds: Mapping[str, FaultKind], beginning: str) -> Any:
    """Declare the faults to inject."""
    texts = "; ".join(f"{name}: {kind.text}" for name, kind in kinds.items())
    return parameter(
        "", f"faults, separated by commas: NAME, or NAME@SECONDS after {beginning}. {texts}"
    )


@dataclass(frozen=True)
class EmulationArguments(Checked):
    """Arguments of all emulators."""

    rig: str = like(GraphArguments, "rig")
    grip: str = like(GraphArguments, "grip")
    surface: str = parameter(
        "plywood", "surface under the tool: plywood, text, vinyl, or a .yaml file"
    )
    seed: int = like(GraphArguments, "seed")
    folder: str = parameter(
        "", "folder of the ports and the parameter file; empty for a new temporary one"
    )
    fault_seconds: float = parameter(
        1.0, "duration of a fault with a time", unit="s", low=0.001, high=1e6
    )
    duration: float = parameter(
        0.0, "duration of the emulation; 0 = until stopped", unit="s", low=0.0, high=1e6
    )

    def virtual_rig(self) -> RigParameters:
        """Return a graph's parameters of the virtual rig."""
        graph = GraphArguments(rig=self.rig, grip=self.grip, surface=self.surface, seed=self.seed)
        return Setup.of(graph).rig()

    def made_folder(self, kind: str) -> Path:
        """Return the folder for the emulation, which is made if it does not exist.

        Raises
        ------
        ParameterError
            The path is not a folder, or the folder cannot be made.
        """
        if not self.folder:
            return Path(tempfile.mkdtemp(prefix=f"haptic-accel-{kind}-"))
        folder = Path(self.folder).absolute()
        with located(f"folder = '{self.folder}'", unreadable="must be a folder or new: "):
            folder.mkdir(parents=True, exist_ok=True)
        return folder


@dataclass(frozen=True)
class EmulateSerialArguments(EmulationArguments):
    """Arguments of the emulated boards."""

    faults: str = faults_argument(ports.SERIAL_FAULTS, "the hand begins to explore")
    fault_board: str = parameter(MASTER, "board with the faults", choices=SIDES)


@dataclass(frozen=True)
class EmulateCanArguments(EmulationArguments):
    """Arguments of the emulated arms."""

    kinematics: str = like(CanParameters, "kinematics")
    rate: float = parameter(
        500.0, "rate of estimates and of the virtual rig", unit="Hz", low=50.0, high=1000.0
    )
    interface: str = parameter(
        "", "python-can interface, with both arms on one bus; empty for two slcan adapters"
    )
    channel: str = parameter("", "channel of the interface")
    faults: str = faults_argument(ports.CAN_FAULTS, "the first torque")
    fault_arm: str = parameter(SLAVE, "arm with the faults", choices=SIDES)


@commands.verb(
    "haptic-accel emulate serial",
    "haptic-accel emulate serial folder:=boards surface:=text duration:=60",
    "haptic-accel emulate serial faults:=garbage,stall@2 fault_board:=slave",
    name="serial",
)
@commands.arguments(EmulateSerialArguments)
def emulate_serial(arguments: EmulateSerialArguments) -> None:
    """Emulate the boards of handle and tool on pseudo-terminals until Ctrl-C."""
    faults = _faults(arguments, arguments.faults, arguments.fault_board, ports.SERIAL_FAULTS)
    rig = arguments.virtual_rig()
    devices = {side: _simulated(rig, side, GraphArguments.rate, arguments.seed) for side in SIDES}
    try:
        from haptic_accel.kits.emulators.serial_line import CoupledArms, SerialLines
    except ImportError:
        raise commands.StoppedError(f"serial: {MISSING_LIBRARY}") from None
    # Real-time priority, so that the nodes do not delay the boards.
    from haptic_accel.nodes.timing import ask_for_realtime, sharpen_timers

    folder = arguments.made_folder("serial")
    held = _Held(arguments.seed)
    boards = [
        _board(rig, side, folder / side, devices[side], faults[side], held) for side in SIDES
    ]
    arms = CoupledArms(boards, list(devices.values()), PositionPositionCoupling(rig.coupling))
    given = {
        side: {"port": str(folder / side), "axes": ", ".join(devices[side].axes.names)}
        for side in SIDES
    }
    known = arguments.rig == EmulateSerialArguments.rig
    # The argument rig gives the compensator the plant.
    words = "" if known else f"rig:={shlex.quote(arguments.rig)} "
    _announce("boards", "serial", folder, given, words)
    sharpen_timers()
    ask_for_realtime()
    lines = SerialLines(boards, arms)
    unplugged = faults[arguments.fault_board]
    keys: dict[bytes, Callable[[], None]] = {
        b"u": partial(held.tilt, (GRAVITY,) * 3),
        b"d": partial(held.tilt, (-GRAVITY,) * 3),
        b"l": partial(held.tilt, ZERO),
        b"x": partial(unplugged.inject, ports.UNPLUG, arguments.fault_seconds),
        b"h": partial(held.tap, MASTER),
        b"t": partial(held.tap, SLAVE),
        b"m": lambda: print(f"current {_currents(boards[0], devices[MASTER])} A", flush=True),
    }
    poses = itertools.product(ALL_AXES.names, (GRAVITY, -GRAVITY))
    for index, (name, gravity) in enumerate(poses, start=1):
        keys[b"%d" % index] = partial(held.tilt, Axes((name,)).vector([gravity]))
    with commands.on_keys(keys) as read:
        if read:
            print(f"keys: {KEYS}", flush=True)
        _run([lines], arguments.duration, lambda: arms.coupled, "the hand begins to explore")


@commands.verb(
    "haptic-accel emulate can",
    "haptic-accel emulate can kinematics:=stage folder:=arms",
    "haptic-accel emulate can faults:=estimates@2",
    name="can",
)
@commands.arguments(EmulateCanArguments)
def emulate_can(arguments: EmulateCanArguments) -> None:
    """Emulate master and slave arms of ODrives on CAN until Ctrl-C.

    They are behind slcan adapters on pseudo-terminals or on any bus of python-can.
    """
    faults = _faults(arguments, arguments.faults, arguments.fault_arm, ports.CAN_FAULTS)
    rig = arguments.virtual_rig()
    folder = arguments.made_folder("can")
    given = {side: _driver_parameters(arguments, side, folder) for side in SIDES}
    parameters = {side: from_flat(CanParameters, values) for side, values in given.items()}
    rate = arguments.rate
    arms = {
        side: EmulatedArm(
            parameters[side],
            _simulated(rig, side, rate, arguments.seed),
            rate=rate,
            watchdog=WATCHDOG,
            seed=arguments.seed + index,
        )
        for index, side in enumerate(SIDES)
    }
    if arguments.interface:
        configuration = bus_configuration(parameters[MASTER])
        port = BusPort(lambda: open_bus(configuration, []))
        first = arguments.fault_arm
        in_order = [arms.pop(first), *arms.values()]
        lines = [CanLine(port, in_order, rate, faults[first])]
    else:
        lines = [
            CanLine(SlcanPort(folder / side), [arms[side]], rate, faults[side]) for side in SIDES
        ]
    _announce("arms", "can", folder, given, f"rate:={rate:g} ")

    def driven() -> bool:
        return any(line.driven for line in lines)

    _run(lines, arguments.duration, driven, "the arms have torques")


def _faults(
    arguments: EmulationArguments, names: str, faulty: str, kinds: Mapping[str, FaultKind]
) -> dict[str, Faults]:
    """Return the faults of each side: the named ones for `faulty`, otherwise none."""
    given = Faults(names, kinds, arguments.fault_seconds, arguments.seed)
    return {side: given if side == faulty else Faults() for side in SIDES}


def _simulated(rig: RigParameters, side: str, rate: float, seed: int) -> SimulatedDevice:
    """Return one side of the virtual rig."""
    device = SimulatedMaster if side == MASTER else SimulatedSlave
    return device(getattr(rig, side), rate, seed)


class _Held:
    """Simulated accelerations of boards: on their arms, held still, or tapped by a person.

    Parameters
    ----------
    seed : int
        Seed of the sensors' noise.
    """

    def __init__(self, seed: int) -> None:
        self._gravity = ZERO
        self._random = random.Random(seed)
        self._before: dict[str, Vector] = {}
        self._tapped = dict.fromkeys(SIDES, -math.inf)
        self._asked: set[str] = set()

    def tilt(self, gravity: Vector) -> None:
        """Set gravity along the axes of held boards, m/s^2; zero for boards on their arms."""
        self._gravity = gravity

    def tap(self, side: str) -> None:
        """Tap one side's board."""
        self._asked.add(side)

    def measured(
        self, side: str, time: float, acceleration: Vector, noise: float, axes: Axes
    ) -> Vector:
        """Return the noisy measurement of a sensor, m/s^2, for the acceleration of its arm.

        Until its first force, the rig is at rest and its sensors have no noise; this method then
        adds the noise.
        """
        still = acceleration == self._before.get(side)
        self._before[side] = acceleration
        held = any(self._gravity)
        components = axes.components(self._gravity if held else acceleration)
        if held or still:
            components = [each + self._random.gauss(0.0, noise) for each in components]
        if side in self._asked:
            self._asked.remove(side)
            self._tapped[side] = time
        since = time - self._tapped[side]
        tap = TAP * math.exp(-since / TAP_DECAY) if since >= 0 else 0.0
        return axes.vector([each + tap for each in components])


def _currents(board: EmulatedBoard, device: SimulatedDevice) -> str:
    """Return the currents of a board's coils as text."""
    return ", ".join(f"{current:.4f}" for current in device.axes.components(board.currents))


def _board(
    rig: RigParameters, side: str, port: Path, device: SimulatedDevice, faults: Faults, held: _Held
) -> EmulatedBoard:
    """Return the board of one side; only the master's has an actuator."""
    from haptic_accel.devices.serial.protocol import FIRMWARE, Identity, axes_bits
    from haptic_accel.kits.emulators.serial_line import EmulatedBoard

    actuator = rig.master.actuator
    axes = device.axes
    full_scale = actuator.peak_force / abs(actuator.force_constant) if side == MASTER else 0.0
    full_scales = axes.vector([full_scale] * len(axes.names))
    sensor = getattr(rig, side).accelerometer

    def measure(time: float) -> Vector:
        return held.measured(side, time, device.read(time).acceleration, sensor.noise, axes)

    def drive(time: float, currents: Vector) -> None:
        x, y, z = (current * actuator.force_constant for current in currents)
        device.write(time, actuator_force=(x, y, z))

    name = f"emulated-{side}"
    identity = Identity(
        FIRMWARE, axes_bits("xyz"), HIGHEST_BOARD_RATE, sensor.range, full_scales, name
    )
    return EmulatedBoard(identity, port, measure, drive, faults)


def _driver_parameters(arguments: EmulateCanArguments, side: str, folder: Path) -> dict[str, Any]:
    """Return the parameters of an arm's driver, by dotted name."""
    shared = {"kinematics": arguments.kinematics, "rearm": "auto", **TIMEOUTS}
    if not arguments.interface:
        channel = {"channel": str(folder / side), "options": SLCAN_OPTIONS}
        return {"interface": "slcan", **channel, **shared}
    # Both arms are on one bus: the slave's node numbers follow the master's.
    first = 0 if side == MASTER else len(KINEMATICS)
    nodes = {f"joint{index + 1}.node_id": first + index for index in range(len(KINEMATICS))}
    return {"interface": arguments.interface, "channel": arguments.channel, **shared, **nodes}


def _announce(
    emulated: str, device: str, folder: Path, given: Mapping[str, Any], words: str = ""
) -> None:
    """Write the parameters of each side's driver, and print how to start a graph with them."""
    config = folder / f"{device}.yaml"
    nodes = {
        f"{side}_device": {"device": device, device: values} for side, values in given.items()
    }
    config.write_text(parameter_text(nodes), encoding="utf-8")
    print(
        f"emulating two {emulated}; in another terminal:\n"
        f"  haptic-accel teleop master:={device} slave:={device} {words}"
        f"{shlex.quote(f'params_file:={config}')}",
        flush=True,
    )


def _run(
    lines: Sequence[CanLine | SerialLines], duration: float, begun: Callable[[], bool], line: str
) -> None:
    """Emulate until a signal or the end of a duration, s; print a line once `begun` is true."""
    start, printed = monotonic(), False

    def ended() -> bool:
        nonlocal printed
        if begun() and not printed:
            printed = True
            print(line, flush=True)
        return bool(duration and monotonic() - start >= duration) or stopped()

    try:
        with commands.stop_on_signal() as stopped:
            ports.run(lines, ended)
    finally:
        for each in lines:
            each.close()
