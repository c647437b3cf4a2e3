"""What is judged before a command is accepted."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.records import AuditRecord, Phase, ResultRecord
from tests.starters.rig import CommandRig, virtually


@pytest.mark.parametrize(
    ("verb", "more", "code"),
    [
        ("start", {"starter": "pump-9"}, "unknown_starter"),
        ("fly", {}, "unknown_verb"),
        ("start", {"client": "victor"}, "not_allowed"),
        ("start", {"client": "mallory"}, "not_allowed"),
        ("start", {"id_": None}, "no_id"),
        ("start", {"id_": ""}, "no_id"),
        ("start", {"args": {"speed": 3}}, "bad_arguments"),
        ("read", {"args": {"parameter": "nonsense"}}, "unknown_parameter"),
        ("set", {"args": {"parameter": "P001", "value": 1}}, "not_writable"),
    ],
)
@virtually
async def test_a_command_that_cannot_be_is_rejected_and_nothing_is_sent(
    verb: str, more: dict[str, Any], code: str
) -> None:
    rig = CommandRig()
    await rig.online()

    rig.submit(verb, **more)
    await asyncio.sleep(1.0)

    assert rig.sink.phases() == [("rejected", code)]
    assert rig.line.sent == []


@virtually
async def test_without_operators_the_gateway_is_read_only() -> None:
    rig = CommandRig(operators=())
    await rig.online()

    for verb in ("start", "stop", "read"):
        rig.submit(verb, verb)

    assert {code for _, code in rig.sink.phases()} == {"not_allowed"}


@virtually
async def test_a_client_without_the_right_does_not_learn_whether_its_arguments_are_good() -> None:
    rig = CommandRig()
    await rig.online()

    rig.submit("set", client="victor", args={"nonsense": 1})

    assert rig.sink.phases() == [("rejected", "not_allowed")]


@virtually
async def test_a_starter_that_does_not_answer_takes_no_command() -> None:
    rig = CommandRig()
    await rig.online()
    rig.lose()

    rig.submit("start")

    assert rig.sink.phases() == [("rejected", "offline")]


@virtually
async def test_a_starter_that_is_not_yet_identified_takes_no_command() -> None:
    rig = CommandRig()
    rig.telemetry.start()
    rig.poll()

    rig.submit("start")

    assert rig.sink.phases() == [("rejected", "identity_unknown")]


@virtually
async def test_another_device_at_the_address_takes_no_command() -> None:
    rig = CommandRig()
    rig.unit.objects = {1: "SSW-06 85.0A"}
    await rig.online()

    rig.submit("start")

    final = rig.sink.final()
    assert (final.phase, final.code) == (Phase.REJECTED, "identity_mismatch")
    assert "ssw06" in final.text


@virtually
async def test_a_second_command_meanwhile_is_rejected_as_busy() -> None:
    rig = CommandRig()
    await rig.online()

    rig.submit("start", "1")
    rig.submit("read", "2", args={"parameter": "P003"})
    await asyncio.sleep(5.0)

    assert rig.sink.phases("2") == [("rejected", "busy")]
    assert rig.sink.final("1").phase is Phase.CONFIRMED


@virtually
async def test_a_starter_is_free_again_once_its_command_has_ended() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("read", "1", args={"parameter": "P003"})
    await asyncio.sleep(5.0)

    rig.submit("read", "2", args={"parameter": "P003"})
    await asyncio.sleep(5.0)

    assert rig.sink.final("2").phase is Phase.CONFIRMED


@virtually
async def test_a_start_is_rejected_as_busy_while_a_stop_is_under_way() -> None:
    rig = CommandRig()
    await rig.online()

    rig.submit("stop", "1")
    rig.submit("start", "2")
    await asyncio.sleep(5.0)

    assert rig.sink.phases("2") == [("rejected", "busy")]
    assert rig.starts() == 0


@virtually
async def test_a_repetition_while_the_command_is_under_way_gets_its_present_phase() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")

    rig.submit("start", "1")

    first, second = rig.sink.of(ResultRecord)
    assert (first.phase, first.is_duplicate) == (Phase.ACCEPTED, False)
    assert (second.phase, second.is_duplicate) == (Phase.ACCEPTED, True)


@virtually
async def test_every_decision_is_audited_with_what_was_read_before_and_after() -> None:
    rig = CommandRig()
    await rig.online()

    rig.submit("start", "1", operator="Alice A.", args={})
    await asyncio.sleep(5.0)

    accepted, confirmed = rig.sink.of(AuditRecord)
    assert (accepted.decision, confirmed.decision) == ("accepted", "confirmed")
    assert confirmed.operator == "Alice A."
    assert confirmed.before["running"] is False
    assert confirmed.after["running"] is True
    assert accepted.seq < confirmed.seq


@virtually
async def test_closing_rejects_what_is_not_yet_written_and_takes_nothing_new() -> None:
    rig = CommandRig()
    await rig.online()
    rig.submit("start", "1")

    await rig.dispatcher.close()
    rig.submit("start", "2")
    rig.submit("stop", "3")
    await asyncio.sleep(5.0)

    assert rig.sink.phases("1") == [("accepted", "ok"), ("rejected", "shutting_down")]
    assert rig.sink.phases("2") == [("rejected", "shutting_down")]
    assert rig.sink.phases("3") == [("rejected", "shutting_down")]
    assert rig.line.writes == []


@virtually
async def test_closing_leaves_a_written_command_unconfirmed() -> None:
    rig = CommandRig()
    await rig.online()
    rig.unit.on_write = lambda request: None
    rig.submit("start", "1")
    await asyncio.sleep(0.3)

    await rig.dispatcher.close()

    assert rig.sink.final("1").phase is Phase.UNCONFIRMED
    assert rig.sink.final("1").code == "shutting_down"
    assert len(rig.line.writes) == 1


@virtually
async def test_closing_an_idle_dispatcher_ends_at_once() -> None:
    rig = CommandRig()

    await rig.dispatcher.close()

    assert rig.sink.records == []
