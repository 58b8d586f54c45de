# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sound card as the complete bench: accelerometers on inputs, coils on outputs.

Inputs and outputs are one stream with one clock, whose time is converted to the machine's clock.
Each tick gets the acceleration at its time after a first-order low-pass, which is that of the
identified plant's sensor. Forces are output at their due time on the same clock. The delay from an
output through coil, handle and sensor to an input is measured at the start, as no driver reports
it reliably.
"""

from __future__ import annotations

import math
import time as clocks
from typing import Any

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes, read_numbers
from haptic_accel.core.model import ZERO, FloatArray, Force, Vector
from haptic_accel.core.parameters import ParameterError
from haptic_accel.devices import audio, interface
from haptic_accel.devices.interface import Device, DeviceError

MOST_HEARD = 0.25
"""Maximum response of the tool's accelerometer to a probing force or noise, relative to the
handle's: a sensor that picks up the handle sustains the force."""

NO_ARM = "none"
"""Name of the device without an arm."""

OFFSET_SHARE, DRIFT_SHARE = 0.25, 0.01
"""Shares of the card clock's error by which its offset and its rate are corrected after
`READINGS`."""

STEP, FAR = 0.4e-3, 5e-3
"""Errors of the card's clock, s, that indicate lost samples: of the shortest of `READINGS` (a
third of a block of 64 samples), and of a single reading, if there are no others."""

KEPT = 1.0
"""Time for which the card's samples are kept, s."""

AC_FLOOR = 0.3
"""Remaining corner frequency of a compensated AC coupling, Hz."""

WAITED = 0.05
"""Time for which filtered samples are kept, s: longer than a tick waits for its sample."""

LEAST_OVERSAMPLING = 4
"""Smallest ratio of the card's rate to the loop's: samples are interpolated linearly."""

LOST = 0.1
"""Time without a block after which the card counts as unplugged, s."""

SOFT, SOUNDED = 0.02, 0.4
"""Amplitude of the noise that measures the round trip, relative to full scale (0.1 N for a coil of
5 N), and duration, s."""

EMPTYING = 10
"""Number of blocks after which a card has played the initial silence: PortAudio fills its buffer
of four blocks."""

LONGEST_TRIP = 0.1
"""Longest round trip in the search, s."""

SPARED = 1
"""Number of samples subtracted from the measured round trip, so that the remaining delay of the
plant is not negative."""

LEAST_CORRELATION = 0.1
"""Minimum correlation of the noise and the response."""

JACK_CHANNELS = 2
"""Maximum number of channels on JACK; PortAudio 19.6 overruns its memory with more.
"""


class CardClock:
    """Estimate of the times of a card's samples on the machine's clock, from delayed readings.

    Parameters
    ----------
    rate : float
        Nominal samples per second.

    Attributes
    ----------
    drift : float
        Relative deviation of the card's period.
    jumps : int
        Number of times that samples were lost.

    Examples
    --------
    >>> clock = CardClock(48000.0)
    >>> clock.observe(480, 100.0)
    >>> clock.time(960)
    100.01
    """

    def __init__(self, rate: float) -> None:
        self._period = 1 / rate
        self._index, self._origin = 0, math.nan
        self.drift = 0.0
        self.jumps = 0
        self._errors: list[float] = []

    def time(self, index: float) -> float:
        """Return the time at which a sample was or will be received, s."""
        return self._origin + (index - self._index) * self._period * (1 + self.drift)

    def index(self, time: float) -> float:
        """Return the fractional index of the sample that is received at a time in s."""
        return self._index + (time - self._origin) / (self._period * (1 + self.drift))

    def observe(self, count: int, now: float) -> None:
        """Update the estimate by the number of samples received up to now, s."""
        error = now - self.time(count)
        if not abs(error) < FAR:
            self.jumps += not math.isnan(error)
            self._index, self._origin = count, now
            self._errors.clear()
            return
        self._errors.append(error)
        if len(self._errors) < audio.READINGS or count == self._index:
            return
        error = min(self._errors)
        self._errors.clear()
        origin, span = self.time(count), (count - self._index) * self._period
        is_step = abs(error) > STEP
        self.jumps += is_step
        self._index, self._origin = count, origin + (1.0 if is_step else OFFSET_SHARE) * error
        self.drift += 0.0 if is_step else DRIFT_SHARE * error / span


class DuplexCard:
    """Running stream of a sound card with all inputs and outputs, shared by both devices.

    Parameters
    ----------
    library : module
        The library `sounddevice`.
    index : int
        Number of the device.
    block : int
    rate : float
        Samples per second.

    Attributes
    ----------
    inputs, outputs : int
        Number of channels.
    received : int
        Samples received so far.
    clock : CardClock
    overruns : int
        Number of times that samples were lost before they were read.
    users : int
        Number of devices that use the card.
    is_played : bool
        True if a device supplies the output; otherwise silence is written, as a card may also stop
        its inputs after an underrun.
    tools : list of CardAccelerometer
        Open accelerometers of the tool.
    """

    def __init__(self, library: Any, index: int, block: int, rate: float) -> None:
        self._library = library
        found = library.query_devices(index)
        self.name, self.rate, self.index = found["name"], rate, index
        self.inputs, self.outputs = found["max_input_channels"], found["max_output_channels"]
        host = library.query_hostapis(found["hostapi"])["name"]
        if host == audio.JACK:
            self.inputs = min(self.inputs, JACK_CHANNELS)
            self.outputs = min(self.outputs, JACK_CHANNELS)
        least = JACK_CHANNELS if host == audio.JACK else 1
        if self.outputs < least:
            raise ValueError(f"{self.name} has {self.outputs} outputs, must have at least {least}")
        self.stream = audio.started_stream(
            library, index, (self.inputs, self.outputs), block, rate
        )
        self.clock = CardClock(rate)
        self.received = self.overruns = self.users = 0
        self.is_played = False
        self.tools: list[CardAccelerometer] = []
        self._sounded: tuple[FloatArray, FloatArray, float] | None = None
        self._silence = np.zeros((block, self.outputs), dtype=np.float32)
        self._most = round(KEPT * rate)
        self._buffer = np.zeros((2 * self._most, self.inputs), dtype=np.float32)
        self._filled = 0
        self._newest = math.nan
        self._lag = 0  # samples played minus received, at the end of a block

    def receive(self, now: float) -> None:
        """Read the samples that have arrived by now, s.

        Raises
        ------
        DeviceError
            The card has delivered no samples for `LOST`, or for `FIRST_BLOCK` after its start.
        """
        with audio.refusals(self._library, f"sound card {self.name}"):
            count = self.stream.read_available
            if count:
                data, lost = self.stream.read(count)
                self.overruns += bool(lost)
                self._keep(data[-self._most :])
                self.received += count
                self._newest = now
            if not self.is_played and self.stream.write_available >= len(self._silence):
                self.stream.write(self._silence)
        if math.isnan(self._newest):
            self._newest = now  # the start
        silent = now - self._newest
        if silent > (LOST if self.received else audio.FIRST_BLOCK):
            raise DeviceError(
                f"sound card {self.name}: nothing for {1e3 * silent:.0f} ms; is it unplugged?"
            )
        self.clock.observe(self.received, now)

    def window(self, first: int, count: int) -> FloatArray | None:
        """Return samples from an index on, shape (count, inputs); None if no longer stored."""
        begin = first - (self.received - self._filled)
        return self._buffer[begin : begin + count] if begin >= 0 else None

    def _keep(self, data: FloatArray) -> None:
        """Append samples; once the buffer is full, its second half becomes the first."""
        if self._filled + len(data) > len(self._buffer):
            rest = self._buffer[self._filled - self._most : self._filled].copy()
            self._buffer[: self._most], self._filled = rest, self._most
        self._buffer[self._filled : self._filled + len(data)] = data
        self._filled += len(data)

    def played(self, written: int, size: int) -> int:
        """Return the number of samples fetched by the card, minus samples received by then.

        Parameters
        ----------
        written : int
            Samples written so far.
        size : int
            Capacity of the output buffer, samples.
        """
        before = self.stream.read_available
        filled = size - self.stream.write_available
        if self.stream.read_available == before and filled > 0:
            self._lag = written - filled - self.received - before
        return self._lag

    def take_answer(self, noise: FloatArray, answer: FloatArray, heard: float) -> None:
        """Store the response of all inputs, and of the handle, m/s^2, to noise; check the tool.

        Raises
        ------
        DeviceError
            The tool's accelerometer measures the handle's vibration.
        """
        self._sounded = noise, answer, heard
        self.check_tools()

    def check_tools(self) -> None:
        """Refuse a tool accelerometer that responds to the coil, once noise was played."""
        if self._sounded is None:
            return
        noise, answer, heard = self._sounded
        for tool in self.tools:
            correlation, _, strength = alike(noise, tool.accelerations(answer))
            if correlation >= LEAST_CORRELATION and strength > MOST_HEARD * heard:
                raise DeviceError(
                    f"audio.inputs: the tool's accelerometer answers the coil with"
                    f" {strength / heard:.0%} of the handle's motion (must be at most"
                    f" {MOST_HEARD:.0%}); is it on the tool, and is the cable in the right input?"
                )

    def close(self) -> None:
        """Silence and stop the stream."""
        audio.end_stream(self._library, self.stream)


_CARDS: dict[int, DuplexCard] = {}
"""Running cards of this process by index; the devices of both arms share a card."""


def _acquired(library: Any, name: str, block: int, rate: float) -> DuplexCard:
    """Return a running card by its name.

    Raises
    ------
    DeviceError
        There is no such card, it has no inputs and outputs, or it cannot be opened.
    """
    with audio.refusals(library, f"audio.device = {name!r}"):
        found = library.query_devices(name or None, "input")
        card = _CARDS.get(found["index"])
        if card is None:
            rate = rate or found["default_samplerate"]
            card = _CARDS[found["index"]] = DuplexCard(library, found["index"], block, rate)
    card.users += 1
    return card


def _release(card: DuplexCard) -> None:
    card.users -= 1
    if not card.users:
        del _CARDS[card.index]
        card.close()


class BenchOutput(audio.SoundCard):
    """Outputs of a card with the handle's accelerometer on its inputs.

    Parameters
    ----------
    parameters, period, coils
        See `SoundCard`.
    sensor : CardAccelerometer
        Open accelerometer of the handle.
    """

    is_exact = True

    def __init__(
        self,
        parameters: audio.AudioParameters,
        period: float,
        coils: int,
        sensor: CardAccelerometer,
    ) -> None:
        super().__init__(parameters, period, coils)
        self._sensor = sensor
        self._written = self._trip = 0

    def open(self) -> None:
        """Start the card, and measure its round trip with soft noise.

        Raises
        ------
        ParameterError
            The card has no such channel.
        DeviceError
            The card cannot be opened, or the handle's accelerometer does not respond to the coil.
        """
        assert self._sensor.card
        self._duplex = card = self._sensor.card
        self.name, self.rate, self.channels = card.name, card.rate, card.outputs
        self._check_channels(card.outputs)
        self._stream, card.is_played = card.stream, True
        self.block = self._parameters.block
        self._fill(self._free(), self._stream.latency[1])
        self._size = self._empty_size()
        self.input_delay = self._sensor.input_delay
        self._trip = self._round_trip()
        self.lead += self._trip / self.rate

    def sounds(self, now: float) -> float | None:
        """Return the time at which the next sample's response is measured, s; None while empty."""
        lag = self._duplex.played(self._written, self._size)
        if self._free() >= self._size:
            return None
        return self._duplex.clock.time(self._written - lag + self._trip)

    def write(self, samples: FloatArray) -> bool:
        """Write samples relative to full scale, shape (n, coils); return True on an underrun."""
        self._written += len(samples)
        return super().write(samples)

    def close(self) -> None:
        """Silence the card at once, or once the last device has closed it."""
        if self._stream is not None:
            self._stream, self._duplex.is_played = None, False

    def _empty_size(self) -> int:
        """Return the capacity of the output buffer, samples, after the initial silence."""
        size = 0
        for _ in range(EMPTYING):
            clocks.sleep(self.block / self.rate)
            size = max(size, self._free())
        return size

    def _round_trip(self) -> int:
        """Return the delay from output to response of the handle's accelerometer, samples."""
        noise = np.random.default_rng(0).uniform(-SOFT, SOFT, round(SOUNDED * self.rate))
        sound = np.repeat(noise[:, np.newaxis], len(self._own), axis=1)
        most = round(LONGEST_TRIP * self.rate)
        begin, end = self._written, math.inf
        latest = self._duplex.received + len(noise) + most + audio.FIRST_BLOCK * self.rate
        while self._duplex.received < end:
            if self._duplex.received > latest:
                raise DeviceError(f"sound card {self.name}: plays nothing of what it is given")
            if room := min(self.room, begin + len(noise) - self._written):
                done = self._written - begin
                self.write(sound[done : done + room])
            self._duplex.receive(clocks.monotonic())
            lag = self._duplex.played(self._written, self._size)
            if self._written == begin + len(noise):
                end = self._written - lag + most
            clocks.sleep(self.block / self.rate / 4)
        answer = self._duplex.window(begin - lag, len(noise) + most)
        if answer is None:
            raise DeviceError(f"sound card {self.name}: too slow to measure its round trip")
        trip, heard = likest(noise, self._sensor.accelerations(answer))
        self._duplex.take_answer(noise, answer, heard)
        return max(0, trip - SPARED)


def likest(noise: FloatArray, answer: FloatArray) -> tuple[int, float]:
    """Return delay, samples, and strength of the response with the highest correlation.

    Parameters
    ----------
    noise, answer
        See `alike`.

    Raises
    ------
    DeviceError
        The correlation is below `LEAST_CORRELATION` in all channels.
    """
    correlation, delay, strength = alike(noise, answer)
    if correlation < LEAST_CORRELATION:
        raise DeviceError(
            f"audio.inputs: the handle's accelerometer does not answer the coil (correlation"
            f" {correlation:.2f}, must be at least {LEAST_CORRELATION:g}); are amplifier and"
            " sensor on, and audio.inputs and audio.channels right?"
        )
    return delay, strength


def alike(noise: FloatArray, answer: FloatArray) -> tuple[float, int, float]:
    """Return highest correlation of a response with noise, its delay, samples, and strength.

    Parameters
    ----------
    noise : ndarray, shape (n,)
    answer : ndarray, shape (m, channels)
        Response of all channels; longer than the noise.
    """
    from scipy import signal

    size = float(np.linalg.norm(noise))
    likest = 0.0, 0, 0.0
    for each in answer.T - answer.mean(axis=0)[:, np.newaxis]:
        found = np.abs(signal.correlate(each, noise, "valid", "fft"))
        best = int(found.argmax())
        part = each[best : best + len(noise)]
        correlation = float(found[best] / (size * np.linalg.norm(part) + 1e-12))
        likest = max(likest, (correlation, best, float(found[best]) / size**2))
    return likest


class CardAccelerometer(interface.CompositeDevice):
    """Accelerometer of handle or tool on a sound card, in place of the device's own.

    Parameters
    ----------
    parameters : InputParameters
    rate : float
        Ticks per second.
    device : Device
        Arm.
    to_base_axes : bool
        True to rotate the acceleration to the axes of the arm's base, as for a tool.
    """

    Parameters = audio.InputParameters

    def __init__(
        self, parameters: audio.InputParameters, rate: float, device: Device, to_base_axes: bool
    ) -> None:
        channels = audio.read_channels("audio.inputs", parameters.inputs)
        if len(channels) not in (1, len(ALL_AXES.names)):
            raise ParameterError(
                f"audio.inputs = {parameters.inputs!r}: must be one channel, or three for x, y, z"
            )
        if not parameters.scales:
            raise ParameterError(
                "audio.scales = '': must be the acceleration at full scale of each input;"
                " `haptic-accel calibrate audio` finds it"
            )
        self.axes: Axes = ALL_AXES if len(channels) > 1 else ACTUATOR_AXES
        self._channels = [channel - 1 for channel in channels]
        self._scales = np.array(read_numbers("audio.scales", parameters.scales, len(channels)))
        self._parameters, self._rate = parameters, rate
        self._device, self.parts = device, (device,)
        self._to_base = to_base_axes
        self.card: DuplexCard | None = None
        self._wrong = 0
        self.input_delay = math.nan

    def _open_own(self) -> None:
        """Open the card.

        Raises
        ------
        ParameterError
            The card has no such channel, or its rate is too low.
        DeviceError
            The card fails to open, or the tool's accelerometer measures the handle's vibration.
        """
        # Imported here, as scipy.signal is slow to import, and most nodes have no card.
        from scipy.signal import sosfilt

        self._sosfilt = sosfilt
        p = self._parameters
        name = p.card_name if isinstance(p, audio.AudioParameters) else p.device
        rate = p.assumed.rate if isinstance(p, audio.AudioParameters) else 0.0
        self.card = card = _acquired(audio.sound_library(), name, p.block, rate)
        if max(self._channels) >= card.inputs:
            raise ParameterError(
                f"audio.inputs = {p.inputs!r}: must be at most {card.inputs}, as the sound card"
                f" {card.name} has no more"
            )
        if self._rate > (highest := card.rate / LEAST_OVERSAMPLING):
            raise ParameterError(
                f"rate = {self._rate:g}: must be at most {highest:g} Hz with the sound card"
                f" {card.name} at {card.rate:g} Hz"
            )
        self.input_delay = (p.block + 1) / card.rate
        self._sections = _sensor_filter(p.bandwidth, p.ac_corner, card.rate)
        self._state = np.zeros((len(self._sections), 2, len(self._channels)))
        self._known = card.received
        self._filtered = np.zeros((0, len(self._channels)))
        if self._to_base:
            card.tools.append(self)
            card.check_tools()

    def accelerations(self, samples: FloatArray) -> FloatArray:
        """Convert the card's inputs to the accelerometer's acceleration, m/s^2."""
        return np.asarray(bounded(samples[:, self._channels])[0] * self._scales)

    def read(self, time: float) -> interface.Reading:
        """Return the arm's motion, and the acceleration at a time in s."""
        measured = self._accelerated(time)
        if measured is interface.LATER:
            return interface.LATER
        moved = self._device.read(time)  # some devices return each sample only once
        if moved is interface.LATER:
            return interface.LATER
        if moved is None or measured is None:
            return None
        sample = moved._replace(acceleration=measured.acceleration)
        return interface.in_base_axes(sample) if self._to_base else sample

    def _accelerated(self, time: float) -> interface.Reading:
        """Return a sample with only the acceleration at a time in s."""
        card = self.card
        if card is None:
            return None
        now = clocks.monotonic()
        if card.clock.index(now) < card.clock.index(time) + 1:
            return interface.LATER  # no sample yet at its tick; due forces should not wait
        card.receive(now)
        position = card.clock.index(time)
        if not position + 1 < card.received:
            return interface.LATER
        self._filter(card)
        whole = math.floor(position)
        begin = whole - (self._known - len(self._filtered))
        if begin < 0:
            return None
        before, after = self._filtered[begin : begin + 2]
        values = (before + (position - whole) * (after - before)) * self._scales
        vector: Vector = self.axes.vector(values.tolist())
        return interface.Sample(ZERO, ZERO, vector)

    def _filter(self, card: DuplexCard) -> None:
        """Filter the samples that have arrived since the last call."""
        new = card.window(self._known, card.received - self._known)
        if new is not None and len(new):  # none are stored if the loop stood still
            raw, wrong = bounded(new[:, self._channels])
            self._wrong += wrong
            filtered, self._state = self._sosfilt(self._sections, raw, axis=0, zi=self._state)
            kept = round(WAITED * card.rate)
            self._filtered = np.concatenate((self._filtered, filtered))[-kept:]
        self._known = card.received

    def _close_own(self) -> None:
        """Close the card once the last device has closed it."""
        card, self.card = self.card, None
        if card is not None:
            card.tools = [each for each in card.tools if each is not self]
            _release(card)

    @property
    def remark(self) -> str:
        """Remark of the device, with card and inputs."""
        card = self.card
        own = (
            f"accelerometer on the sound card {card.name}, input {self._parameters.inputs}, read"
            f" {1e3 * self.input_delay:.1f} ms after the sample"
            if card
            else ""
        )
        return "; ".join(filter(None, (super().remark, own)))

    @property
    def problem(self) -> str:
        """Problem of the device, and warning about impossible samples so far."""
        own = f"audio.inputs: {self._wrong} samples not finite or beyond full scale, limited to it"
        return "; ".join(filter(None, (super().problem, own if self._wrong else "")))

    @property
    def interruptions(self) -> int:
        """Number of interruptions of the device, losses of samples, and clock steps."""
        card = self.card
        own = card.overruns + card.clock.jumps if card else 0
        return super().interruptions + own

    def counters(self) -> dict[str, int]:
        """Return the counts of the device, wrong inputs, and the drift of the card's clock."""
        card = self.card
        if card is None:
            return self._device.counters()
        return {
            **self._device.counters(),
            "audio_wrong": self._wrong,
            "audio_overruns": card.overruns,
            "audio_jumps": card.clock.jumps,
            "audio_drift_ppm": round(1e6 * card.clock.drift),
        }


def bounded(samples: FloatArray) -> tuple[FloatArray, int]:
    """Limit samples to full scale; return them and the number of limited samples.

    A non-finite sample would remain in a recursive filter forever.

    Examples
    --------
    >>> bounded(np.array([0.5, np.nan, -np.inf, 1e30]))
    (array([ 0.5,  0. , -1. ,  1. ]), 3)
    """
    wrong = int(np.count_nonzero(~(np.abs(samples) <= 1.0)))
    return np.clip(np.nan_to_num(samples, nan=0.0), -1.0, 1.0), wrong


def _sensor_filter(bandwidth: float, ac_corner: float, rate: float) -> FloatArray:
    """Return a first-order low-pass, combined with the inverse of a first-order AC coupling.

    Parameters
    ----------
    bandwidth, ac_corner : float
        Corner frequencies, Hz; `ac_corner` is 0 without AC coupling.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (1, 6)
        Second-order section.
    """
    left, coupled, settled = (
        math.exp(-2 * math.pi * corner / rate) for corner in (bandwidth, ac_corner, AC_FLOOR)
    )
    if ac_corner <= AC_FLOOR:
        return np.array([[1 - left, 0.0, 0.0, 1.0, -left, 0.0]])
    gain, poles = 1 - left, np.convolve([1.0, -left], [1.0, -settled])
    return np.array([[gain, -gain * coupled, 0.0, *poles]])


class NoArm(Device):
    """Placeholder without an arm, for a handle or tool in a hand: no position, no force.

    Parameters
    ----------
    parameters : NoParameters
    rate : float
    seed : int
    """

    def __init__(self, parameters: interface.NoParameters, rate: float, seed: int) -> None: ...

    def open(self) -> None:
        """Do nothing."""

    def read(self, time: float) -> interface.Sample:
        """Return a sample at rest."""
        return interface.Sample(ZERO, ZERO, ZERO)

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Ignore the forces."""

    def close(self) -> None:
        """Do nothing."""
