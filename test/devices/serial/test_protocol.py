# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bytes to frames and back, whatever the wire does."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzzing import fuzz, mutated
from haptic_accel.devices.serial.protocol import (
    DELIMITER,
    FULL_SCALE,
    LONGEST_PAYLOAD,
    MESSAGES,
    ONE_COIL,
    SEQUENCES,
    VERSION,
    VERSIONS,
    Align,
    ArmRequest,
    Configuration,
    Configure,
    Decoder,
    DisarmRequest,
    Encoder,
    Error,
    ErrorCode,
    Frame,
    FrameType,
    Identify,
    Identity,
    Message,
    PayloadError,
    Samples,
    ScheduleCurrent,
    SetCurrent,
    State,
    Status,
    encode,
    most_samples,
    read_message,
)

few = settings(max_examples=40)  # `benchmarks/serial_protocol.py` takes a million

byte = st.integers(0, 255)
word = st.integers(0, SEQUENCES - 1)
count = st.integers(0, 2**32 - 1)
counts16 = st.integers(-FULL_SCALE - 1, FULL_SCALE)
coils = st.lists(counts16, max_size=3).map(tuple)
single = st.floats(2**-20, 2**20, width=32)

frames = st.builds(Frame, byte, byte, word, count, st.binary(max_size=LONGEST_PAYLOAD))


@st.composite
def samples(draw: st.DrawFn) -> Samples:
    axes = draw(st.integers(1, 7))
    width = axes.bit_count()
    number = draw(st.integers(1, most_samples(axes)))
    values = draw(st.lists(counts16, min_size=number * width, max_size=number * width))
    return Samples(draw(count), axes, tuple(values))


currents = st.tuples(*[st.just(0.0) | single] * 3)
serial_numbers = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=16)

messages: st.SearchStrategy[Message] = st.one_of(
    st.builds(Identify),
    st.builds(ArmRequest),
    st.builds(DisarmRequest),
    st.builds(SetCurrent, coils),
    st.builds(ScheduleCurrent, coils, count),
    st.builds(Align, count, count),
    st.builds(Configure, word, byte, byte),
    st.builds(Configuration, word, byte, byte),
    st.builds(Identity, st.tuples(byte, byte, byte), byte, word, single, currents, serial_numbers),
    samples(),
    st.builds(Status, st.sampled_from(State), coils, *[count] * 8),
    st.builds(Error, st.sampled_from(ErrorCode), byte, word),
)


def test_a_frame_is_as_documented() -> None:
    # README.md of the driver shows these bytes.
    set_point = ScheduleCurrent((1, -2, 3), 0x01020304)
    wire = encode(Frame(VERSION, FrameType.SCHEDULE_CURRENT, 7, 1_000_000, set_point.pack()))
    assert wire.hex(" ") == "04 03 06 07 04 40 42 0f 02 01 04 fe ff 03 07 04 03 02 01 ea 95 00"


def test_a_board_of_an_older_version_is_spoken_to_as_before() -> None:
    """Frames for one coil differ from those of version 2 in the version alone."""
    encoder = Encoder()
    encoder.version = ONE_COIL
    wire = encoder.encode(ScheduleCurrent((-2,), 0x01020304), 1_000_000)
    assert wire.hex(" ") == "03 02 06 01 04 40 42 0f 09 fe ff 04 03 02 01 f7 4c 00"
    told = struct.pack("<BBBBHff16s", 2, 0, 0, 0b111, 1000, 49.0, 2.75, b"old")
    identity = Identity((2, 0, 0), 0b111, 1000, 49.0, (0.0, 0.0, 2.75), "old")
    assert read_message(Frame(ONE_COIL, FrameType.IDENTITY, 0, 0, told)) == identity
    assert identity.coils == ("z",)


@few
@given(messages, count)
def test_a_message_comes_back(message: Message, clock: int) -> None:
    (frame,) = Decoder().feed(Encoder().encode(message, clock))
    assert frame.clock == clock
    assert read_message(frame) == message


@few
@given(st.lists(frames, max_size=5), st.lists(st.integers(1, 300), min_size=1))
def test_it_does_not_matter_in_which_pieces_bytes_come(
    sent: Sequence[Frame], cuts: Sequence[int]
) -> None:
    wire = b"".join(map(encode, sent))
    decoder, found = Decoder(), []
    for cut in [*cuts, len(wire)]:
        found += decoder.feed(wire[:cut])
        wire = wire[cut:]
    assert found == list(sent)
    assert decoder.damaged == 0


sent_frames = st.builds(
    lambda message, sequence: encode(Frame(VERSION, message.TYPE, sequence, 0, message.pack())),
    messages,
    word,
)


@few
@given(st.lists(messages, min_size=1, max_size=6), st.data())
def test_a_damaged_byte_loses_its_frame_and_no_other(
    sent: Sequence[Message], data: st.DataObject
) -> None:
    encoder, decoder = Encoder(), Decoder()
    wires = [encoder.encode(message, 0) for message in sent]
    place = data.draw(st.integers(0, len(sent) - 1))
    damaged = bytearray(wires[place])
    damaged[data.draw(st.integers(0, len(damaged) - 2))] ^= data.draw(st.integers(1, 255))
    wires[place] = bytes(damaged)
    found = decoder.feed(b"".join(wires))
    assert list(map(read_message, found)) == [*sent[:place], *sent[place + 1 :]]
    assert decoder.lost == (0 < place < len(sent) - 1)


@fuzz
@given(mutated(st.lists(sent_frames, max_size=4).map(b"".join), st.binary(max_size=300)), frames)
def test_any_damage_is_borne(wire: bytes, last: Frame) -> None:
    decoder = Decoder()
    found = [*decoder.feed(wire + DELIMITER), *decoder.feed(encode(last))]
    assert found[-1] == last
    assert decoder.received == len(found)
    for frame in found:
        try:
            read_message(frame)
        except PayloadError as error:
            assert str(error).isprintable()


@fuzz
@given(st.sampled_from([VERSION, ONE_COIL, 1]), st.sampled_from(FrameType) | byte, st.data())
def test_any_payload_means_something_or_is_refused(
    version: int, kind: int, data: st.DataObject
) -> None:
    layout = MESSAGES[kind].size(data.draw(st.integers(0, 4))) if kind in MESSAGES else 0
    right = st.binary(min_size=layout, max_size=layout)
    payload = data.draw(right | st.binary(max_size=LONGEST_PAYLOAD))
    frame = Frame(version, kind, 0, 0, payload)
    try:
        message = read_message(frame)
    except PayloadError:
        return
    assert version in VERSIONS
    assert kind == message.TYPE
    # What says the same in other bytes is no identity: its text may be padded anyhow.
    assert kind == FrameType.IDENTITY or message.pack() == payload
    assert not isinstance(message, Identity) or message.serial_number.isprintable()


@pytest.mark.parametrize("number", ["a\nb", "\x1b[2J", "a\0b"])
def test_a_serial_number_that_cannot_be_printed_is_refused(number: str) -> None:
    identity = Identity((2, 0, 0), 1, 1000, 49.0, (0.0, 0.0, 0.0), number)
    with pytest.raises(PayloadError, match="serial number"):
        read_message(Frame(VERSION, FrameType.IDENTITY, 0, 0, identity.pack()))


LOST = [([0, 1, 2], 0), ([5, 8], 2), ([65_535, 0], 0), ([65_534, 1], 2), ([700, 0], 0), ([3], 0)]


@pytest.mark.parametrize(("sequences", "lost"), LOST)
def test_missing_frames_are_counted(sequences: Sequence[int], lost: int) -> None:
    decoder = Decoder()
    for sequence in sequences:
        decoder.feed(encode(Frame(VERSION, FrameType.IDENTIFY, sequence, 0, b"")))
    assert decoder.lost == lost
    assert decoder.received == len(sequences)


def test_damage_is_counted_and_nothing_between_delimiters_is_none() -> None:
    decoder = Decoder()
    decoder.feed(DELIMITER * 3 + b"noise" + DELIMITER)
    assert decoder.damaged == 1


def test_another_sender_may_begin_anywhere() -> None:
    decoder = Decoder()
    decoder.feed(encode(Frame(VERSION, FrameType.IDENTIFY, 10, 0, b""))[:-3])
    decoder.restart()
    assert decoder.feed(encode(Frame(VERSION, FrameType.IDENTIFY, 500, 0, b"")))
    assert (decoder.lost, decoder.damaged) == (0, 0)


def test_sequence_numbers_and_clock_begin_anew() -> None:
    encoder, decoder = Encoder(), Decoder()
    for index in range(SEQUENCES + 2):
        (frame,) = decoder.feed(encoder.encode(Identify(), 2**32 + index))
    assert (frame.sequence, frame.clock) == (1, SEQUENCES + 1)
    assert decoder.lost == 0
