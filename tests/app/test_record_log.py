"""The journal: what happened to which starter, who asked for what and how it ended, each once."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

import pytest

from gateway.app.record_log import RecordLog
from gateway.contract import AvailabilityRecord, EventRecord, Phase, ResultRecord, Severity
from tests.rig import RigPlant, act
from tests.rig.sites import SSW07
from tests.virtual_time import VirtualClock, virtually


def result(phase: Phase, code: str = "ok", text: str = "", **more: Any) -> ResultRecord:
    return ResultRecord(
        starter="pump-1",
        client="alice",
        id="1",
        verb="start",
        phase=phase,
        code=code,
        text=text,
        time_s=0.0,
        **more,
    )


def event(code: str, text: str, data: dict[str, Any] | None = None, starter: str = "pump-1") -> EventRecord:
    return EventRecord(
        starter=starter, code=code, severity=Severity.ERROR, text=text, time_s=0.0, seq=1, data=data or {}
    )


@virtually
async def test_a_commands_end_is_one_line_with_who_what_which_and_how_long() -> None:
    lines = await logged([result(Phase.ACCEPTED), 0.2, result(Phase.WRITTEN), result(Phase.CONFIRMED)])

    assert lines == [("INFO", "alice start pump-1: confirmed after 0.2 s")]


@virtually
async def test_a_command_that_was_not_carried_out_says_why() -> None:
    lines = await logged([result(Phase.REJECTED, "not_allowed", "alice has no right to start pump-1")])

    assert lines == [
        ("WARNING", "alice start pump-1: rejected: alice has no right to start pump-1 [not_allowed]")
    ]


@virtually
async def test_a_starter_is_named_when_it_answers_first_and_then_by_its_events() -> None:
    def availability(state: str, reason: str | None) -> AvailabilityRecord:
        return AvailabilityRecord(starter="pump-1", state=state, since_s=0.0, reason=reason)

    lines = await logged(
        [
            availability("offline", "not yet read"),
            availability("offline", "no reply"),
            availability("offline", "no reply"),
            availability("online", None),
            availability("offline", "no reply"),
            event("went_silent", "the starter went silent: no reply", {"frames": ["0.0 >> 02", "0.1 << 02"]}),
        ]
    )

    assert [text for _, text in lines] == [
        "pump-1 does not answer: no reply",
        "pump-1 answers",
        "pump-1 went silent: no reply; last frames:\n0.0 >> 02\n0.1 << 02",
    ]


@virtually
async def test_foreign_text_cannot_begin_a_line_of_its_own() -> None:
    (line,) = await logged([event("malformed_topic", "a message came on x\n<0>y\x1b[2J", starter="")])

    assert line == ("ERROR", "a message came on x <0>y [2J")


def test_a_fault_of_a_starter_is_logged_once_with_its_number(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "gateway"), RigPlant(SSW07) as plant:
        plant.run(until=5.0)
        for change in ("pump VB01 = 0x8000", "pump P014 = 5"):
            act(plant, change)
        plant.run(until=15.0)

    assert [text for text in caplog.messages if "fault" in text] == ["pump fault E05 Motor overload"]


async def logged(records: list[Any]) -> list[tuple[str, str]]:
    """Return level and text of what is logged of these records; a number is a pause in seconds."""
    lines: list[tuple[str, str]] = []
    record_log = RecordLog(VirtualClock(asyncio.get_running_loop()))
    handler = logging.Handler()
    handler.emit = lambda entry: lines.append((entry.levelname, entry.getMessage()))  # type: ignore[method-assign]
    logger = logging.getLogger("gateway")
    logger.addHandler(handler)
    level = logger.level
    logger.setLevel(logging.INFO)
    try:
        for record in records:
            if isinstance(record, float):
                await asyncio.sleep(record)
            else:
                record_log.put(record)
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
    return lines
