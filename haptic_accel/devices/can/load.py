# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Load of a CAN bus by the frames of an arm."""

from __future__ import annotations

from dataclasses import dataclass

FRAME_BITS = 47
"""Bits of a frame with a standard id and no data: start, id, control, CRC, acknowledgement, end,
and the three bits between frames (ISO 11898-1)."""

STUFFED_BITS = 34
"""Bits from start to CRC, where a bit is stuffed after five equal bits."""

FULL_LOAD = 0.8
"""Largest load with a margin, as frames are repeated after errors, and wait for others. A rule of
thumb (assumed)."""

HEARTBEAT_RATE = 10.0
"""Default rate of ODrive's heartbeats, Hz."""

ESTIMATES_BYTES, TORQUE_BYTES, HEARTBEAT_BYTES = 8, 4, 8


def frame_bits(data_bytes: int) -> int:
    """Return a standard-id frame's maximum bits, including stuff bits.

    In the worst case the first stuff bit follows five bits, and each other follows four, as stuff
    bits count too (Davis et al., Real-Time Systems 35, 2007).

    Parameters
    ----------
    data_bytes : int
        0 to 8; 0 in a request for data.
    """
    stuffed = (STUFFED_BITS + 8 * data_bytes - 1) // 4
    return FRAME_BITS + 8 * data_bytes + stuffed


HEARTBEATS = HEARTBEAT_RATE * frame_bits(HEARTBEAT_BYTES)
"""Bits per second of a joint's heartbeats."""


@dataclass(frozen=True)
class BusLoad:
    """Largest load of a bus by an arm's frames.

    Attributes
    ----------
    joints : int
    rate : float
        Rate of estimates and of torques, Hz.
    bitrate : float
        Bit rate of the bus, bit/s.
    requested : bool
        True if every estimate is requested.
    """

    joints: int
    rate: float
    bitrate: float
    requested: bool = False

    @property
    def cycle(self) -> int:
        """Bits of a joint's frames per sample, without its heartbeats."""
        request = frame_bits(0) if self.requested else 0
        return request + frame_bits(ESTIMATES_BYTES) + frame_bits(TORQUE_BYTES)

    @property
    def bits(self) -> float:
        """Bits per second."""
        return self.joints * (self.rate * self.cycle + HEARTBEATS)

    @property
    def share(self) -> float:
        """Load as a share of the bus; more than 1 is impossible."""
        return self.bits / self.bitrate

    @property
    def fits(self) -> bool:
        """True if there is room to spare."""
        return self.share <= FULL_LOAD

    @property
    def highest_rate(self) -> float:
        """Highest rate that fits, Hz."""
        return (FULL_LOAD * self.bitrate / self.joints - HEARTBEATS) / self.cycle

    def __str__(self) -> str:
        """Return the load in one line."""
        how = "requested" if self.requested else "streamed"
        joints = "1 joint" if self.joints == 1 else f"{self.joints} joints"
        line = (
            f"bus load up to {100 * self.share:.0f} % of {self.bitrate / 1e6:g} Mbit/s"
            f" ({joints} at {self.rate:g} Hz, estimates {how})"
        )
        if not self.fits:
            line += f": too much, up to {self.highest_rate:.0f} Hz would fit"
        return line
