"""Commands as they arrive."""

from __future__ import annotations

import json
from typing import Any

from gateway.mqtt.intake import Incoming, Intake, Rejection
from gateway.mqtt.topics import Topics
from gateway.starters.request import CommandRequest

NOW_S = 1_795_222_923.0
NOW = "2026-11-21T01:02:03Z"
START = "b/command/pump-1/alice/start"


def judge(
    incoming: Incoming, *, clock_is_synchronised: bool = True, utc_s: float = NOW_S
) -> CommandRequest | Rejection | None:
    return Intake(Topics("b"), "boot-1").judge(
        incoming, utc_s=utc_s, received_s=7.0, clock_is_synchronised=clock_is_synchronised
    )


def command(fields: object, *, topic: str = START, **flags: Any) -> Incoming:
    return Incoming(topic, json.dumps(fields).encode(), **flags)


def fresh(**fields: object) -> dict[str, object]:
    return {"id": "c1", "boot": "boot-1", **fields}


def refusal(incoming: Incoming, *, clock_is_synchronised: bool = True) -> Rejection:
    judged = judge(incoming, clock_is_synchronised=clock_is_synchronised)
    assert isinstance(judged, Rejection)
    return judged
