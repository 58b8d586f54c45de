"""The adapter's end of slcan, a CAN bus as lines of text on a serial port, for emulation.

The commands are those of the Lawicel CAN232 manual, which adapters with slcan understand; the
other end is python-can's interface `slcan` or Linux' slcand.
"""

from __future__ import annotations

from haptic_accel.devices.can.protocol import HIGHEST_ID, Frame

END, OK, ERROR = b"\r", b"\r", b"\a"

LONGEST_LINE = 26
"""Characters: T, an extended id of 8, a length and 8 bytes of data."""

VERSION, SERIAL_NUMBER, NO_FLAGS = b"V1013", b"NHAPT", b"F00"
"""Answers to V, N and F."""

_ID_CHARACTERS = 3


def frame_line(frame: Frame) -> bytes:
    """Return a frame as an adapter sends it, with its end."""
    if frame.remote:
        return b"r%03X0\r" % frame.id
    return b"t%03X%d%b\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


def parse_frame_line(line: bytes) -> Frame | None:
    """Read a frame with a standard id from a line without its end; None if it is none."""
    head = 2 + _ID_CHARACTERS
    if line[:1] not in (b"t", b"r") or len(line) < head:
        return None
    try:
        identifier = int(line[1 : head - 1], 16)
        length = int(line[head - 1 : head])
        data = bytes.fromhex(line[head:].decode("ascii"))
    except ValueError:
        return None
    remote = line[:1] == b"r"
    if identifier > HIGHEST_ID or identifier < 0 or length > 8:
        return None
    if len(data) != (0 if remote else length):
        return None
    return Frame(identifier, data, remote)


class SlcanAdapter:
    """Reads what a computer writes to an adapter.

    Attributes
    ----------
    opened : bool
        Whether the computer wants frames.
    """

    def __init__(self) -> None:
        self.opened = False
        self._rest = b""

    def take(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Take bytes as they come.

        Returns
        -------
        frames : list of Frame
            To be put on the bus.
        answer : bytes
            For the computer.
        """
        *lines, rest = (self._rest + data).split(END)
        # What has no end is no line, and not kept for ever.
        self._rest = rest if len(rest) <= LONGEST_LINE else b""
        frames, answers = [], []
        for line in lines:
            frame = parse_frame_line(line)
            if frame is not None and self.opened:
                frames.append(frame)
            answers.append(OK if frame is not None and self.opened else self._obey(line))
        return frames, b"".join(answers)

    def _obey(self, line: bytes) -> bytes:
        command = line[:1]
        if command in (b"O", b"L"):
            self.opened = True
        elif command == b"C":
            self.opened = False
        elif command == b"V":
            return VERSION + END
        elif command == b"N":
            return SERIAL_NUMBER + END
        elif command == b"F":
            return NO_FLAGS + END
        elif command not in (b"", b"S", b"s", b"Z", b"M", b"m", b"W", b"X", b"T", b"R"):
            return ERROR
        # Frames with extended ids are nobody's here.
        return OK
