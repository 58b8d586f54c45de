# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import fuzz
from haptic_accel.core.axes import ALL_AXES, NAMES, Axes
from haptic_accel.core.topics import ARMS
from haptic_accel.kits.link.endpoint import (
    LARGEST_SAMPLE,
    MOST_SAMPLES,
    VERSION,
    Packet,
    unpack,
)

WORD = st.integers(-(2**63), 2**63 - 1)
SESSION = st.integers(1, 2**64 - 1)
COUNT = st.integers(0, 2**32 - 1)
REAL = st.floats(-1e300, 1e300)
VECTOR = st.tuples(REAL, REAL, REAL)
COMPONENT = st.floats(-LARGEST_SAMPLE, LARGEST_SAMPLE, width=32)
AXES = st.sets(st.sampled_from(NAMES), min_size=1).map(lambda names: Axes(tuple(sorted(names))))


@st.composite
def packets(draw: st.DrawFn) -> Packet:
    """Return a packet whose samples have the components of its axes."""
    axes = draw(AXES)
    count = len(axes.names) * draw(st.integers(0, MOST_SAMPLES))
    samples = draw(st.lists(COMPONENT, min_size=count, max_size=count).map(tuple))
    return draw(WITHOUT_SAMPLES)._replace(samples=samples, axes=axes)


WITHOUT_SAMPLES = st.builds(
    Packet,
    *(st.sampled_from(ARMS), SESSION, WORD, WORD),
    *(st.integers(0, 2**64 - 1), WORD, WORD, WORD),
    *(st.booleans(), st.booleans(), st.booleans(), st.booleans(), COUNT, COUNT),
    *(WORD, VECTOR, VECTOR, REAL, st.floats(1.0, 1e5), WORD),
    *(st.just(()), st.just(ALL_AXES)),
)

PACKETS = packets()


def example(**values: object) -> Packet:
    zero = (0.0, 0.0, 0.0)
    packet = Packet(
        *("slave", 7, 1, 0, 0, 0, 0, 0, True, False, False, False, 0, 0, 0),
        *(zero, zero, 0.0, 1e3, 0, (1.0,)),
    )
    return packet._replace(**values)  # type: ignore[arg-type]


@given(PACKETS)
def test_a_packet_survives_its_way(packet: Packet) -> None:
    assert unpack(packet.pack()) == packet


def test_the_largest_packet_fits_into_what_networks_carry_unfragmented() -> None:
    samples = (0.0,) * 3 * MOST_SAMPLES
    assert len(example(samples=samples, axes=ALL_AXES).pack()) < 1100


def test_an_axis_that_the_tool_lacks_costs_no_byte() -> None:
    one = len(example(samples=(0.0,) * MOST_SAMPLES).pack())
    three = len(example(samples=(0.0,) * 3 * MOST_SAMPLES, axes=ALL_AXES).pack())
    assert (one, three) == (220, 348)


@fuzz
@given(PACKETS, st.data())
def test_damage_is_refused_in_one_line(packet: Packet, data: st.DataObject) -> None:
    sent = packet.pack()
    damaged = bytearray(sent)
    for _ in range(data.draw(st.integers(1, 4))):
        damaged[data.draw(st.integers(0, len(sent) - 1))] ^= data.draw(st.integers(1, 255))
    for wrong in (
        *(each for each in [bytes(damaged)] if each != sent),
        sent[: data.draw(st.integers(0, len(sent) - 1))],
        sent + data.draw(st.binary(min_size=1, max_size=9)),
    ):
        with pytest.raises(ValueError, match=r"^[^\n]+$"):
            unpack(wrong)


@fuzz
@given(st.binary(max_size=300))
def test_whatever_else_arrives_is_no_packet(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"^not a packet"):
        unpack(data)


@pytest.mark.parametrize(("version", "length"), [(2, None), (4, 9)])
def test_another_version_is_named_whatever_follows_it(version: int, length: int | None) -> None:
    data = bytearray(example().pack()[:length])
    data[4] = version
    message = f"^the peer's packets have version {version}: must be 3; install the same"
    with pytest.raises(ValueError, match=message):
        unpack(bytes(data))


@pytest.mark.parametrize(
    "values",
    [
        {"position": (0.0, math.nan, 0.0)},
        {"velocity": (math.inf, 0.0, 0.0)},
        {"shipped": math.nan},
        {"samples": (math.nan,)},
        {"samples": (1e8,)},
        {"samples": (0.0, math.nan, 0.0), "axes": ALL_AXES},
        {"rate": 0.0},
        {"session": 0},
        {"samples": (0.0,) * (MOST_SAMPLES + 1)},
    ],
)
def test_values_that_no_host_sends_are_refused(values: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="damaged"):
        unpack(example(**values).pack())


def test_the_version_follows_the_name() -> None:
    assert struct.unpack_from("<4sB", example().pack()) == (b"hapt", VERSION)


def test_a_packet_without_axes_is_refused() -> None:
    data = bytearray(example().pack())
    data[6] &= 0x0F
    with pytest.raises(ValueError, match="damaged"):
        unpack(bytes(data))
