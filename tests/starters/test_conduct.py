"""How an accepted command is carried out."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import pytest

from gateway.line.job import Lane
from gateway.line.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadCoils, ReadHoldingRegisters
from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.starters import wire
from gateway.starters.records import Phase
from tests.starters.fakes import (
    AT_SPEED,
    ENABLED,
    FAULT,
    READY,
    REMOTE,
    VB01,
    CommandRig,
    virtually,
)

ACCEPTED, WRITTEN, CONFIRMED = ("accepted", "ok"), ("written", "ok"), ("confirmed", "ok")


async def ready(family: str = "ssw07", *, is_snapshot_old: bool = False) -> CommandRig:
    rig = CommandRig(family)
    await rig.online()
    if is_snapshot_old:
        await asyncio.sleep(10.0)
        rig.sink.clear()
    return rig


def ignore(_request: Request) -> None:
    """Be a starter that acknowledges a command and does nothing."""


@virtually
async def test_a_start_is_accepted_written_and_confirmed_by_what_is_read_back() -> None:
    rig = await ready()

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert rig.starts() == 1
    assert "running" in rig.sink.states()


@virtually
async def test_a_start_is_judged_on_readings_taken_after_it_arrived() -> None:
    rig = await ready()

    rig.submit("start")
    await asyncio.sleep(5.0)

    first = rig.line.sent[0]
    assert not first.request.is_write
    assert first.lane is Lane.COMMAND


@virtually
async def test_a_start_needs_two_readings_when_the_last_poll_is_old() -> None:
    rig = await ready(is_snapshot_old=True)

    rig.submit("start")
    await asyncio.sleep(5.0)

    kinds = [sent.request.is_write for sent in rig.line.sent]
    assert kinds.index(True) >= 2
    assert rig.sink.final().phase is Phase.CONFIRMED


@pytest.mark.parametrize(
    ("word", "rule"),
    [
        (READY & ~REMOTE, "remote"),
        (READY & ~ENABLED, "general_enabled"),
        (READY | FAULT, "no_fault"),
        (AT_SPEED, "is_ready"),
    ],
)
@virtually
async def test_a_start_that_a_rule_forbids_is_rejected_by_its_name_and_nothing_is_written(
    word: int, rule: str
) -> None:
    rig = await ready()
    rig.unit.holding[VB01] = word

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", rule)]
    assert rig.line.writes == []


@virtually
async def test_one_false_reading_does_not_let_a_start_pass() -> None:
    rig = await ready(is_snapshot_old=True)
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(false_reading(rig, READY))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.final().code == "no_fault"
    assert rig.line.writes == []


@virtually
async def test_a_command_word_that_never_reads_twice_the_same_is_not_built_upon() -> None:
    rig = await ready("ssw900", is_snapshot_old=True)
    rig.line.rules.append(lambda request: turn_direction(rig, request))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.final().code == "readings_disagree"
    assert rig.line.writes == []


@virtually
async def test_a_start_without_answer_is_written_once_and_ends_unconfirmed() -> None:
    rig = await ready()

    with rig.line.silence(WriteCoil):
        rig.submit("start")
        await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "not_seen")]
    assert "may be turning" in rig.sink.final().text
    assert rig.starts() == 1


@virtually
async def test_a_start_whose_answer_is_lost_is_confirmed_by_the_running_motor() -> None:
    rig = await ready()
    rig.line.rules.append(lambda request: lost_answer(rig, request))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert rig.starts() == 1


@virtually
async def test_a_starter_that_ignores_a_start_silently_leaves_it_unconfirmed() -> None:
    rig = await ready()
    rig.unit.on_write = ignore

    rig.submit("start")
    await asyncio.sleep(20.0)

    assert rig.sink.final().code == "not_seen"
    assert rig.starts() == 1


@virtually
async def test_a_motor_that_runs_late_but_in_time_is_confirmed() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(2.5)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(1.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_one_reading_of_a_running_motor_does_not_confirm_a_start() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(1.0)
    rig.line.rules.append(false_reading(rig, AT_SPEED))

    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED


@virtually
async def test_a_single_running_reading_at_the_very_end_gets_its_second() -> None:
    rig = await ready()
    rig.unit.on_write = ignore
    rig.submit("start")
    await asyncio.sleep(3.0)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_a_refused_start_has_failed() -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteCoil, 3))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("failed", "illegal_data_value")]


@virtually
async def test_a_start_that_the_starter_says_it_is_still_working_on_is_read_back() -> None:
    rig = await ready()
    rig.line.rules.append(refuse(WriteCoil, 5))
    rig.submit("start")
    await asyncio.sleep(1.0)
    rig.unit.holding[VB01] = AT_SPEED

    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]


@virtually
async def test_a_write_that_could_not_be_sent_is_a_rejection() -> None:
    rig = await ready()
    rig.line.rules.append(lambda r: Silent("port closed", is_sent=False) if r.is_write else None)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", "line_down")]


@pytest.mark.parametrize(
    ("outcome", "code"),
    [
        (Silent(), "no_answer"),
        (Garbled("bad CRC", b"\x07"), "no_answer"),
        (Silent("port closed", is_sent=False), "line_down"),
    ],
)
@virtually
async def test_a_starter_whose_status_cannot_be_read_freshly_is_not_started(
    outcome: Outcome, code: str
) -> None:
    rig = await ready()
    rig.line.rules.append(lambda request: outcome)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("rejected", code)]
    assert rig.line.writes == []


@virtually
async def test_one_lost_reading_is_asked_for_again() -> None:
    rig = await ready()
    rig.line.rules.append(once(lambda request: Silent()))

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_lost_read_backs_do_not_hinder_a_confirmation() -> None:
    rig = await ready()
    rig.submit("start")
    await asyncio.sleep(0.05)
    rig.line.rules.append(once(lambda request: Silent()))

    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_an_error_inside_before_the_write_ends_as_failed(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rig = await ready()
    monkeypatch.setattr(wire, "rows_in", broken)

    with caplog.at_level(logging.ERROR):
        rig.submit("start")
        await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("failed", "internal")]
    assert "ended by a bug" in caplog.text
    assert rig.line.writes == []


@virtually
async def test_an_error_inside_after_the_write_leaves_the_command_unconfirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = await ready()
    rig.unit.on_write = lambda request: monkeypatch.setattr(wire, "rows_in", broken)

    rig.submit("start")
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "internal")]


@virtually
async def test_a_read_tells_the_value_with_its_unit_and_raw_words() -> None:
    rig = await ready()
    rig.unit.holding[3] = 815

    rig.submit("read", args={"parameter": "p003"})
    await asyncio.sleep(1.0)

    final = rig.sink.final()
    assert (final.phase, final.code) == (Phase.CONFIRMED, "ok")
    assert final.values == {"parameter": "P003", "value": 81.5, "unit": "A", "label": None, "raw": [815]}
    assert len(rig.line.sent) == 1


@virtually
async def test_a_refused_read_has_failed() -> None:
    rig = await ready()
    del rig.unit.holding[3]

    rig.submit("read", args={"parameter": "P003"})
    await asyncio.sleep(1.0)

    assert rig.sink.final().phase is Phase.FAILED
    assert rig.sink.final().code == "illegal_data_address"


@virtually
async def test_a_set_is_written_once_and_read_back() -> None:
    rig = await ready()
    rig.unit.holding[314] = 5

    rig.submit("set", args={"parameter": "P314", "value": 30})
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, CONFIRMED]
    assert rig.sink.final().values["value"] == 30
    assert len(rig.line.writes) == 1


@virtually
async def test_a_value_that_stands_already_is_not_written_again() -> None:
    rig = await ready()
    rig.unit.holding[314] = 30

    rig.submit("set", args={"parameter": "P314", "value": 30})
    await asyncio.sleep(5.0)

    assert rig.sink.phases() == [ACCEPTED, ("confirmed", "unchanged")]
    assert rig.line.writes == []


@virtually
async def test_a_reset_stops_after_a_first_write_that_was_not_answered() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT

    with rig.line.silence(WriteCoil):
        rig.submit("reset")
        await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "no_answer")]
    assert len(rig.line.writes) == 1


@virtually
async def test_a_reset_refused_at_its_second_write_has_failed() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(lambda r: Refused(3, 0.0) if r.is_write and len(rig.line.writes) == 2 else None)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("failed", "illegal_data_value")]


@virtually
async def test_a_line_lost_between_two_writes_leaves_the_command_unconfirmed() -> None:
    rig = await ready()
    rig.unit.holding[VB01] = READY | FAULT
    rig.line.rules.append(
        lambda r: Silent("port lost", is_sent=False) if r.is_write and len(rig.line.writes) == 2 else None
    )

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("unconfirmed", "line_down")]


@virtually
async def test_the_restart_after_an_ssw06_reset_is_announced_to_the_line() -> None:
    rig = await ready("ssw06")
    rig.unit.holding[VB01] = READY | FAULT
    rig.unit.on_write = lambda request: clear_fault(rig, request)

    rig.submit("reset")
    await asyncio.sleep(20.0)

    assert rig.line.expected_silence == [(7, 10.0)]
    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_an_sst_that_does_not_enter_its_configuration_mode_is_left_as_it_was() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: forget_coil_2(rig, r))

    rig.submit("configure")
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED
    assert rig.line.writes == [WriteCoil(1, True), WriteCoil(1, False)]


@virtually
async def test_an_sst_that_cannot_be_left_safe_is_unconfirmed_although_it_refused() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: Refused(2, 0.0) if isinstance(r, WriteRegister) else None)
    rig.line.rules.append(lambda r: Silent() if r == WriteCoil(1, False) else None)

    rig.submit("configure", args={"R41": 60})
    await asyncio.sleep(20.0)

    assert rig.sink.final().phase is Phase.UNCONFIRMED
    assert rig.sink.final().code == "illegal_data_address"


@virtually
async def test_an_sst_that_refuses_a_register_is_taken_out_of_configuration_mode() -> None:
    rig = await ready("sst")
    rig.line.rules.append(lambda r: Refused(3, 0.0) if isinstance(r, WriteRegister) else None)

    rig.submit("configure", args={"R41": 60})
    await asyncio.sleep(20.0)

    assert rig.sink.phases() == [ACCEPTED, WRITTEN, ("failed", "illegal_data_value")]
    assert rig.line.writes[-1] == WriteCoil(1, False)


def false_reading(rig: CommandRig, word: int) -> Callable[[Request], Outcome | None]:
    """Let the next reading of the status word be wrong, once."""

    def answer(request: Request) -> Outcome | None:
        if isinstance(request, ReadHoldingRegisters) and request.address == VB01:
            return Answered((word,) * request.count, at_s=rig.clock.now_s(), response_time_s=0.0)
        return None

    return once(answer)


def once(rule: Callable[[Request], Outcome | None]) -> Callable[[Request], Outcome | None]:
    left = [1]

    def one(request: Request) -> Outcome | None:
        outcome = rule(request) if left[0] else None
        left[0] -= outcome is not None
        return outcome

    return one


def refuse(kind: type[WriteCoil], code: int) -> Callable[[Request], Outcome | None]:
    return lambda request: Refused(code, at_s=0.0) if isinstance(request, kind) else None


def lost_answer(rig: CommandRig, request: Request) -> Outcome | None:
    if not isinstance(request, WriteCoil):
        return None
    rig.unit.answer(request)
    return Silent()


def forget_coil_2(rig: CommandRig, request: Request) -> None:
    if isinstance(request, ReadCoils):
        rig.unit.coils[1] = False


def turn_direction(rig: CommandRig, request: Request) -> None:
    """Change a bit of the status word, from which the command word is built, with each reading."""
    if isinstance(request, ReadHoldingRegisters) and request.address <= 680:
        rig.unit.holding[680] ^= 0x0800


def clear_fault(rig: CommandRig, request: Request) -> None:
    if isinstance(request, WriteRegister) and request.word & 0x0080:
        rig.unit.holding[VB01] = READY


def broken(*_args: object) -> None:
    raise RuntimeError("a bug")
