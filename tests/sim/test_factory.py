"""Simulated starters by family: each starts through Modbus as it is made."""

from __future__ import annotations

import pytest

from gateway.modbus.pdu import Request
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

STARTS: list[tuple[str, Request]] = [
    ("ssw06", WriteRegister(5003, 0x0101)),
    ("ssw07", WriteCoil(100, is_on=True)),
    ("ssw900", WriteRegister(685, 0x0013)),
    ("sst", WriteCoil(0, is_on=True)),
]


@pytest.mark.parametrize(("family", "start"), STARTS)
def test_a_start_works_without_any_set_up(family: str, start: Request) -> None:
    unit = make_unit(family, 5, seed=1)
    talk = Talk(unit)

    talk.ask(start)
    talk.wait(20.0)

    assert unit.family == family
    assert unit.address == 5
    assert unit.motor.is_at_full_voltage
    assert unit.starts == [0.0]


@pytest.mark.parametrize(("family", "start"), STARTS)
def test_a_broken_request_gets_an_exception_and_never_harms(family: str, start: Request) -> None:
    unit = make_unit(family, 5)

    for function in range(256):
        for tail in (b"", b"\0", b"\xff\xff\xff\xff"):
            reply = unit.handle(bytes((function,)) + tail, 0.0)
            assert reply is not None
            assert reply[0] & 0x80

    assert not unit.starts
    assert unit.handle(b"", 0.0) == bytes((0x80, 1))


def test_an_unknown_family_or_model_is_refused() -> None:
    with pytest.raises(ValueError, match="ssw06, ssw07, ssw900, sst"):
        make_unit("abb", 1)
    with pytest.raises(ValueError, match="SST330i"):
        make_unit("sst", 1, model="SST999")


def test_a_unit_can_be_handled_without_a_clock() -> None:
    unit = make_unit("ssw07", 1)
    unit.trip(5)

    assert unit.trips[0].at_s == 0.0


@pytest.mark.parametrize(
    ("family", "model", "current_a"),
    [
        ("ssw07", "SSW-07 45.0A", 45.0),
        ("ssw07", "SSW-07", 85.0),
        ("ssw06", "SSW-06 820 A", 820.0),
        ("ssw06", "1100A", 1100.0),
        ("ssw900", "SSW900", 105.0),
        ("ssw900", "412", 412.0),
    ],
)
def test_the_rated_current_is_taken_from_the_model_where_it_says_one(
    family: str, model: str, current_a: float
) -> None:
    assert make_unit(family, 1, model=model).motor.data.rated_current_a == current_a
