"""Stamps and vectors of many serialised messages at once.

PoseStamped, TwistStamped, WrenchStamped and AccelStamped all are a header followed by doubles, of
which the first three are what the graph is about. `nodes.wire` has the same layout for one
message.
Format: OMG DDS-RTPS 2.5, section 10.2 (CDR); times and doubles are aligned to their size.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from haptic_accel.core.sampling import NANOSECONDS

IntArray = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float64]


_BYTE_ORDERS = {1: "<", 0: ">"}  # second byte of plain CDR's encapsulation
_ORIGIN = 4  # alignment counts from behind the encapsulation
_HEADER_BYTES = 12  # stamp, and length of the frame's name
_VECTOR_BYTES = 24


def stamped_vectors(
    block: ByteArray, starts: IntArray, ends: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return stamps and vectors of messages that lie in a block of bytes.

    Parameters
    ----------
    block : ndarray of uint8
    starts, ends : ndarray of int64, shape (n,)
        Where each message lies in it.

    Returns
    -------
    stamps : ndarray of int64, shape (n,)
        ns.
    values : ndarray of float, shape (n, 3)

    Raises
    ------
    ValueError
        A message is not a header and three doubles in plain CDR.
    """
    stamps = np.empty(len(starts), dtype=np.int64)
    values = np.empty((len(starts), 3))
    if not len(starts):
        return stamps, values
    if (ends - starts < _ORIGIN + _HEADER_BYTES).any():
        raise ValueError("a message is too short")
    order = block[starts + 1]
    for code, mark in _BYTE_ORDERS.items():
        chosen = np.flatnonzero(order == code)
        if not chosen.size:
            continue
        header = _gathered(block, starts[chosen] + _ORIGIN, _HEADER_BYTES)
        words = header.view(f"{mark}u4").astype(np.int64)
        seconds = header.view(f"{mark}i4")[:, 0].astype(np.int64)
        stamps[chosen] = seconds * NANOSECONDS + words[:, 1]
        places = starts[chosen] + _ORIGIN + (_HEADER_BYTES + words[:, 2] + 7 & ~7)
        if (places + _VECTOR_BYTES > ends[chosen]).any():
            raise ValueError("a message is too short")
        values[chosen] = _gathered(block, places, _VECTOR_BYTES).view(f"{mark}f8")
    if not np.isin(order, list(_BYTE_ORDERS)).all():
        raise ValueError("a message is not plain CDR")
    return stamps, values


def _gathered(block: ByteArray, places: IntArray, size: int) -> ByteArray:
    """Return so many bytes from each of some places, shape (n, size)."""
    gathered: ByteArray = block[places[:, None] + np.arange(size)]
    return gathered
