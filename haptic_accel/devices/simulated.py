# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated devices: the two sides of the virtual rig."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from haptic_accel.core.axes import ALL_AXES, Axes
from haptic_accel.core.bounded_work import without_bounded_work
from haptic_accel.core.model import FloatArray, GripParameters, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter, schema, shown
from haptic_accel.core.rig import Rig, master_rig, slave_rig
from haptic_accel.core.sampling import crossfaded
from haptic_accel.core.surfaces.texture import Texture
from haptic_accel.core.surfaces.virtual_rig import VirtualRig, VirtualRigParameters
from haptic_accel.core.tick.rigs import GuidedHand, Hand
from haptic_accel.devices.interface import Device, DeviceDescription
from haptic_accel.materials.folders import preset_file
from haptic_accel.materials.recordings import AXES, read_recording
from haptic_accel.materials.scenes import read_scene
from haptic_accel.materials.texture_files import read_texture


class SimulatedDevice(Rig, Device):
    """One side of the virtual rig, which is always available.

    Forces may be written before earlier samples are read.
    """

    description = DeviceDescription(framed=True)

    _rig: Rig

    def _play(self, rig: Rig) -> None:
        self._rig, self.motion = rig, rig.motion

    def open(self) -> None:
        """Continue the rig's time with the first read or write."""
        self.motion.restart()

    def close(self) -> None:
        """Remove all forces."""
        self.motion.restart()
        self.release()

    def counters(self) -> dict[str, int]:
        """Return the rig's counts."""
        return self._rig.counters()


class SimulatedMaster(SimulatedDevice):
    """Hand, handle, voice coil and arm."""

    Parameters = master_rig.SimulatedMasterParameters
    description = DeviceDescription(changeable=tuple(schema(GripParameters, "grip.")), framed=True)

    _rig: master_rig.MasterRig | master_rig.ThreeAxisRig

    def __init__(
        self,
        parameters: master_rig.MasterRigParameters,
        rate: float,
        seed: int,
        hand: Hand | None = None,
    ) -> None:
        self.axes = master_rig.axes_of(parameters)
        self._play(master_rig.simulated_master(parameters, rate, seed, hand))

    def change(self, parameters: master_rig.MasterRigParameters) -> None:
        """Change the user's grip of the handle."""
        self._rig.hold(parameters.grip)


class PointerMaster(SimulatedMaster):
    """Simulated master whose hand follows points instead of its script."""

    description = replace(SimulatedMaster.description, parameters_of=("simulated",), pointed=True)

    def __init__(self, parameters: master_rig.MasterRigParameters, rate: float, seed: int) -> None:
        self._hand = GuidedHand(parameters.exploration.height)
        super().__init__(parameters, rate, seed, self._hand)

    def point(self, position: Vector) -> None:
        """Move the hand along x and z, within its workspace."""
        self._hand.point(position[0], position[2])


@dataclass(frozen=True)
class RecordingParameters(Checked):
    """Recorded tool acceleration in place of the simulated one."""

    file: str = parameter(
        "", "CSV or WAV file of an acceleration; empty to simulate the surface's texture"
    )
    rate: float = parameter(
        0.0,
        "sampling rate of a CSV file without a column of times; other files have their own",
        unit="Hz",
        low=0.0,
        high=1e6,
    )
    column: str = parameter("", "column of a CSV or channel of a WAV file; empty: the usual names")


@dataclass(frozen=True)
class SimulatedSlaveParameters(slave_rig.SlaveRigParameters):
    """All parameters of the simulated slave."""

    recording: RecordingParameters = field(default_factory=RecordingParameters)


class SimulatedSlave(SimulatedDevice):
    """Tool and arm on a surface."""

    Parameters = SimulatedSlaveParameters
    description = DeviceDescription(
        changeable=tuple(schema(slave_rig.SurfaceParameters, "surface.")), framed=True
    )

    _rig: slave_rig.SlaveRig

    def __init__(self, parameters: SimulatedSlaveParameters, rate: float, seed: int) -> None:
        self._grain = rate, seed
        self.axes = Axes.parsed(parameters.tool.axes)
        texture = textured(parameters.surface, rate, seed)
        recording = played(parameters.recording, rate, self.axes)
        self._play(slave_rig.SlaveRig(parameters, rate, seed, recording, texture=texture))

    def change(self, parameters: SimulatedSlaveParameters) -> None:
        """Change the surface under the tip.

        Raises
        ------
        ParameterError
            A recording replaces the surface's texture, or there is no such texture.
        """
        if parameters.recording.file:
            raise ParameterError("surface: cannot be changed while a recording is played")
        self._rig.change_surface(parameters.surface, textured(parameters.surface, *self._grain))


def textured(
    surface: slave_rig.SurfaceParameters, rate: float, seed: int
) -> slave_rig.Vibrating | None:
    """Return a surface's named texture at a rate in Hz; None without a name.

    Raises
    ------
    ParameterError
        The texture is missing, or its file is invalid.
    """
    if not surface.texture:
        return None
    return Texture(read_texture(preset_file("texture", surface.texture)), rate, seed).synthesize


def played(
    recording: RecordingParameters, rate: float, axes: Axes = ALL_AXES
) -> FloatArray | None:
    """Return one pass of a recording at a rate in Hz, m/s^2; None without a file.

    Raises
    ------
    ParameterError
        The file or a parameter is not usable, or the file has three axes for a tool with one.
    """
    if not recording.file:
        return None
    samples = read_recording(
        recording.file, recording.rate, rate, recording.column, most_columns=AXES
    )
    if samples.ndim > 1 and len(axes.names) == 1:
        raise ParameterError(
            f"{shown(recording.file)}: column = {shown(recording.column)}: must be one column,"
            f" as the tool measures along {axes.names[0]} only; with a rig of three axes or a"
            " reduction it measures three"
        )
    return crossfaded(samples, rate)


TOO_LONG = "takes longer than a running graph can wait: must be named at its start"
"""Reason why a running tool refuses a moving scene, or a mesh without a grid."""


@dataclass(frozen=True)
class VirtualSlaveParameters(VirtualRigParameters):
    """All parameters of the virtual slave."""

    scene: str = parameter("", "file of the scene")


class VirtualSlave(SimulatedDevice):
    """Tool and arm in a scene."""

    Parameters = VirtualSlaveParameters
    description = DeviceDescription(changeable=("scene",), framed=True)

    _rig: VirtualRig

    def __init__(self, parameters: VirtualSlaveParameters, rate: float, seed: int) -> None:
        scene = read_scene(Path(parameters.scene))
        self._play(VirtualRig(parameters, scene, rate, seed))
        self.axes = Axes.parsed(parameters.tool.axes)

    def change(self, parameters: VirtualSlaveParameters) -> None:
        """Change the scene under the tool.

        Raises
        ------
        ParameterError
            The scene's file is not usable, or loading it would block the device.
        """
        with without_bounded_work(TOO_LONG):
            self._rig.change_scene(read_scene(Path(parameters.scene)))
