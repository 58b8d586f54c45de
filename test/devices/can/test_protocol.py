# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""CANSimple as bytes."""

from __future__ import annotations

import math
import re
import struct
from dataclasses import astuple
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fuzzing import fuzz
from haptic_accel.devices.can.protocol import (
    ERRORS,
    HIGHEST_ID,
    HIGHEST_NODE,
    LARGEST_TORQUE,
    AxisState,
    BusLoad,
    ClearErrors,
    Command,
    EmergencyStop,
    Estimates,
    EstimatesRequest,
    Frame,
    Heartbeat,
    Message,
    SetMode,
    SetState,
    SetTorque,
    error_names,
    frame_bits,
    parse_order,
    parse_report,
    state_name,
)

nodes = st.integers(0, HIGHEST_NODE)
singles = st.floats(width=32, allow_nan=False, allow_infinity=False)
words = st.integers(0, 2**32 - 1)
ids = st.integers(0, HIGHEST_ID) | st.builds(
    lambda node, command: node << 5 | command, nodes, st.sampled_from(Command)
)
frames = st.builds(Frame, ids, st.binary(max_size=8), remote=st.booleans())


def test_bytes_are_those_of_the_firmware() -> None:
    # Written down by hand from can_simple.cpp: node << 5 | command, little-endian.
    assert SetState(1, AxisState.CLOSED_LOOP_CONTROL).frame() == (0x27, b"\x08\0\0\0", False)
    assert SetMode(3).frame() == (0x6B, b"\x01\0\0\0\x01\0\0\0", False)
    assert SetTorque(2, 1.0).frame() == (0x4E, b"\0\0\x80\x3f", False)
    assert Estimates(0, 1.0, -2.0).frame() == (0x09, b"\0\0\x80\x3f\0\0\0\xc0", False)
    assert Heartbeat(5, 0x800, 8).frame() == (0xA1, b"\0\x08\0\0\x08\0\0\0", False)
    assert EmergencyStop(0).frame() == (0x02, b"", False)
    assert ClearErrors(63).frame().id == 63 << 5 | 0x18
    assert EstimatesRequest(4).frame() == (0x89, b"", True)


measured = st.builds(Estimates, nodes, singles, singles)
reports = st.builds(Heartbeat, nodes, words, st.integers(0, 255)) | measured
orders = st.one_of(
    st.builds(SetTorque, nodes, st.floats(-LARGEST_TORQUE, LARGEST_TORQUE, width=32)),
    st.builds(SetState, nodes, st.sampled_from(AxisState)),
    *(st.builds(kind, nodes) for kind in (SetMode, EmergencyStop, ClearErrors, EstimatesRequest)),
)


@given(reports, orders)
def test_what_is_said_comes_back(report: Message, order: Message) -> None:
    assert parse_report(report.frame()) == report
    assert parse_order(order.frame()) == order


@fuzz
@given(frames)
def test_no_frame_is_too_strange(frame: Frame) -> None:
    for found in (parse_report(frame), parse_order(frame)):
        if found is not None:
            assert found.node == frame.id >> 5
            assert all(math.isfinite(value) for value in astuple(found))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_estimates_and_torques_that_are_no_numbers_are_none(bad: float) -> None:
    assert parse_report(Estimates(0, bad, 0.0).frame()) is None
    assert parse_report(Estimates(0, 0.0, bad).frame()) is None
    assert parse_order(Frame(Command.SET_INPUT_TORQUE, struct.pack("<f", bad))) is None


@pytest.mark.parametrize("torque", [math.nan, math.inf, 1e300, -2e4])
def test_a_torque_beyond_any_motor_is_refused(torque: float) -> None:
    with pytest.raises(ValueError, match="torque = "):
        SetTorque(0, torque).frame()


@pytest.mark.parametrize("node", [-1, 64])
def test_a_node_that_cannot_be_is_refused(node: int) -> None:
    with pytest.raises(ValueError, match="node = "):
        EmergencyStop(node).frame()


@pytest.mark.parametrize("firmware", ERRORS)
def test_errors_are_named(firmware: str) -> None:
    assert error_names(0, firmware) == ""
    both = sum(list(ERRORS[firmware])[:2])
    assert error_names(both, firmware) == ", ".join(list(ERRORS[firmware].values())[:2])
    assert error_names(0x80000000, firmware) == "unknown error 0x80000000"


@given(words, st.sampled_from(list(ERRORS)), st.integers(0, 255))
def test_every_error_and_state_has_a_name(error: int, firmware: str, state: int) -> None:
    assert bool(error_names(error, firmware)) == bool(error)
    assert state_name(state)


@pytest.mark.parametrize(("data_bytes", "bits"), [(0, 55), (1, 65), (4, 95), (8, 135)])
def test_worst_case_of_a_frame(data_bytes: int, bits: int) -> None:
    # Davis, Burns, Bril and Lukkien 2007: 55 + 10 s bits for s bytes and 11-bit ids.
    assert frame_bits(data_bytes) == bits


@pytest.mark.parametrize("requested", [False, True])
@pytest.mark.parametrize("joints", [1, 3, 6])
def test_what_would_fit_just_fits(joints: int, requested: bool) -> None:
    highest = BusLoad(joints, 5000.0, 1e6, requested).highest_rate
    assert BusLoad(joints, highest * 0.999, 1e6, requested).fits
    assert not BusLoad(joints, highest * 1.001, 1e6, requested).fits


def test_what_does_not_fit_is_said() -> None:
    assert str(BusLoad(6, 1000.0, 1e6)).endswith(": too much, up to 574 Hz would fit")


DOCUMENT = Path(__file__).parents[3] / "haptic_accel" / "devices" / "can" / "README.md"


def test_the_documented_table_is_what_is_computed() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d) joints?(.*?) \| (.*%.*) \| (\d+) Hz \|$", text, re.MULTILINE)
    assert len(rows) == 6
    for joints, how, shares, highest in rows:
        requested = "requested" in how
        for rate, shown in zip((250.0, 500.0, 1e3, 2e3), shares.split(" | "), strict=True):
            load = BusLoad(int(joints), rate, 1e6, requested)
            figure = f"{100 * load.share:.0f} %"
            assert shown == (figure if load.fits else f"**{figure}**")
        assert f"{BusLoad(int(joints), 1e3, 1e6, requested).highest_rate:.0f}" == highest
