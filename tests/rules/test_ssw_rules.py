"""Rules of the SSW-06 (S6-xx) and the SSW900 (S9-xx) that do not follow from their simulators alone."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import load_profile
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

SERIAL = [(baud, framing) for baud in (9600, 19200, 38400) for framing in ("8N2", "8O1", "8E1")]


@pytest.mark.parametrize(("number", "setting"), list(enumerate(SERIAL, 1)))
def test_s6_24_p312_decides_rate_and_byte_format(number: int, setting: tuple[int, str]) -> None:
    unit = make_unit("ssw06", 1, settings={312: number})
    timings = {each: LineTiming(each[0], Framing.parse(each[1])) for each in SERIAL}

    unit.join(timings[setting])

    assert Talk(unit).ask(ReadHoldingRegisters(312, 1)) == (number,)
    assert [each for each, timing in timings.items() if unit.listens_to(timing)] == [setting]


def test_s9_10_the_property_stopped_is_known_for_the_communication_menu_only() -> None:
    rows = load_profile("ssw900").parameters.values()

    known = {row.code.split(".")[0] for row in rows if row.is_stopped_only is not None}

    assert known == {"C8"}


def test_s9_09_the_mapping_is_set_at_standstill_except_the_update_delay() -> None:
    rows = load_profile("ssw900").parameters

    mapping = {code for code in rows if code.startswith(("C8.1.1.", "C8.1.2."))}
    assert {code for code in mapping if rows[code].is_stopped_only} == mapping - {"C8.1.2.5"}
