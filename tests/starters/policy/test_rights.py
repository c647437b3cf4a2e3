from __future__ import annotations

import pytest

from gateway.contract import Operator
from gateway.starters.policy.rights import Rights

ALICE = Operator("alice", may=("start", "stop"), starters=("pump-*", "fan-?"))
ADMIN = Operator("admin", may=("*",), starters=("*",))


def test_without_operators_no_client_may_do_anything() -> None:
    assert not Rights().is_allowed("alice", verb="stop", starter="pump-1")


@pytest.mark.parametrize(
    ("client", "verb", "starter", "is_allowed"),
    [
        ("alice", "start", "pump-1", True),
        ("alice", "stop", "fan-2", True),
        ("alice", "stop", "fan-22", False),
        ("alice", "reset", "pump-1", False),
        ("alice", "start", "mill-1", False),
        ("alice", "start", "my-pump-1", False),
        ("bob", "start", "pump-1", False),
        ("Alice", "start", "pump-1", False),
        ("admin", "reset", "mill-1", True),
    ],
)
def test_a_client_may_do_what_one_of_its_entries_names(
    client: str, verb: str, starter: str, is_allowed: bool
) -> None:
    rights = Rights([ALICE, ADMIN])

    assert rights.is_allowed(client, verb=verb, starter=starter) is is_allowed


def test_the_entries_of_a_client_add_up_but_do_not_mix() -> None:
    rights = Rights([Operator("bob", ("start",), ("a",)), Operator("bob", ("stop",), ("b",))])

    assert rights.is_allowed("bob", verb="start", starter="a")
    assert rights.is_allowed("bob", verb="stop", starter="b")
    assert not rights.is_allowed("bob", verb="start", starter="b")


def test_the_entries_that_give_a_right_say_what_proves_it_fresh() -> None:
    rights = Rights(
        [
            Operator("alice", ("start",), ("pump-*",), "token"),
            Operator("alice", ("*",), ("*",), "issued_at"),
            Operator("bob", ("*",), ("*",), "token"),
        ]
    )

    assert rights.freshness("alice", verb="start", starter="pump-1") == ("token", "issued_at")
    assert rights.freshness("alice", verb="set", starter="pump-1") == ("issued_at",)
    assert rights.freshness("alice", verb="start", starter="mill") == ("issued_at",)
    assert rights.freshness("carol", verb="start", starter="mill") == ("token",)
