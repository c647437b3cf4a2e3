"""What follows for the gateway (X-xx), shown by its own commands on simulated starters."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.cli.scan.search import PROBE
from gateway.families.command.procedures import build, prepare, verbs
from gateway.families.diagnosis.identification import identify_requests
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.families.reading import plan_blocks
from gateway.modbus.pdu import Request
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming
from gateway.modbus.writes import WriteRegister, WriteRegisters
from gateway.sim.factory import make_unit
from gateway.starters import StarterSetup
from tests.rules.acting import Actor
from tests.sim.wire import Talk


@pytest.mark.parametrize(("family", "runs"), [("ssw06", False), ("ssw07", True)])
def test_x_01_the_same_word_runs_one_family_and_not_the_other(family: str, *, runs: bool) -> None:
    talk = Talk(make_unit(family, 1, settings={229: 2, 220: 0}))  # local mode, commanded by serial

    talk.ask(WriteRegister(5003, 0x0003))

    assert talk.unit.motor.is_turned_on is runs


@pytest.mark.parametrize("family", FAMILIES)
def test_x_01_a_start_of_any_family_starts_no_motor_of_another(family: str) -> None:
    (start,) = [request for request in start_requests(family) if request.is_write]
    for other in FAMILIES:
        talk = Talk(make_unit(other, 1))
        talk.pdu(start)
        talk.wait(1.0)
        if other != family and {family, other} != {"ssw06", "ssw07"}:
            assert not talk.unit.starts


def start_requests(family: str) -> list[Request]:
    actor = Actor(family)
    assert actor.act("start").end == "confirmed"
    return [decode_request(write.pdu) for write in actor.unit.writes]


@pytest.mark.parametrize("family", ["ssw07", "ssw900"])
def test_x_02_a_start_and_a_stop_leave_all_other_commands_as_they_are(family: str) -> None:
    actor = Actor(family)
    actor.act("direction", {"value": "reverse"})

    for verb in ("start", "stop"):
        assert actor.act(verb).end == "confirmed"
        actor.talk.wait(30.0)

        points = actor.points(actor.read(prepared_status(actor)))
        assert (points["general_enabled"], points["remote"], points["reverse"]) == (True, True, True)


def prepared_status(actor: Actor) -> Any:
    return prepare(actor.profile, actor.variant, "start", {}).reads


@pytest.mark.parametrize("family", FAMILIES)
def test_x_05_polls_only_read(family: str) -> None:
    blocks = plan_blocks(load_profile(family), Variant())

    assert blocks
    assert not any(block.request.is_write for block in blocks)


@pytest.mark.parametrize("family", FAMILIES)
def test_x_05_identification_and_scan_only_read(family: str) -> None:
    questions = [question.request for question in identify_requests(load_profile(family))]

    assert questions
    assert not any(request.is_write for request in (*questions, PROBE))


COMMANDS = {  # what a starter takes for commands: the X-05 of the list
    "ssw06": ["VB03", "VB07", "HR5003", "HR5007", *(f"COIL{coil}" for coil in range(100, 108))],
    "ssw07": ["VB03", "HR5003", *(f"COIL{coil}" for coil in range(100, 108))],
    "ssw900": ["S5.2.5", "S5.2.6", "HR685", "HR686", *(f"HR{word}" for word in range(1600, 1620))],
    "sst": [f"COIL{number}" for number in range(1, 5)],
}


@pytest.mark.parametrize(("family", "code"), [(f, code) for f, codes in COMMANDS.items() for code in codes])
def test_x_05_set_writes_no_command(family: str, code: str) -> None:
    done = Actor(family).act("set", {"parameter": code, "value": 1})

    assert (done.end, done.written) == ("not_writable", [])


PROTECTED = {  # address, rate and format, which would cut the line off; loading of factory settings
    "ssw06": ["P308", "P312"],
    "ssw07": ["P308", "P312"],
    "ssw900": ["C8.2.2", "C8.2.3", "C8.2.4"],
}


@pytest.mark.parametrize(("family", "code"), [(f, code) for f, codes in PROTECTED.items() for code in codes])
def test_x_05_set_does_not_cut_the_line_off(family: str, code: str) -> None:
    done = Actor(family).act("set", {"parameter": code, "value": 1})

    assert (done.end, done.written) == ("would_cut_connection", [])


@pytest.mark.parametrize(("verb", "args", "restarts"), [("reset", {}, True), ("start", {}, False)])
def test_x_06_the_silence_after_a_reset_of_an_ssw06_is_expected(
    verb: str, args: dict[str, Any], restarts: bool
) -> None:
    steps = build(load_profile("ssw06"), Variant(), verb, args, seen={}).steps

    assert steps[-1].is_silence_expected is restarts


@pytest.mark.parametrize("family", FAMILIES)
def test_x_08_no_verb_names_a_unit_and_none_is_a_broadcast(family: str) -> None:
    assert all(
        not set(command.args) & {"unit", "address"} for command in load_profile(family).commands.values()
    )
    assert not any("broadcast" in verb for verb in verbs(load_profile(family)))


def test_x_09_a_32_bit_value_is_read_with_its_two_registers_in_one_request() -> None:
    blocks = plan_blocks(load_profile("ssw900"), Variant())
    long_rows = [(block, row) for block in blocks for row in block.rows if row.words == 2]

    assert len(long_rows) >= 3
    for block, row in long_rows:
        count = int.from_bytes(block.request.encode()[3:5], "big")
        assert block.address <= row.address
        assert row.address + 2 <= block.address + count


@pytest.mark.parametrize("baud", [19200, 38400, 57600])
def test_x_11_frames_are_at_least_2_005_ms_apart(baud: int) -> None:
    assert LineTiming(baud, Framing.parse("8E1")).silence_s >= 0.002005


@pytest.mark.parametrize(("family", "each_s"), [("ssw06", 0.010), ("ssw07", 0.020)])
def test_x_11_a_write_of_many_registers_is_given_its_time_for_each(family: str, each_s: float) -> None:
    timing = LineTiming(19200, Framing.parse("8E1"))
    setup = StarterSetup("pump", "line", 1, load_profile(family), Variant(), timing)

    assert setup.response_time_of(WriteRegisters(313, (0,) * 10)) >= 10 * each_s
