"""Rebirths: always honoured, the storms of them dampened."""

from __future__ import annotations

from gateway.sparkplug.node import REBIRTH_EVERY_S
from tests.sparkplug.support import NodeRig, availability, value

ALL = [("NBIRTH", None), ("DBIRTH", "pump"), ("DBIRTH", "fan")]


def kinds(rig: NodeRig, after_s: float = 0.0) -> list[tuple[str, str | None]]:
    return [(each.kind, each.device) for each in rig.say(after_s=after_s)]


def test_no_data_is_sent_between_a_request_and_its_births() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(value("pump", "current", 5.0))
    rig.node.request_rebirth(rig.now_s)
    rig.put(value("fan", "current", 6.0))

    assert kinds(rig, after_s=1.0) == ALL
    assert kinds(rig, after_s=1.0) == []


def test_a_storm_of_requests_becomes_one_rebirth_at_once_and_one_when_five_seconds_have_passed() -> None:
    rig = NodeRig()
    rig.born()

    rig.node.request_rebirth(rig.now_s)
    assert kinds(rig) == ALL
    for _ in range(100):
        rig.node.request_rebirth(rig.now_s)
    assert kinds(rig, after_s=REBIRTH_EVERY_S - 0.01) == []

    assert kinds(rig, after_s=0.01) == ALL
    assert kinds(rig, after_s=60.0) == []


def test_a_rebirth_leaves_out_what_does_not_answer() -> None:
    rig = NodeRig()
    rig.born()
    rig.put(availability("fan", "offline", rig.utc_s))
    rig.say()

    rig.node.request_rebirth(rig.now_s)

    assert kinds(rig) == ALL[:2]


def test_a_request_while_nothing_is_connected_waits_for_the_births_that_come_anyway() -> None:
    rig = NodeRig(is_begun=False)
    rig.online()
    rig.node.request_rebirth(rig.now_s)
    assert kinds(rig) == []

    rig.node.begin(1)

    assert kinds(rig) == ALL
    assert kinds(rig, after_s=10.0) == []
