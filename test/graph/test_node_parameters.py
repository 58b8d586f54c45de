from __future__ import annotations

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.node_parameters import NODES, node_parameters, node_schema

OLDER = {"safety.arm.max_age": 0.2, "safety.actuator.max_age": 0.2}


@pytest.mark.parametrize("executable", NODES)
def test_every_parameter_is_described_and_its_default_allowed(executable: str) -> None:
    schema = node_schema(executable)
    assert schema
    for name, (default, specification) in schema.items():
        assert specification.text, name
        if isinstance(default, float):
            assert specification.admits(default), name
        if specification.choices:
            assert default in specification.choices, name


def test_defaults_are_the_papers() -> None:
    coupler, _ = node_parameters("coupler", {})
    assert (coupler.k_m, coupler.k_sl) == (250.0, 250.0)
    compensator, controllers = node_parameters("compensator", {})
    assert compensator.rate == 1000.0
    assert compensator.high_pass_frequency == 15.0
    assert controllers["actuator"].peak_force == 6.6
    assert controllers["constant"].mass == 0.128
    _, masters = node_parameters("master_device", {})
    handle = masters["simulated"].handle
    table_i = (0.018, 266.0, 2.0, 0.128, 1500.0, 11.0)
    assert (handle.m_a, handle.k_s, handle.b_s, handle.m_h, handle.k_u, handle.b_u) == table_i


def test_values_reach_nested_parameters_by_dotted_name() -> None:
    _, masters = node_parameters("master_device", {"simulated.handle.m_h": 0.2})
    assert masters["simulated"].handle.m_h == 0.2


@pytest.mark.parametrize("device", ["master_device", "slave_device"])
def test_a_latency_at_which_every_force_is_outdated_is_refused(device: str) -> None:
    node_parameters(device, {"latency": 20, "rate": 250.0})
    with pytest.raises(ParameterError, match=r"^latency = 20: 0\.1 s at rate = 200 Hz, must be"):
        node_parameters(device, {"latency": 20, "rate": 200.0})
    node_parameters(device, {"latency": 20, "rate": 200.0} | OLDER)


def test_a_wrong_value_is_named_with_its_dots() -> None:
    with pytest.raises(ParameterError, match=r"^simulated\.handle\.m_h = -1: must be above 0 kg$"):
        node_parameters("master_device", {"simulated.handle.m_h": -1})
