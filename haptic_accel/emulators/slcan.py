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

"""Adapter's side of slcan, a CAN bus as text lines on a serial port.

The commands are those of the Lawicel CAN232 manual, which slcan adapters support. The other end is
python-can's interface `slcan` or Linux' slcand.
"""

from __future__ import annotations

import re

from haptic_accel.devices.can.protocol import Frame

END, OK, ERROR = b"\r", b"\r", b"\a"

LONGEST_LINE = 26
"""Maximum length of a line: T, an extended id of 8, a length and 8 bytes of data."""

ANSWERS = {b"V": b"V1013" + END, b"N": b"NHAPT" + END, b"F": b"F00" + END}
"""Answers to queries, by first letter."""

ACCEPTED = b"OLCSsZMmWXTR"
"""First letters of other commands; frames with extended ids are accepted and ignored."""

FRAME = re.compile(rb"([tr])([0-7][0-9a-fA-F]{2})([0-8])((?:[0-9a-fA-F]{2})*)")
"""Line of a frame: data or request, id, length and data."""


def frame_line(frame: Frame) -> bytes:
    """Return a frame in an adapter's format, with its end."""
    if frame.remote:
        return b"r%03X0\r" % frame.id
    return b"t%03X%d%b\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


def parse_frame_line(line: bytes) -> Frame | None:
    """Read a frame with a standard id from a line without its end; None if it has none."""
    match = FRAME.fullmatch(line)
    if not match:
        return None
    kind, identifier, length, data = match.groups()
    remote = kind == b"r"
    if len(data) != (0 if remote else 2 * int(length)):
        return None
    return Frame(int(identifier, 16), bytes.fromhex(data.decode()), remote)


class SlcanAdapter:
    """Adapter that executes the commands of a host.

    Attributes
    ----------
    opened : bool
        True while the host receives frames.
    """

    def __init__(self) -> None:
        self.opened = False
        self._rest = b""

    def receive(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Process bytes from the host.

        Returns
        -------
        frames : list of Frame
            Frames for the bus.
        answer : bytes
            Answer to the host.
        """
        *lines, rest = (self._rest + data).split(END)
        # Discard a long line without an end.
        self._rest = rest if len(rest) <= LONGEST_LINE else b""
        frames, answers = [], []
        for line in lines:
            frame = parse_frame_line(line)
            if frame is not None and self.opened:
                frames.append(frame)
                answers.append(OK)
                continue
            if line[:1] in (b"O", b"L", b"C"):
                self.opened = line[:1] != b"C"
            accepted = OK if line[:1] in ACCEPTED else ERROR
            answers.append(ANSWERS.get(line[:1], accepted))
        return frames, b"".join(answers)
