"""What `broker-kit --lint` finds in a configuration of Mosquitto."""

from __future__ import annotations

import pytest

from gateway.cli.broker_kit.lint import warnings


def test_everything_dangerous_in_a_bridge_is_found() -> None:
    conf = "allow_anonymous true\nconnection all\naddress central:1883\ntopic # both 1\n"

    found = list(warnings(conf, "starters/mcc1"))

    assert [each.split(":")[0] for each in found] == ["line 1", "line 4", "line 4", "line 2", "line 2"]
    assert "endless storm" in found[1]
    assert "delivered late" in found[3]


@pytest.mark.parametrize(
    ("topic", "count"),
    [
        ("gateway/# out 1 starters/mcc1/ acme/", 0),
        ("command/# out 1 starters/mcc1/ acme/", 1),
        ("# out", 1),
        ("+/mcc1/# out", 1),
        ("# in 1 starters/mcc1/command/ acme/", 0),
        ("result/# in 1 starters/mcc1/ acme/", 1),
        ("# out 1 other/ acme/", 0),
        ('"" out 1 starters/mcc1/audit acme/audit', 0),
    ],
)
def test_a_topic_is_judged_by_what_it_carries(topic: str, count: int) -> None:
    conf = (
        f"connection a\naddress central\ncleansession true\nbridge_protocol_version mqttv50\ntopic {topic}\n"
    )

    assert len(list(warnings(conf, "starters/mcc1"))) == count


@pytest.mark.parametrize(
    ("topic", "is_found"),
    [
        ("+/dispatch/+ in 1 starters/mcc1/command/ acme/", False),
        ("+/alice/+ in 1 starters/mcc1/command/ acme/", True),
        ("# in 1 starters/mcc1/command/ acme/", True),
        ("starters/mcc1/command/# in", True),
    ],
)
def test_only_dated_commands_may_come_in(topic: str, is_found: bool) -> None:
    conf = f"connection a\naddress c\ncleansession 1\nbridge_protocol_version mqttv50\ntopic {topic}\n"

    found = list(warnings(conf, "starters/mcc1", ["dispatch"]))

    assert [each for each in found if "issued_at" in each] == found
    assert bool(found) == is_found


def test_each_listener_counts_where_each_has_settings_of_its_own() -> None:
    conf = "per_listener_settings true\nlistener 1\nallow_anonymous 1\nlistener 2\nallow_anonymous false\n"

    assert [each.partition(":")[0] for each in warnings(conf, "x")] == ["line 1", "line 3"]
    assert list(warnings("allow_anonymous true\nallow_anonymous false\n", "x")) == []
