"""Commands as they arrive."""

from __future__ import annotations

import json
from typing import Any

from gateway.contract import CommandRequest, Topics
from gateway.mqtt.commands import CommandParser, Incoming, Rejection
from gateway.starters.policy.freshness import Moment, RunToken, Tokens

NOW_S = 1_795_222_923.0
NOW = "2026-11-21T01:02:03Z"
START = "b/command/pump-1/alice/start"


TOKEN = "token-1"  # made when everything arrives
UNSYNCHRONISED = "this gateway's clock is not synchronised"


def intake(topics: Topics | None = None, *, at_s: float = 7.0, freshness: str = "token") -> CommandParser:
    """Return an intake of the run `boot-1` that has just made TOKEN."""
    tokens = Tokens(RunToken("boot-1"), draw=lambda: TOKEN)
    tokens.issue(at_s)
    return CommandParser(topics or Topics("b"), tokens, freshness_of=lambda _: (freshness,))


def judge(
    incoming: Incoming,
    *,
    clock_is_synchronised: bool = True,
    utc_s: float = NOW_S,
    freshness: str = "token",
) -> CommandRequest | Rejection | None:
    doubt = None if clock_is_synchronised else UNSYNCHRONISED
    return intake(freshness=freshness).judge(incoming, Moment(7.0, utc_s, doubt))


def command(fields: object, *, topic: str = START, **flags: Any) -> Incoming:
    return Incoming(topic, json.dumps(fields).encode(), **flags)


def fresh(**fields: object) -> dict[str, object]:
    return {"id": "c1", "token": TOKEN, **fields}


def refusal(incoming: Incoming, **how: Any) -> Rejection:
    judged = judge(incoming, **how)
    assert isinstance(judged, Rejection)
    return judged
