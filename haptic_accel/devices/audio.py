# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Actuator driven by a sound card and amplifiers, in addition to the master's own device."""

from __future__ import annotations

import atexit
import math
import re
import threading
import time as clocks
from bisect import insort
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import read_mounting
from haptic_accel.core.model import ZERO, AccelerometerParameters, FloatArray, Force, Vector
from haptic_accel.core.parameters import Checked, ParameterError, like, one_line, parameter, shown
from haptic_accel.devices import interface
from haptic_accel.devices.interface import DeviceError
from haptic_accel.devices.serial.device import SerialMasterParameters
from haptic_accel.devices.simulated import SimulatedDevice


class AudioPreset(NamedTuple):
    """Coils behind a sound card whose handle has not been identified.

    Attributes
    ----------
    device : str
        Part of the sound card's name; empty for the default card.
    channels : str
        Output channels of the coils, from 1.
    rate : float
        Samples per second, Hz; 0 for the card's default.
    assumed : str
        Assumptions, and their source.
    unknown : str
        Properties that must be identified before forces are in newtons and controllers have a
        handle model.
    """

    device: str
    channels: str
    rate: float
    assumed: str
    unknown: str


PRESETS = {
    "dualsense": AudioPreset(
        *("DualSense", "3, 4", 48000.0),
        "a DualSense on USB, by its public descriptor: four channels of 16 bit at 48 kHz, of which"
        " 3 and 4 are the voice coils in the left and right grip",
        "force at full scale; the grips' dynamics: its own inertial sensor, at some 250 Hz, is too"
        " slow, so fix an accelerometer to a grip",
    ),
    "exciter": AudioPreset(
        *("", "1, 2", 0.0),
        "an exciter on either channel of a stereo amplifier, fixed to the handle",
        "force at full scale, which the amplifier's volume sets; resonance; mass of the handle",
    ),
    "bass_shaker": AudioPreset(
        *("", "1, 2", 0.0),
        "a bass shaker on either channel of a stereo amplifier, fixed to the handle",
        "force at full scale, which the amplifier's volume sets; resonance, often at some 40 Hz,"
        " above which the force falls; mass of the handle",
    ),
}
"""Presets by name."""


AUDIO = "audio"
"""Name of the actuator that a sound card drives."""

MISSING_LIBRARY = "audio: needs sounddevice and PortAudio: pip install 'haptic_accel[audio]'"

BLOCKS_AHEAD = 2
"""Number of blocks ready for the card: one is fetched, the other is a margin."""

LATENCY = 3
"""Latency requested from PortAudio, blocks: with ALSA, PortAudio's buffer has one block more. The
latency depends on the filled part of that buffer."""

READINGS = 64
"""Number of readings of a card's queue of which the shortest counts. Many cards update the queue
once per block, so readings are never too short."""

ALSA, JACK = "ALSA", "JACK Audio Connection Kit"
"""PortAudio's names of host APIs."""

ATTEMPTS = 5
"""Number of recordings after which a card that loses samples in each is refused."""

FIRST_BLOCK = 2.0
"""Longest time from the start of a card until its first block, s; sound servers need up to 1 s."""

WATCH_PERIOD = 0.02
"""Polling interval of a recording, s."""

LONGEST_END = 2.0
"""Longest time for PortAudio to close a card, s; closing never returns without JACK's server."""

PLUG_IN_CHANNELS = 32
"""Number of channels from which on an ALSA device that is not hardware is a plug-in with any
number of channels: PulseAudio's states 32, PipeWire's 64, and PortAudio limits others to 128."""

SHARE = 0.25
"""Share of the card clock's error that is corrected after `READINGS`: at 1 kHz a drift of 1e-4
leaves 26 us."""


@dataclass(frozen=True)
class InputParameters(Checked):
    """Sound card with an accelerometer on its inputs."""

    device: str = parameter(
        "",
        "name of the sound card, or a part of it, as `haptic-accel doctor audio` lists it; empty"
        " for the preset's, or the default",
    )
    block: int = parameter(
        64,
        "samples that the card fetches at a time; larger blocks need more latency",
        low=8,
        high=4096,
    )
    inputs: str = parameter(
        "1",
        "input channels of the accelerometer, from 1: one for the actuator's axis, or three for x,"
        " y, z",
    )
    scales: str = parameter(
        "",
        "acceleration at full scale of each input, m/s^2, negative for a swapped polarity;"
        " `haptic-accel calibrate audio` finds it",
    )
    bandwidth: float = like(AccelerometerParameters, "bandwidth")
    ac_corner: float = parameter(
        0.0,
        "corner of the inputs' AC coupling, which is undone above 0.3 Hz; 0 for inputs that pass"
        " constant voltages",
        "Hz",
        0.0,
        40.0,
    )


@dataclass(frozen=True)
class AudioParameters(InputParameters):
    """Sound card that drives the actuator, of one coil or three."""

    preset: str = parameter(
        "",
        "kind of the coils, whose card, channels and rate are assumed where not given; a first"
        " touch, not a bench, until the handle is identified; empty for none",
        choices=tuple(PRESETS),
    )
    channels: str = parameter(
        "",
        "output channels of the coils, from 1, such as 3, 4: a single coil's force is on all of"
        " them; three coils have one each, or three from the first on; the card's other channels"
        " are silent; empty for the preset's, or 1",
    )
    full_scale: float = parameter(
        0.0,
        "force of a coil at the card's full scale, negative where wires are swapped;"
        " `identify actuator:=audio` finds it; 0 for actuator.peak_force",
        "N",
        -1000.0,
        1000.0,
    )
    coil_mounting: str = like(SerialMasterParameters, "coil_mounting")
    actuator: ActuatorParameters = field(default_factory=ActuatorParameters)

    @property
    def largest_force(self) -> float:
        """Actuator force at full scale, N, assumed where it is not calibrated."""
        return self.full_scale or self.actuator.peak_force

    @property
    def assumed(self) -> AudioPreset:
        """Preset for omitted values."""
        return PRESETS.get(self.preset, AudioPreset("", "1", 0.0, "", ""))

    @property
    def card_name(self) -> str:
        """Name of the sound card, or a part of it; empty for the default card."""
        return self.device or self.assumed.device

    def channels_of(self, coils: int) -> tuple[int, ...]:
        """Return the channels of one coil, or of each of three, from 1.

        Raises
        ------
        ParameterError
            The channels are invalid, or do not match the number of coils.
        """
        channels = self.channels or self.assumed.channels
        found = read_channels("audio.channels", channels)
        if coils > 1 and len(found) == 1:
            found = tuple(range(found[0], found[0] + coils))
        if coils > 1 and len(found) != coils:
            raise ParameterError(
                f"audio.channels = {shown(repr(channels))}: must be {coils} channels, one for each"
                " coil, or the first of them"
            )
        return found


def read_channels(name: str, text: str) -> tuple[int, ...]:
    """Return a card's channels, from 1, such as "3, 4".

    Raises
    ------
    ParameterError
        The channels are invalid, or one occurs twice.
    """
    parts = [part.strip() for part in text.split(",")]
    found = tuple(int(part) for part in parts if re.fullmatch("[1-9][0-9]{0,2}", part))
    if len(found) < len(parts) or len(set(found)) < len(found):
        raise ParameterError(
            f"{name} = {shown(repr(text))}: must be different whole numbers from 1, such as '3, 4'"
        )
    return found


def sound_server(card: Mapping[str, Any], host: str) -> str:
    """Return the sound server between PortAudio and a card; empty for direct access.

    Parameters
    ----------
    card : mapping
        Device, as `sounddevice.query_devices` returns it.
    host : str
        Name of its host API.
    """
    if host != ALSA:
        return host
    any_number = card["max_output_channels"] >= PLUG_IN_CHANNELS and "(hw:" not in card["name"]
    return "ALSA's plug-in, or a sound server" if any_number else ""


@dataclass(frozen=True)
class ListedCard:
    """Device with outputs, as PortAudio lists it.

    Attributes
    ----------
    name : str
    channels : int
        Maximum number of output channels.
    rate : float
        Default rate, Hz.
    server : str
        Sound server that mixes or resamples; empty for direct access.
    is_default : bool
    """

    name: str
    channels: int
    rate: float
    server: str
    is_default: bool


def sound_cards() -> list[ListedCard]:
    """Return the devices with outputs.

    Raises
    ------
    DeviceError
        The library is missing.
    """
    library = sound_library()
    return [
        ListedCard(
            found["name"],
            found["max_output_channels"],
            found["default_samplerate"],
            sound_server(found, library.query_hostapis(found["hostapi"])["name"]),
            found["index"] == library.default.device[1],
        )
        for found in library.query_devices()
        if found["max_output_channels"]
    ]


def sound_library() -> Any:
    """Return the library `sounddevice`.

    Raises
    ------
    DeviceError
        The library or PortAudio is missing.
    """
    try:
        import sounddevice
    except (ImportError, OSError):  # the latter without PortAudio
        raise DeviceError(MISSING_LIBRARY) from None
    return sounddevice


def recorded(
    name: str, seconds: float, inputs: int, played: FloatArray | None = None
) -> tuple[FloatArray, float]:
    """Record from a sound card, optionally while playing; return samples and rate.

    Parameters
    ----------
    name : str
        Name of the card, or a part of it; empty for the default.
    seconds : float
        Duration, s.
    inputs : int
        Number of input channels from the first on.
    played : ndarray, shape (n, outputs), optional
        Samples of the outputs from the first on, at the card's rate, relative to full scale.

    Returns
    -------
    samples : ndarray, shape (m, inputs)
        Samples relative to full scale.
    rate : float
        Samples per second.

    Raises
    ------
    DeviceError
        There is no such card, it has fewer channels, it cannot be opened, it delivers no samples,
        or it loses samples in all attempts.
    """
    library = sound_library()
    with refusals(library, f"device = {name!r}"):
        found = library.query_devices(name or None, "input")
        rate, device = found["default_samplerate"], found["index"]
        record = library.rec if played is None else library.playrec
        length_or_sound = round(seconds * rate) if played is None else played
        for _ in range(ATTEMPTS):
            samples = record(length_or_sound, rate, inputs, "float32", device=device)
            if not (lost := _recording_ended(library, len(samples) / rate)):
                break
        if lost or not np.isfinite(samples).all():
            what = f"lost samples ({lost})" if lost else "gave samples that are not finite numbers"
            raise ValueError(f"{what} while it recorded; record again")
    return np.clip(samples, -1.0, 1.0).astype(np.float64), float(rate)


@contextmanager
def refusals(library: Any, name: str) -> Iterator[None]:
    """Convert PortAudio's errors to a one-line `DeviceError` with a name."""
    try:
        yield
    except (ValueError, library.PortAudioError) as error:
        if isinstance(error, ParameterError):
            raise
        raise DeviceError(f"{name}: {one_line(error)}") from None


def started_stream(
    library: Any, index: int, channels: int | tuple[int, int], block: int, rate: float
) -> Any:
    """Return a started stream of a device with outputs, or with inputs and outputs."""
    kind = library.OutputStream if isinstance(channels, int) else library.Stream
    settings = {"channels": channels, "samplerate": rate, "blocksize": block, "dtype": "float32"}
    with refusals(library, f"sound card {library.query_devices(index)['name']} at {rate:g} Hz"):
        stream = kind(device=index, latency=LATENCY * block / rate, **settings)
        stream.start()
    return stream


def _recording_ended(library: Any, seconds: float) -> Any:
    """Wait until a recording of a duration in s ends; return whether samples were lost."""
    end = clocks.monotonic() + seconds + FIRST_BLOCK
    while library.get_stream().active:
        if clocks.monotonic() > end:
            raise ValueError(f"gives no samples within {FIRST_BLOCK:g} s")
        clocks.sleep(WATCH_PERIOD)
    return library.wait()


def end_stream(library: Any, stream: Any) -> None:
    """Silence and close a stream; do not wait for a server that has ended."""
    ending = threading.Thread(target=stream.close, daemon=True)
    ending.start()
    ending.join(LONGEST_END)
    if ending.is_alive():
        atexit.unregister(library._exit_handler)  # which would also wait forever


class SoundCard:
    """Sound card output that never blocks.

    Without new samples the card is silent, so a process that hangs leaves no force. All channels
    of a card are opened; channels without a coil output zero.

    Parameters
    ----------
    parameters : AudioParameters
    period : float
        Maximum interval between two calls of `write`, s.
    coils : int
        Number of coils.

    Attributes
    ----------
    rate : float
        Samples per second of the card.
    channels : int
        Number of opened channels: all channels of the card.
    block : int
        Number of samples that the card fetches at a time: as requested, or the card's minimum.
    server : str
        Sound server that mixes or resamples; empty for direct access.
    lead : float
        Time from writing a sample to the card until its output, s.
    input_delay : float
        Time from a sample of the card's inputs until it can be read, s; 0 without inputs.
    """

    is_exact = False
    """True if `sounds` is exact. Otherwise its result is late by up to a block, and the shortest
    delays show the card's clock."""

    def __init__(self, parameters: AudioParameters, period: float, coils: int = 1) -> None:
        self._library = sound_library()
        self._parameters = parameters
        self._period = period
        self._own = [channel - 1 for channel in parameters.channels_of(coils)]
        self._stream: Any = None
        self.channels = self._size = self.block = 0
        self.rate = self.lead = math.nan
        self.input_delay = 0.0
        self.name = self.server = ""

    def open(self) -> None:
        """Start the card, silent.

        Raises
        ------
        ParameterError
            The card has no such channel.
        DeviceError
            There is no such card, or it cannot be opened.
        """
        p, library = self._parameters, self._library
        if not p.card_name and library.default.device[1] < 0:
            raise DeviceError("audio.device = '': must name a sound card, as none is the default")
        with refusals(library, f"audio.device = {p.card_name!r}"):
            found = library.query_devices(p.card_name or None, "output")
            self.name, self.rate = found["name"], p.assumed.rate or found["default_samplerate"]
            most = found["max_output_channels"]
            self._check_channels(most)
            host = library.query_hostapis(found["hostapi"])["name"]
            if host == JACK:
                raise ValueError(
                    "must not be on JACK, to which PortAudio 19.6 writes beyond its memory; stop"
                    " JACK, and name the card itself (hw:)"
                )
            # PortAudio copies the last channel to the next unopened one. A plug-in with any number
            # of channels mixes surplus ones.
            self.server = sound_server(found, host)
            any_number = host == ALSA and self.server
            self.channels = max(*self._own, min(2, most) - 1) + 1 if any_number else most
            self._stream = started_stream(
                library, found["index"], self.channels, p.block, self.rate
            )
        self._fill(self._free(), self._stream.latency)

    def _check_channels(self, most: int) -> None:
        p, last = self._parameters, max(self._own) + 1
        if last > most:
            raise ParameterError(
                f"audio.channels = {p.channels or p.assumed.channels!r}: channel {last} must be at"
                f" most {most}, as the sound card {self.name} has no more"
            )

    def _fill(self, size: int, latency: float) -> None:
        """Derive block and lead from the card's block size, samples, and stated latency, s."""
        self._size = size
        self.block = max(self._parameters.block, size - round(latency * self.rate))
        self.lead = BLOCKS_AHEAD * self.block / self.rate + self._period

    @property
    def room(self) -> int:
        """Number of samples that the card accepts without blocking."""
        return max(0, self._free() - self.block)

    def sounds(self, now: float) -> float | None:
        """Return the time at which the next written sample is output, s; None without a clock."""
        filled = self._size - self._free()
        return now + filled / self.rate if filled else None

    def write(self, samples: FloatArray) -> bool:
        """Write samples relative to full scale, shape (n, coils); return True on an underrun."""
        frames = np.zeros((len(samples), self.channels), dtype=np.float32)
        frames[:, self._own] = samples
        return bool(self._query(lambda stream: stream.write(frames)))

    def play(self, samples: FloatArray) -> None:
        """Write samples, as for `write`, at the pace at which the card fetches them.

        Raises
        ------
        DeviceError
            The card fetches no samples.
        """
        latest = clocks.monotonic() + FIRST_BLOCK + len(samples) / self.rate
        while len(samples):
            if room := self.room:
                self.write(samples[:room])
            samples = samples[room:]
            if clocks.monotonic() > latest:
                raise DeviceError(f"sound card {self.name}: plays nothing of what it is given")
            clocks.sleep(self.block / self.rate / 2)

    def _free(self) -> int:
        return int(self._query(lambda stream: stream.write_available))

    def _query(self, question: Callable[[Any], Any]) -> Any:
        """Query PortAudio's stream, which fails once the card is unplugged."""
        with refusals(self._library, f"sound card {self.name}"):
            return question(self._stream)

    def close(self) -> None:
        """Silence the card."""
        stream, self._stream = self._stream, None
        if stream is not None:
            end_stream(self._library, stream)


class AudioActuator(interface.CompositeDevice):
    """Master with its actuator on a sound card; another device provides the rest.

    Each tick writes samples to the card, `SoundCard.lead` before their output, so a force known by
    then acts when due. The force also acts on a simulated handle. Another device's actuator has no
    force, as a handle has only one actuator.

    Parameters
    ----------
    parameters : AudioParameters
    rate : float
        Ticks per second.
    device : Device
        Master device for samples and the arm.
    latency : int
        Number of samples from a force's cause to the tick at which the force is due.
    clock : callable
        Function that returns the time on the ticks' clock, s.
    card : callable, optional
        Function that makes the card from parameters, period and number of coils; default:
        `SoundCard`.
    """

    Parameters = AudioParameters
    description = interface.DeviceDescription(ahead=True)

    def __init__(
        self,
        parameters: AudioParameters,
        rate: float,
        device: interface.Device,
        latency: int,
        clock: Callable[[], float] = clocks.monotonic,
        card: Callable[[AudioParameters, float, int], SoundCard] | None = None,
    ) -> None:
        self.axes = device.axes
        self._coils = len(self.axes.names)
        self._mounting = read_mounting("audio.coil_mounting", parameters.coil_mounting, self.axes)
        self._card = (card or SoundCard)(parameters, 1 / rate, self._coils)
        self._parameters = parameters
        self._full_scale = parameters.largest_force
        self._rate = rate
        self._device = device
        self.parts = (device,)
        self._latency = latency
        self._clock = clock
        self._force = HeldForce(self._coils)
        self._waiting: list[tuple[float, Vector]] = []
        self._next = math.nan  # time at which the next written sample is output
        self._errors: list[float] = []
        self._counts: Counter[str] = Counter(audio_underruns=0, audio_clipped=0)
        self._late = 0

    def _open_own(self) -> None:
        """Open the card.

        Raises
        ------
        ParameterError
            The block is too small for the tick period, or the latency is too small for the block.
        DeviceError
            The card fails to open.
        """
        self._card.open()
        card, least = self._card, math.ceil(self._card.rate / self._rate)
        if card.block < least:  # the card frees one block at a time
            raise ParameterError(
                f"audio.block = {card.block}: must be at least {least}, the samples of a tick at"
                f" the sound card's {card.rate:g} Hz"
            )
        # A force is known at most one sample after its cause.
        least = math.ceil((card.lead + card.input_delay) * self._rate) + 1
        if self._latency < least:
            raise ParameterError(
                f"latency = {self._latency}: must be at least {least} with {card.block} samples a"
                f" block at the sound card's {card.rate:g} Hz (audio.block)"
            )

    def read(self, time: float) -> interface.Reading:
        """Return the device's sample, and write due samples to the card."""
        reading = self._device.read(time)
        if reading is not interface.LATER:
            while self._waiting and self._waiting[0][0] <= time:
                self._device.write(time, actuator_force=self._waiting.pop(0)[1])
        self._supply()
        return reading

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Apply the arm's force now, and the actuator's force when due."""
        if actuator_force is not None:
            finite = all(map(math.isfinite, actuator_force))
            self._add(time, actuator_force if finite else ZERO)
        if arm_force is not None:
            self._device.write(time, arm_force=arm_force)

    def _add(self, time: float, force: Vector) -> None:
        turned = self._mounting.coil_forces(force) if self._mounting else force
        coils = self.axes.components(turned)
        simulated = isinstance(self._device, SimulatedDevice)
        if time > self._clock():
            self._late += time < self._next
            self._force.put(time, coils)
            if simulated:
                self._waiting.append((time, force))
            return
        self._force.replace(coils)
        self._waiting.clear()
        if simulated:
            self._device.write(time, actuator_force=force)

    def _supply(self) -> None:
        """Write the samples that are output within the card's lead."""
        now, card = self._clock(), self._card
        dry = now > self._next  # samples due since then were missing
        if not now <= self._next:
            self._next = now
            self._errors.clear()
        elif (sounds := card.sounds(now)) is not None:
            self._follow(sounds - self._next)
        count = min(card.room, int((now + card.lead - self._next) * card.rate))
        if count > 0:
            samples = self._force.means(self._next, card.rate, count) / self._full_scale
            # Scale all coils together, so that a force keeps its direction.
            largest = np.maximum(np.abs(samples).max(axis=1, keepdims=True), 1.0)
            self._counts["audio_clipped"] += int(np.count_nonzero(largest > 1.0))
            dry |= card.write(samples / largest)
            self._next += count / card.rate
        self._counts["audio_underruns"] += dry

    def _follow(self, error: float) -> None:
        """Correct the next sample's time by its measured delay, s."""
        if self._card.is_exact:
            self._next += error
            return
        self._errors.append(error)
        if len(self._errors) < READINGS:
            return
        error = min(self._errors)
        far = abs(error) > self._card.block / self._card.rate
        self._next += error if far else SHARE * error
        self._errors.clear()

    def _close_own(self) -> None:
        """Silence the card at once."""
        self._card.close()

    @property
    def remark(self) -> str:
        """Remark of the device, with card, block, lead, calibration and sound server."""
        card, p = self._card, self._parameters
        channels = ", ".join(map(str, p.channels_of(self._coils)))
        own = (
            f"sound card {card.name}, channel {channels}, {card.block} samples a block at"
            f" {card.rate:g} Hz, supplied {card.lead * 1e3:.1f} ms ahead, full scale"
            f" {self._full_scale:g} N"
        )
        own += "" if p.full_scale else ", not calibrated"
        own += f", preset {p.preset}" if p.preset else ""
        own += f", behind {card.server}, which may resample" if card.server else ""
        return "; ".join(filter(None, (super().remark, own)))

    @property
    def late(self) -> int:
        """Number of forces that arrived after their samples had been written to the card."""
        return self._late

    @property
    def interruptions(self) -> int:
        """Number of interruptions of the device, and of underruns."""
        return super().interruptions + self._counts["audio_underruns"]

    def counters(self) -> dict[str, int]:
        """Return the counts of the device, of underruns, and of samples beyond full scale."""
        return {**self._device.counters(), **self._counts}


class HeldForce:
    """Forces of coils with due times, each held until the next force is due.

    Each output sample is the mean force over its period. A step between two samples thus keeps its
    impulse, and its time to a fraction of a sample.

    Parameters
    ----------
    coils : int

    Examples
    --------
    >>> held = HeldForce(2)
    >>> held.put(0.5, [2.0, 4.0])
    >>> held.means(0.0, 1.0, 2)
    array([[1., 2.],
           [2., 4.]])
    """

    def __init__(self, coils: int = 1) -> None:
        self._waiting: list[tuple[float, Sequence[float]]] = []
        self._held = np.zeros(coils)

    def put(self, due: float, forces: Sequence[float]) -> None:
        """Add the coils' forces, N, with a due time, s; late forces act at once."""
        insort(self._waiting, (due, forces))

    def replace(self, forces: Sequence[float]) -> None:
        """Apply forces in N at once, and discard forces not due yet."""
        self._waiting.clear()
        self._held = np.array(forces)

    def means(self, start: float, rate: float, count: int) -> FloatArray:
        """Return the mean forces of each sample, and discard forces due before the end.

        Parameters
        ----------
        start : float
            Start of the first sample, s; equal to the end of the last sample of the previous call.
        rate : float
            Samples per second.
        count : int

        Returns
        -------
        ndarray, shape (count, coils)
            N.
        """
        means = np.full((count, len(self._held)), self._held)
        while self._waiting and self._waiting[0][0] < start + count / rate:
            due, forces = self._waiting.pop(0)
            force = np.array(forces)
            sample = max(0.0, (due - start) * rate)
            first = int(sample)
            # The new force acts for the rest of that sample.
            if first < count:
                means[first] += (force - self._held) * (first + 1 - sample)
            means[first + 1 :] = force
            self._held = force
        return means
