"""What proves that a command was decided upon after the gateway was connected, and just now."""

from __future__ import annotations

import json
from typing import Any

import pytest

from gateway.mqtt.boot import Boot
from gateway.mqtt.intake import Incoming, Intake, Rejection
from gateway.mqtt.json_out import rfc3339
from gateway.mqtt.payload import Payloads
from gateway.mqtt.topics import Topics
from gateway.starters.records import EventRecord, LockRecord, Quality, Severity, StateRecord
from gateway.starters.request import CommandRequest

NOW_S = 1_795_222_923.0
TOPICS = Topics("b")


class Desk:
    """An intake that has been connected since second 100, and the wall's time beside the steady clock."""

    def __init__(self) -> None:
        self.boot = Boot("run")
        self.boot.connected(100.0)
        self.intake = Intake(TOPICS, self.boot)

    def judge(
        self, fields: dict[str, Any], *, at_s: float = 110.0, is_synchronised: bool = True, **flags: Any
    ) -> str | CommandRequest:
        incoming = Incoming(
            "b/command/pump-1/alice/start", json.dumps({"id": "1", **fields}).encode(), **flags
        )
        verdict = self.intake.judge(
            incoming, utc_s=NOW_S + at_s, received_s=at_s, clock_is_synchronised=is_synchronised
        )
        assert verdict is not None
        return verdict.code if isinstance(verdict, Rejection) else verdict


def issued(at_s: float) -> dict[str, Any]:
    return {"issued_at": rfc3339(NOW_S + at_s)}


def test_the_token_of_the_first_connection_is_the_name_of_the_run() -> None:
    assert Boot("run").token == "run"


def test_a_lost_connection_takes_its_token_along() -> None:
    boot = Boot("run")
    tokens = set()
    for _ in range(3):
        boot.connected(1.0)
        tokens.add(boot.token)
        boot.disconnected()

    assert len({*tokens, boot.token}) == 4


def test_a_connection_is_as_old_as_when_it_was_first_told() -> None:
    boot = Boot("run")
    boot.connected(1.0)
    boot.connected(5.0)

    assert boot.is_before_connection(0.5)
    assert not boot.is_before_connection(3.0)


def test_attempts_to_connect_that_fail_leave_the_token_as_it_is() -> None:
    boot = Boot("run")
    boot.connected(1.0)
    boot.disconnected()
    token = boot.token

    boot.disconnected()

    assert boot.token == token


def test_a_command_with_the_token_of_an_earlier_connection_is_refused() -> None:
    desk = Desk()
    token = desk.boot.token
    desk.boot.disconnected()
    desk.boot.connected(105.0)

    assert desk.judge({"boot": token}) == "wrong_boot"
    assert isinstance(desk.judge({"boot": desk.boot.token}), CommandRequest)


def test_a_command_issued_before_the_connection_is_refused_although_it_is_fresh() -> None:
    desk = Desk()

    assert desk.judge(issued(99.0), at_s=101.0) == "before_connection"
    assert isinstance(desk.judge(issued(100.5), at_s=101.0), CommandRequest)


def test_the_right_token_outweighs_a_senders_clock_that_is_behind() -> None:
    desk = Desk()

    judged = desk.judge({**issued(99.0), "boot": desk.boot.token}, at_s=101.0)

    assert isinstance(judged, CommandRequest)


def test_nothing_is_before_a_connection_that_has_not_been_told() -> None:
    assert not Boot("run").is_before_connection(0.0)


def test_without_a_synchronised_clock_only_the_token_proves_anything() -> None:
    desk = Desk()

    assert desk.judge(issued(110.0), is_synchronised=False) == "not_fresh"
    assert isinstance(desk.judge({"boot": "run"}, is_synchronised=False), CommandRequest)


@pytest.mark.parametrize(
    ("fields", "flags", "expires_s"),
    [
        ({"boot": "run"}, {}, 115.0),
        ({"boot": "run", "ttl_s": 30}, {}, 140.0),
        (issued(108.0), {}, 113.0),
        (issued(111.0), {}, 115.0),  # a clock ahead of ours gives no more time
        ({"boot": "run", "ttl_s": 30}, {"expiry_s": 3}, 113.0),
    ],
)
def test_a_command_may_be_written_no_later_than_it_is_valid(
    fields: dict[str, Any], flags: dict[str, Any], expires_s: float
) -> None:
    judged = Desk().judge(fields, **flags)

    assert isinstance(judged, CommandRequest)
    assert judged.expires_s == pytest.approx(expires_s)


def test_what_is_expected_and_selected_is_passed_on() -> None:
    judged = Desk().judge({"boot": "run", "expect": {"state": "ready", "remote": True}, "select": "ab12"})

    assert isinstance(judged, CommandRequest)
    assert judged.expect == {"state": "ready", "remote": True}
    assert judged.select == "ab12"


@pytest.mark.parametrize(
    "fields",
    [
        {"expect": "ready"},
        {"expect": {"state": None}},
        {"expect": {"state": ["ready"]}},
        {"expect": {"": 1}},
        {"expect": {str(number): 1 for number in range(17)}},
        {"select": ""},
        {"select": 7},
    ],
)
def test_an_expectation_or_selection_of_another_shape_is_refused(fields: dict[str, Any]) -> None:
    assert Desk().judge({"boot": "run", **fields}) == "bad_payload"


def test_the_status_tells_the_token_and_the_run_and_events_the_run() -> None:
    boot = Boot("run")
    payloads = Payloads(TOPICS, boot)
    boot.connected(1.0)
    boot.disconnected()

    status = json.loads(payloads.status("online", time_s=None, since_s=None, reason=None).payload)
    event = payloads.message(EventRecord("pump-1", "started", Severity.INFO, "it starts", NOW_S, 7))

    assert (status["boot"], status["run"]) == ("run-2", "run")
    assert json.loads(event.payload)["boot"] == "run"


def test_a_state_tells_by_whom_and_why_the_starter_is_locked() -> None:
    lock = LockRecord("alice", NOW_S, "belt is off", "Alice A.")
    locked = StateRecord("pump-1", "ready", Quality.GOOD, NOW_S, 1, is_lock_told=True, lock=lock)
    free = StateRecord("pump-1", "ready", Quality.GOOD, NOW_S, 1, is_lock_told=True)
    payloads = Payloads(TOPICS, "run")

    assert json.loads(payloads.message(locked).payload)["locked"] == {
        "by": "alice",
        "operator": "Alice A.",
        "since": rfc3339(NOW_S),
        "reason": "belt is off",
        "notice": "replaces no physical lock",
    }
    assert json.loads(payloads.message(free).payload)["locked"] is None
