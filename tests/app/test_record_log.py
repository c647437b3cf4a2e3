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
from tests.virtual_time import VirtualClock, run_virtually


def result(phase: Phase, code: str = "ok", text: str = "") -> ResultRecord:
    command = {"starter": "pump-1", "client": "alice", "id": "1", "verb": "start", "time_s": 0.0}
    return ResultRecord(**command, phase=phase, code=code, text=text)


def event(code: str, text: str, **data: Any) -> EventRecord:
    return EventRecord(
        starter="pump-1", code=code, severity=Severity.ERROR, text=text, time_s=0.0, seq=1, data=data
    )


def availability(state: str, reason: str | None = None) -> AvailabilityRecord:
    return AvailabilityRecord(starter="pump-1", state=state, since_s=0.0, reason=reason)


NO_RIGHT = "alice has no right to start pump-1"


@pytest.mark.parametrize(
    ("records", "lines"),
    [  # a number is a pause in seconds
        (
            [result(Phase.ACCEPTED), 0.2, result(Phase.WRITTEN), result(Phase.CONFIRMED)],
            ["INFO alice start pump-1: confirmed after 0.2 s"],
        ),
        (
            [result(Phase.REJECTED, "not_allowed", NO_RIGHT)],
            [f"WARNING alice start pump-1: rejected: {NO_RIGHT} [not_allowed]"],
        ),
        (  # a starter is named when it answers first and then by its events
            [
                availability("offline", "not yet read"),
                *[availability("offline", "no reply")] * 2,
                availability("online"),
                availability("offline", "no reply"),
                event("went_silent", "the starter went silent: no reply", frames=["0.0 >> 02", "0.1 << 02"]),
            ],
            [
                "WARNING pump-1 does not answer: no reply",
                "INFO pump-1 answers",
                "ERROR pump-1 went silent: no reply; last frames:\n0.0 >> 02\n0.1 << 02",
            ],
        ),
        (  # foreign text cannot begin a line of its own
            [event("malformed_topic", "a message came on x\n<0>y\x1b[2J")],
            ["ERROR pump-1 a message came on x <0>y [2J"],
        ),
    ],
)
def test_what_is_logged_of_records(
    records: list[Any], lines: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    async def main() -> None:
        record_log = RecordLog(VirtualClock(asyncio.get_running_loop()))
        for record in records:
            if isinstance(record, float):
                await asyncio.sleep(record)
            else:
                record_log.put(record)

    with caplog.at_level(logging.INFO, "gateway"):
        run_virtually(main())

    assert [f"{each.levelname} {each.getMessage()}" for each in caplog.records] == lines


def test_a_fault_of_a_starter_is_logged_once_with_its_number(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "gateway"), RigPlant(SSW07) as plant:
        plant.run(until=5.0)
        for change in ("pump VB01 = 0x8000", "pump P014 = 5"):
            act(plant, change)
        plant.run(until=15.0)

    assert [text for text in caplog.messages if "fault" in text] == ["pump fault E05 Motor overload"]
