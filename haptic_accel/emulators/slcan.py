"""Adapter's side of slcan, a CAN bus as lines of text on a serial port.

The commands are those of the Lawicel CAN232 manual, which adapters with slcan understand; the
other end is python-can's interface `slcan` or Linux' slcand.
"""

from __future__ import annotations

from haptic_accel.devices.can.protocol import HIGHEST_ID, Frame

END, OK, ERROR = b"\r", b"\r", b"\a"

LONGEST_LINE = 26
"""Most characters of a line: T, an extended id of 8, a length and 8 bytes of data."""

ANSWERS = {
    **dict.fromkeys([b"", b"O", b"L", b"C", b"S", b"s", b"Z", b"M", b"m", b"W", b"X"], OK),
    # Frames with extended ids are accepted and ignored.
    **dict.fromkeys([b"T", b"R"], OK),
    b"V": b"V1013" + END,
    b"N": b"NHAPT" + END,
    b"F": b"F00" + END,
}
"""Answer to a command other than a frame, by its first letter."""

_ID_CHARACTERS = 3


def frame_line(frame: Frame) -> bytes:
    """Return a frame as an adapter sends it, with its end."""
    if frame.remote:
        return b"r%03X0\r" % frame.id
    return b"t%03X%d%b\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


def parse_frame_line(line: bytes) -> Frame | None:
    """Read a frame with a standard id from a line without its end; None if there is none."""
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
    """Adapter, which reads the commands of a host.

    Attributes
    ----------
    opened : bool
        True while the host wants frames.
    """

    def __init__(self) -> None:
        self.opened = False
        self._rest = b""

    def take(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Process bytes from the host.

        Returns
        -------
        frames : list of Frame
            Frames for the bus.
        answer : bytes
            Answer to the host.
        """
        *lines, rest = (self._rest + data).split(END)
        # A line without an end is not kept for ever.
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
            answers.append(ANSWERS.get(line[:1], ERROR))
        return frames, b"".join(answers)
