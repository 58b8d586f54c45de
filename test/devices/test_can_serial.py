from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError, from_flat, schema
from haptic_accel.devices import MASTERS, SLAVES


@pytest.mark.parametrize("devices", [MASTERS, SLAVES])
def test_parameters_are_those_of_both_parts(devices: dict) -> None:
    names = set(schema(devices["can_serial"].Parameters))
    arm = set(schema(devices["can"].Parameters, "arm."))
    handle = set(schema(devices["serial"].Parameters, "handle."))
    assert names == arm | handle


@pytest.mark.parametrize("devices", [MASTERS, SLAVES])
def test_a_part_that_is_not_there_is_named_and_both_are_closed(devices: dict) -> None:
    kind = devices["can_serial"]
    parameters = from_flat(
        kind.Parameters,
        {
            "arm.interface": "virtual",
            "arm.channel": "nobody",
            "arm.start_timeout": 0.1,
            "handle.port": "/dev/none",
        },
    )
    device = kind(parameters, 1000.0, 0)
    with pytest.raises((RuntimeError, ParameterError), match="can: virtual nobody: no heartbeat"):
        device.open()
    device.close()
