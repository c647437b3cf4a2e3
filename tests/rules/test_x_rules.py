"""What follows for the gateway (X-xx), shown by its own commands on simulated starters."""

from __future__ import annotations

import pytest

from gateway.families.command.procedures import build
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.sim.factory import make_unit
from tests.rules.acting import Actor
from tests.sim.wire import Talk

STARTS = {  # as they are written: tests/scenarios/commands/test_verbs.py
    "ssw06": "06 13 8B 01 01",
    "ssw07": "05 00 64 FF 00",
    "ssw900": "06 02 AD 00 13",
    "sst": "05 00 00 FF 00",
}


@pytest.mark.parametrize("other", STARTS)
@pytest.mark.parametrize("family", STARTS)
def test_x_01_a_start_of_one_family_starts_no_other_but_that_of_an_ssw07_an_ssw06(
    family: str, other: str
) -> None:
    talk = Talk(make_unit(other, 1))
    talk.unit.handle(bytes.fromhex(STARTS[family]), 0.0)
    talk.wait(1.0)

    assert bool(talk.unit.starts) is (other == family or (family, other) == ("ssw07", "ssw06"))


COMMANDS = {  # what a starter takes for commands
    "ssw06": ["VB03", "VB07", "HR5003", "HR5007", *(f"COIL{coil}" for coil in range(100, 108))],
    "ssw07": ["VB03", "HR5003", *(f"COIL{coil}" for coil in range(100, 108))],
    "ssw900": ["S5.2.5", "S5.2.6", "HR685", "HR686", *(f"HR{word}" for word in range(1600, 1620))],
    "sst": [f"COIL{number}" for number in range(1, 5)],
}
PROTECTED = {  # address, rate and format, which would cut the line off; loading of factory settings
    "ssw06": ["P308", "P312"],
    "ssw07": ["P308", "P312"],
    "ssw900": ["C8.2.2", "C8.2.3", "C8.2.4"],
}
FORBIDDEN = [
    (family, code, refusal)
    for refusal, rows in (("not_writable", COMMANDS), ("would_cut_connection", PROTECTED))
    for family, codes in rows.items()
    for code in codes
]


@pytest.mark.parametrize(("family", "code", "refusal"), FORBIDDEN)
def test_x_05_set_writes_no_command_and_does_not_cut_the_line_off(
    family: str, code: str, refusal: str
) -> None:
    done = Actor(family).act("set", {"parameter": code, "value": 1})

    assert (done.end, done.written) == (refusal, [])


def test_x_06_no_silence_is_expected_after_a_start() -> None:
    steps = build(load_profile("ssw06"), Variant(), "start", {}, seen={}).steps

    assert [step.is_silence_expected for step in steps] == [False]
