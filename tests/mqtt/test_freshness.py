"""What proves that a command was decided upon after the gateway was connected, and just now."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.mqtt.contract.commands import CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import MAX_TTL_S, Moment, RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.records import rfc3339
from gateway.starters.policy.request import CommandRequest

NOW_S = 1_795_222_923.0
TOPICS = Topics("b")


class Desk:
    """An intake that has been connected since second 100, and the wall's time beside the steady clock."""

    def __init__(self) -> None:
        self.boot = RunToken("run")
        self.boot.connected(100.0)
        self.tokens = Tokens(self.boot)
        self.freshness = ("token",)
        self.intake = CommandParser(TOPICS, self.tokens, freshness_of=lambda _: self.freshness)

    def token(self, at_s: float) -> dict[str, Any]:
        return {"token": self.tokens.issue(at_s)}

    def judge(
        self,
        fields: dict[str, Any],
        *,
        at_s: float = 110.0,
        is_synchronised: bool = True,
        verb: str = "start",
        **flags: Any,
    ) -> str | CommandRequest:
        payload = json.dumps({"id": "1", **fields}).encode()
        incoming = Incoming(f"b/command/pump-1/alice/{verb}", payload, **flags)
        doubt = None if is_synchronised else "this gateway's clock is not synchronised"
        verdict = self.intake.judge(incoming, Moment(at_s, NOW_S + at_s, doubt))
        assert verdict is not None
        return verdict.code if isinstance(verdict, Rejection) else verdict


def issued(at_s: float) -> dict[str, Any]:
    return {"issued_at": rfc3339(NOW_S + at_s)}


def test_a_connection_is_as_old_as_when_it_was_first_reported() -> None:
    boot = RunToken("run")
    boot.connected(1.0)
    boot.connected(5.0)

    assert boot.is_before_connection(0.5)
    assert not boot.is_before_connection(3.0)


def test_attempts_to_connect_that_fail_leave_the_token_as_it_is() -> None:
    boot = RunToken("run")
    boot.connected(1.0)
    boot.disconnected()
    token = boot.token

    boot.disconnected()

    assert boot.token == token


def test_a_command_perhaps_issued_before_the_connection_is_refused_although_it_is_fresh() -> None:
    """Its sender's clock may be 2 s ahead: what it calls a moment after the connection was before it."""
    desk = Desk()

    assert desk.judge(issued(99.0), at_s=101.0) == "before_connection"
    assert desk.judge(issued(101.9), at_s=101.0) == "before_connection"
    assert isinstance(desk.judge(issued(102.1), at_s=102.5), CommandRequest)


def test_the_right_token_outweighs_a_senders_clock_that_is_behind() -> None:
    desk = Desk()

    judged = desk.judge({**issued(99.0), **desk.token(100.5)}, at_s=101.0)

    assert isinstance(judged, CommandRequest)


@pytest.mark.parametrize(
    ("fields", "made_s", "flags", "expires_s"),
    [
        ({}, 110.0, {}, 115.0),
        ({}, 107.5, {}, 112.5),  # what is left of its time passes inside the gateway too
        ({"ttl_s": 30}, 107.5, {}, 137.5),
        (issued(108.0), None, {}, 113.0),
        (issued(108.0), 109.0, {}, 113.0),  # of two proofs the elder counts
        (issued(109.0), 107.0, {}, 112.0),
        (issued(111.0), None, {}, 115.0),  # a clock ahead of ours gives no more time
        ({"ttl_s": 30}, 110.0, {"expiry_s": 3}, 113.0),
    ],
)
def test_a_command_may_be_written_no_later_than_it_is_valid(
    fields: dict[str, Any], made_s: float | None, flags: dict[str, Any], expires_s: float
) -> None:
    desk = Desk()
    token = {} if made_s is None else desk.token(made_s)

    judged = desk.judge({**fields, **token}, **flags)

    assert isinstance(judged, CommandRequest)
    assert judged.expires_s == pytest.approx(expires_s)


@pytest.mark.parametrize("ttl_s", [0.5, 5.0, 60.0])
@pytest.mark.parametrize("stalled_s", [1.0, 4.9, 5.1, 12.0, 59.9, 60.5, 62.7, 3600.0])
def test_a_start_that_its_way_held_up_for_longer_than_it_is_valid_is_never_taken(
    ttl_s: float, stalled_s: float
) -> None:
    desk = Desk()
    proofs: list[dict[str, Any]] = [desk.token(200.0), {**desk.token(200.0), "boot": "run"}, issued(200.0)]
    for second in range(200, 201 + int(stalled_s)):
        desk.tokens.issue(float(second))  # others go on being made

    verdicts = [desk.judge({**each, "ttl_s": ttl_s}, at_s=200.0 + stalled_s) for each in proofs]

    if stalled_s <= ttl_s:
        assert all(isinstance(each, CommandRequest) for each in verdicts)
    else:
        assert set(verdicts) <= {"expired", "not_fresh"}
        assert stalled_s > MAX_TTL_S or set(verdicts) == {"expired"}


@pytest.mark.parametrize(
    ("fields", "verdict"),
    [({}, None), ({"boot": "run"}, None), ({"token": "guessed"}, None), (issued(104.0), "expired")],
)
def test_a_read_needs_no_proof_but_is_refused_once_its_own_time_has_run_out(
    fields: dict[str, Any], verdict: str | None
) -> None:
    judged = Desk().judge(fields, verb="read")

    assert judged == verdict if verdict is not None else isinstance(judged, CommandRequest)


def test_a_token_cannot_be_guessed_and_is_remembered_for_a_minute_only() -> None:
    tokens = Tokens(RunToken("run"))
    made = [tokens.issue(float(second)) for second in range(300)]

    assert len(set(made)) == 300
    assert min(len(token) for token in made) >= 16  # 96 bits
    assert tokens.made_s(made[-1]) == 299.0
    assert tokens.made_s(made[238]) == 238.0
    assert tokens.made_s(made[237]) is None
