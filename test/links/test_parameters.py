from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.links.parameters import LinkNodeParameters, host_and_port


@pytest.mark.parametrize(
    ("peer", "expected"),
    [
        ("robot", ("robot", 0)),
        ("10.0.0.2:9000", ("10.0.0.2", 9000)),
        ("robot.lab:1", ("robot.lab", 1)),
        ("fd00::2", ("fd00::2", 0)),
        ("[fd00::2]:7447", ("fd00::2", 7447)),
    ],
)
def test_a_peer_is_a_host_with_or_without_a_port(peer: str, expected: tuple[str, int]) -> None:
    assert host_and_port(peer) == expected


@pytest.mark.parametrize(
    "peer", [":7", "robot:", "robot:0", "robot:65536", "a b", "robot:x", "a/b"]
)
def test_another_form_is_refused_in_one_line(peer: str) -> None:
    with pytest.raises(ParameterError, match=r"^peer = .*: must be HOST or HOST:PORT"):
        LinkNodeParameters(peer=peer)
