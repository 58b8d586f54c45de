# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A sound card as the whole bench: accelerometers on its inputs, coils on its outputs.

Both directions are one stream, so that the card has one clock. It is followed by the machine's:
each tick has the acceleration at its time, behind a low-pass of order one, which is that of the
identified plant's sensor. Forces sound at their due time by the same clock. The way from an output
through coil, handle and sensor to an input is measured at the start, as no driver states it
reliably.
"""

from __future__ import annotations

import math
import time as clocks
from typing import Any

import numpy as np

from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, Axes, read_numbers
from haptic_accel.core.model import ZERO, FloatArray, Vector
from haptic_accel.core.orientation import is_turned, to_base
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.signal_checks import MOST_HEARD
from haptic_accel.devices import audio
from haptic_accel.devices.interface import (
    LATER,
    CompositeDevice,
    Device,
    DeviceError,
    NoParameters,
    Reading,
    Sample,
)

NO_ARM = "none"
"""Name of the arm that is not there."""

OFFSET_SHARE, DRIFT_SHARE = 0.25, 0.01
"""Shares of the card clock's error by which its offset and its rate are corrected after
`READINGS`."""

STEP, FAR = 0.4e-3, 5e-3
"""Errors of the card's clock, s, from which on samples were lost: the shortest of `READINGS`, a
third of a block of 64 samples, and a single one, at which nothing else is known."""

KEPT = 1.0
"""Time for which the card's samples are kept, s."""

AC_FLOOR = 0.3
"""Corner that remains of an AC coupling which is undone, Hz."""

WAITED = 0.05
"""Time for which filtered samples are kept, s: longer than a tick waits for its sample."""

LEAST_OVERSAMPLING = 4
"""Smallest ratio of the card's rate to the loop's: samples are interpolated linearly."""

LOST = 0.1
"""Time without a block after which the card counts as unplugged, s."""

SOFT, SOUNDED = 0.02, 0.4
"""Amplitude of the noise that measures the round trip, relative to full scale, and its length, s:
0.1 N for a coil of 5 N."""

EMPTYING = 10
"""Blocks after which a card has played the silence that it was started with: PortAudio fills its
buffer of four."""

LONGEST_TRIP = 0.1
"""Longest round trip that is looked for, s."""

SPARED = 1
"""Samples by which the round trip is taken shorter than found, so that what remains for the
plant's delay is not negative."""

LEAST_LIKENESS = 0.1
"""Smallest correlation of that noise and its answer."""

JACK_CHANNELS = 2
"""Number of outputs, and largest of inputs, with which PortAudio 19.6 keeps to its memory on JACK.
"""


class CardClock:
    """Time of a card's samples by the machine's clock, from the shortest of late readings.

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
        """Return the sample, with its fraction, that is received at a time in s."""
        return self._index + (time - self._origin) / (self._period * (1 + self.drift))

    def observe(self, count: int, now: float) -> None:
        """Take into account that a number of samples has been received by now, s."""
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
    """Running stream of a sound card with all its inputs and outputs, for both devices.

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
        Devices that use it.
    is_played : bool
        True if a device supplies the output; otherwise it gets silence, as a card whose output ran
        dry may stop its inputs, too.
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
        self._lag = 0  # samples played less those received, both at the end of a block

    def receive(self, now: float) -> None:
        """Read what has come by now, s.

        Raises
        ------
        DeviceError
            The card has given nothing for `LOST`, or for `FIRST_BLOCK` since its start.
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

    def around(self, first: int, count: int) -> FloatArray | None:
        """Return samples from an index on, shape (count, inputs); None if they are gone."""
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
        """Return how many of the written samples have been fetched, less those received by then.

        Parameters
        ----------
        written : int
            Samples written so far.
        size : int
            Samples that the output holds.
        """
        before = self.stream.read_available
        filled = size - self.stream.write_available
        if self.stream.read_available == before and filled > 0:
            self._lag = written - filled - self.received - before
        return self._lag

    def take_answer(self, noise: FloatArray, answer: FloatArray, heard: float) -> None:
        """Keep all inputs' answer to a noise, and the handle's, m/s^2; check the tool's.

        Raises
        ------
        DeviceError
            The tool's accelerometer hears the handle.
        """
        self._sounded = noise, answer, heard
        self.check_tools()

    def check_tools(self) -> None:
        """Refuse an accelerometer of the tool that answers the coil, once it has sounded."""
        if self._sounded is None:
            return
        noise, answer, heard = self._sounded
        for tool in self.tools:
            likeness, _, strength = alike(noise, tool.accelerations(answer))
            if likeness >= LEAST_LIKENESS and strength > MOST_HEARD * heard:
                raise DeviceError(
                    f"audio.inputs: the tool's accelerometer answers the coil with"
                    f" {strength / heard:.0%} of the handle's motion (must be at most"
                    f" {MOST_HEARD:.0%}); is it on the tool, and is the cable in the right input?"
                )

    def close(self) -> None:
        """Stop, silent."""
        audio.end_stream(self._library, self.stream)


_CARDS: dict[int, DuplexCard] = {}
"""Cards that run in this process, by their number: both arms' devices share one."""


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
    """Outputs of a card whose inputs have the handle's accelerometer.

    Parameters
    ----------
    parameters, period, coils
        As for `SoundCard`.
    sensor : CardAccelerometer
        The handle's, open.
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
            It cannot be opened, or the handle's accelerometer does not answer the coil.
        """
        assert self._sensor.card
        self._duplex = card = self._sensor.card
        self.name, self.rate, self.channels = card.name, card.rate, card.outputs
        self._check_channels(card.outputs)
        self._stream, card.is_played = card.stream, True
        self.block = self._parameters.block
        self._fill(self._free(), self._stream.latency[1])
        self._size = self._empty_size()
        self.hearing = self._sensor.hearing
        self._trip = self._round_trip()
        self.lead += self._trip / self.rate

    def sounds(self, now: float) -> float | None:
        """Return the time at which the next written sample is measured, s; None while empty."""
        lag = self._duplex.played(self._written, self._size)
        if self._free() >= self._size:
            return None
        return self._duplex.clock.time(self._written - lag + self._trip)

    def write(self, samples: FloatArray) -> bool:
        """Write samples, shape (n, coils), full scale 1; return whether the card underran."""
        self._written += len(samples)
        return super().write(samples)

    def close(self) -> None:
        """Silence the card at once, or once the last device has closed it."""
        if self._stream is not None:
            self._stream, self._duplex.is_played = None, False

    def _empty_size(self) -> int:
        """Return the samples that the output holds, once what it was started with is played."""
        size = 0
        for _ in range(EMPTYING):
            clocks.sleep(self.block / self.rate)
            size = max(size, self._free())
        return size

    def _round_trip(self) -> int:
        """Return the samples from an output to the answer of the handle's accelerometer."""
        noise = np.random.default_rng(0).uniform(-SOFT, SOFT, round(SOUNDED * self.rate))
        given = np.repeat(noise[:, np.newaxis], len(self._own), axis=1)
        most = round(LONGEST_TRIP * self.rate)
        begin, end = self._written, math.inf
        latest = self._duplex.received + len(noise) + most + audio.FIRST_BLOCK * self.rate
        while self._duplex.received < end:
            if self._duplex.received > latest:
                raise DeviceError(f"sound card {self.name}: plays nothing of what it is given")
            if room := min(self.room, begin + len(noise) - self._written):
                done = self._written - begin
                self.write(given[done : done + room])
            self._duplex.receive(clocks.monotonic())
            lag = self._duplex.played(self._written, self._size)
            if self._written == begin + len(noise):
                end = self._written - lag + most
            clocks.sleep(self.block / self.rate / 4)
        answer = self._duplex.around(begin - lag, len(noise) + most)
        if answer is None:
            raise DeviceError(f"sound card {self.name}: too slow to measure its round trip")
        trip, heard = likest(noise, self._sensor.accelerations(answer))
        self._duplex.take_answer(noise, answer, heard)
        return max(0, trip - SPARED)


def likest(noise: FloatArray, answer: FloatArray) -> tuple[int, float]:
    """Return the delay, samples, and the strength of the answer that is most like a noise.

    Parameters
    ----------
    noise, answer
        As for `alike`.

    Raises
    ------
    DeviceError
        None is like it.
    """
    likeness, delay, strength = alike(noise, answer)
    if likeness < LEAST_LIKENESS:
        raise DeviceError(
            f"audio.inputs: the handle's accelerometer does not answer the coil (correlation"
            f" {likeness:.2f}, must be at least {LEAST_LIKENESS:g}); are amplifier and sensor on,"
            " and audio.inputs and audio.channels right?"
        )
    return delay, strength


def alike(noise: FloatArray, answer: FloatArray) -> tuple[float, int, float]:
    """Return correlation, delay in samples, and strength of the answer most like a noise.

    Parameters
    ----------
    noise : ndarray, shape (n,)
    answer : ndarray, shape (m, channels)
        Longer than the noise.
    """
    from scipy import signal

    size = float(np.linalg.norm(noise))
    likest = 0.0, 0, 0.0
    for each in answer.T - answer.mean(axis=0)[:, np.newaxis]:
        found = np.abs(signal.correlate(each, noise, "valid", "fft"))
        best = int(found.argmax())
        part = each[best : best + len(noise)]
        likeness = float(found[best] / (size * np.linalg.norm(part) + 1e-12))
        likest = max(likest, (likeness, best, float(found[best]) / size**2))
    return likest


class CardAccelerometer(CompositeDevice):
    """Accelerometer of handle or tool on a sound card, in place of the device's own.

    Parameters
    ----------
    parameters : InputParameters
    rate : float
        Ticks per second.
    device : Device
        Arm.
    to_base_axes : bool
        Turn the acceleration to the axes of the arm's base, as for a tool.
    """

    Parameters = audio.InputParameters

    def __init__(
        self,
        parameters: audio.InputParameters,
        rate: float,
        device: Device,
        to_base_axes: bool,
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
        self.hearing = math.nan

    def _open_own(self) -> None:
        """Open the card.

        Raises
        ------
        ParameterError
            The card has no such channel, or its rate is too low.
        DeviceError
            The card fails to open, or the tool's accelerometer hears the handle.
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
        self.hearing = (p.block + 1) / card.rate
        self._sections = _sensor_filter(p.bandwidth, p.ac_corner, card.rate)
        self._state = np.zeros((len(self._sections), 2, len(self._channels)))
        self._known = card.received
        self._filtered = np.zeros((0, len(self._channels)))
        if self._to_base:
            card.tools.append(self)
            card.check_tools()

    def accelerations(self, samples: FloatArray) -> FloatArray:
        """Return the accelerometer's columns of the card's inputs, m/s^2."""
        return np.asarray(bounded(samples[:, self._channels])[0] * self._scales)

    def read(self, time: float) -> Reading:
        """Return the arm's motion, and the acceleration at a time in s."""
        felt = self._felt(time)
        if felt is LATER:
            return LATER
        moved = self._device.read(time)  # once, as some devices give each sample once
        if moved is LATER:
            return LATER
        if moved is None or felt is None:
            return None
        acceleration = felt.acceleration
        if self._to_base and is_turned(moved.orientation, acceleration):
            acceleration = to_base(moved.orientation, acceleration)
        return moved._replace(acceleration=acceleration)

    def _felt(self, time: float) -> Reading:
        """Return a sample with the acceleration at a time in s, and nothing else."""
        card = self.card
        if card is None:
            return None
        now = clocks.monotonic()
        if card.clock.index(now) < card.clock.index(time) + 1:
            return LATER  # at its tick no sample is there, and forces that are due should not wait
        card.receive(now)
        position = card.clock.index(time)
        if not position + 1 < card.received:
            return LATER
        self._filter(card)
        whole = math.floor(position)
        begin = whole - (self._known - len(self._filtered))
        if begin < 0:
            return None
        before, after = self._filtered[begin : begin + 2]
        values = (before + (position - whole) * (after - before)) * self._scales
        vector: Vector = self.axes.vector(values.tolist())
        return Sample(ZERO, ZERO, vector)

    def _filter(self, card: DuplexCard) -> None:
        """Filter what has come since the last time."""
        new = card.around(self._known, card.received - self._known)
        if new is None:  # the loop stood still
            new = card.around(card.received, 0)
            assert new is not None
        if len(new):
            raw, wrong = bounded(new[:, self._channels])
            self._wrong += wrong
            filtered, self._state = self._sosfilt(self._sections, raw, axis=0, zi=self._state)
            self._filtered = np.concatenate((self._filtered, filtered))[
                -round(WAITED * card.rate) :
            ]
        self._known = card.received

    def _close_own(self) -> None:
        """Close the card once the last device has closed it."""
        card, self.card = self.card, None
        if card is not None:
            card.tools = [each for each in card.tools if each is not self]
            _release(card)

    @property
    def remark(self) -> str:
        """Remark of the device; card and inputs."""
        card = self.card
        own = (
            f"accelerometer on the sound card {card.name}, input {self._parameters.inputs}, read"
            f" {1e3 * self.hearing:.1f} ms after the sample"
            if card
            else ""
        )
        return "; ".join(filter(None, (super().remark, own)))

    @property
    def problem(self) -> str:
        """Problem of the device, and samples so far that cannot be."""
        own = f"audio.inputs: {self._wrong} samples not finite or beyond full scale, limited to it"
        return "; ".join(filter(None, (super().problem, own if self._wrong else "")))

    @property
    def interruptions(self) -> int:
        """Number of interruptions of the device, of lost samples, and of steps of the clock."""
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
    """Return samples within full scale, and the number of those that were not.

    A recursive filter keeps a sample that is not finite for ever.

    Examples
    --------
    >>> bounded(np.array([0.5, np.nan, -np.inf, 1e30]))
    (array([ 0.5,  0. , -1. ,  1. ]), 3)
    """
    wrong = int(np.count_nonzero(~(np.abs(samples) <= 1.0)))
    return np.clip(np.nan_to_num(samples, nan=0.0), -1.0, 1.0), wrong


def _sensor_filter(bandwidth: float, ac_corner: float, rate: float) -> FloatArray:
    """Return a low-pass of order one, after what undoes an AC coupling of order one.

    Parameters
    ----------
    bandwidth, ac_corner : float
        Corners, Hz; the second is 0 without a coupling.
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
    """Arm that is not there: handle or tool in a hand, without position and force.

    Parameters
    ----------
    parameters : NoParameters
    rate : float
    seed : int
    """

    def __init__(self, parameters: NoParameters, rate: float, seed: int) -> None: ...

    def open(self) -> None:
        """Do nothing."""

    def read(self, time: float) -> Sample:
        """Return a sample at rest."""
        return Sample(ZERO, ZERO, ZERO)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        """Ignore the forces."""

    def close(self) -> None:
        """Do nothing."""
