"""What follows from a starter's configuration, and from what it says of itself."""

from __future__ import annotations

import pytest

from gateway.families import Identity, Variant, load_profile
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteCoil, WriteRegisters
from gateway.starters.setup import StarterSetup, merged


def setup(response_time_s: float | None = None) -> StarterSetup:
    profile = load_profile("ssw07")
    timing = LineTiming(19200, Framing.parse("8E1"))
    return StarterSetup("pump-1", "pumps", 7, profile, Variant(), timing, response_time_s=response_time_s)


@pytest.mark.parametrize(
    ("request_", "configured_s", "expected_s"),
    [
        (ReadHoldingRegisters(0, 1), None, 0.020),
        (ReadHoldingRegisters(0, 1), 0.2, 0.2),
        (WriteCoil(100, True), None, 0.020),
        (WriteCoil(100, True), 0.2, 0.2),
        (WriteRegisters(0, (1, 2, 3)), None, 0.060),
        (WriteRegisters(0, (1, 2, 3)), 0.2, 0.2),
    ],
)
def test_a_request_is_given_the_time_of_the_manual_or_of_the_configuration(
    request_: Request, configured_s: float | None, expected_s: float
) -> None:
    assert setup(configured_s).response_time_of(request_) == pytest.approx(expected_s)


@pytest.mark.parametrize(
    ("configured", "after"),
    [
        (Variant(slot=2), Variant(model="SSW-06 85.0A", firmware="1.60", rated_current_a=85.0, slot=1)),
        (
            Variant(model="SSW-06 820A", firmware="1.50", rated_current_a=820.0, slot=2),
            Variant(model="SSW-06 820A", firmware="1.50", rated_current_a=820.0, slot=1),
        ),
    ],
)
def test_the_configuration_wins_but_of_the_slot(configured: Variant, after: Variant) -> None:
    identity = Identity(model="SSW-06 85.0A", firmware="1.60", rated_current_a=85.0, slot=1)

    assert merged(configured, identity) == after
