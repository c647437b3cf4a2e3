"""What counts as lost, repeated and out of order."""

from __future__ import annotations

import json
from typing import Any

from tests.lab.fleet.books import Received, differing, received, verdict

STATE = "starters/g0/starter/s1/state"


def value(seq: int, *, boot: str = "run", topic: str = STATE, at_s: float = 0.0) -> Received:
    return received(at_s, topic, json.dumps({"seq": seq, "boot": boot}).encode(), is_retained=False)


def late(*items: tuple[str, int], boot: str = "run") -> Received:
    body: dict[str, Any] = {"boot": boot, "items": [{"point": point, "seq": seq} for point, seq in items]}
    return received(0.0, "starters/g0/starter/s1/history", json.dumps(body).encode(), is_retained=False)


def test_what_arrived_as_it_was_sent_is_whole() -> None:
    site = [value(1), value(2), value(3)]

    found = verdict(site, site)

    assert found.is_whole
    assert (found.messages, found.repeated, found.backwards, found.holes) == (3, 0, [], {})


def test_a_message_that_never_came_is_lost_and_one_that_no_one_sent_is_foreign() -> None:
    found = verdict([value(1), value(2)], [value(1), value(3)])

    assert found.lost == [(STATE, "run", 2)]
    assert found.foreign == [(STATE, "run", 3)]
    assert found.holes == {("g0", "run"): [2]}
    assert not found.is_whole


def test_a_copy_is_counted_and_is_not_out_of_order() -> None:
    found = verdict([value(1), value(2)], [value(1), value(2), value(1), value(2)])

    assert found.repeated == 2
    assert found.backwards == []
    assert found.is_whole


def test_a_first_copy_after_a_newer_one_is_out_of_order_and_the_end_counts() -> None:
    sent = [value(1), value(2), value(3)]

    healed = verdict(sent, [value(3), value(1), value(2), value(3)])
    stale = verdict(sent, [value(1), value(3), value(2)])

    assert healed.topics_backwards == {STATE}
    assert healed.is_whole
    assert stale.old_at_end == [STATE]
    assert not stale.is_whole


def test_another_run_begins_anew_and_another_topic_has_an_order_of_its_own() -> None:
    sent = [
        value(7),
        value(1, boot="next"),
        value(9, topic="starters/g0/starter/s2/state"),
        value(2, boot="next"),
    ]

    assert verdict(sent, sent).backwards == []


def test_late_values_are_named_as_those_of_their_topic_and_have_no_order() -> None:
    point = "starters/g0/starter/s1/value/current"
    site = [value(5, topic=point), late(("current", 3), ("current", 4))]

    found = verdict(
        site, [value(5, topic=point), late(("current", 4), ("current", 3)), value(4, topic=point)]
    )

    assert found.messages == 3
    assert found.lost == []
    assert found.repeated == 1


def test_what_the_brokers_do_not_hold_alike_is_found_also_without_a_number() -> None:
    here = {"starters/g0/gateway/status": b"offline", "starters/g0/starter/s1/info": b"1"}
    there = {f"acme/{topic}": payload for topic, payload in here.items()}

    assert differing(here, there, prefix="acme/") == []
    there["acme/starters/g0/gateway/status"] = b"online"
    there["acme/starters/g0/starter/s2/info"] = there.pop("acme/starters/g0/starter/s1/info")
    assert differing(here, there, prefix="acme/") == [
        "starters/g0/gateway/status",
        "starters/g0/starter/s1/info",
        "starters/g0/starter/s2/info",
    ]
