"""A selection is for one client, one command and ten seconds."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.starters.policy.selection import Selection, Selections


def selected(**changes: Any) -> Selections:
    fields = {"token": "t", "client": "alice", "verb": "start", "args": {}, "state": "ready", "until_s": 10.0}
    selections = Selections()
    selections.set("a", Selection(**{**fields, **changes}))
    return selections


def take(selections: Selections, **changes: Any) -> str:
    fields = {"client": "alice", "token": "t", "verb": "start", "args": {}, "now_s": 9.9, **changes}
    client, token = fields.pop("client"), fields.pop("token")
    try:
        selections.take("a", client, token, **fields)
    except CommandError as error:
        return error.code
    return "ok"


def test_a_selection_serves_once() -> None:
    selections = selected()

    assert take(selections) == "ok"
    assert take(selections) == "not_selected"


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"now_s": 10.0}, "selection_expired"),
        ({"verb": "reset"}, "selected_otherwise"),
        ({"args": {"value": 1}}, "selected_otherwise"),
    ],
)
def test_a_selection_serves_only_its_own_command_in_time(changes: dict[str, Any], code: str) -> None:
    selections = selected()

    assert take(selections, **changes) == code
    assert take(selections) == "not_selected"  # used up all the same


@pytest.mark.parametrize("changes", [{"token": "x"}, {"client": "bob"}])
def test_another_token_or_client_neither_uses_nor_ends_a_selection(changes: dict[str, Any]) -> None:
    selections = selected()

    assert take(selections, **changes) == "not_selected"
    assert take(selections) == "ok"


def test_a_starter_is_closed_to_other_clients_while_it_is_selected() -> None:
    selections = selected()

    with pytest.raises(CommandError, match="wait 4 s") as caught:
        selections.check_free("a", "bob", now_s=6.0)
    assert caught.value.code == "selected_by_other"
    selections.check_free("a", "alice", now_s=6.0)
    selections.check_free("a", "bob", now_s=10.0)
    selections.check_free("b", "bob", now_s=6.0)


def test_only_the_one_who_selected_can_cancel() -> None:
    selections = selected()

    for client, now_s in (("bob", 6.0), ("alice", 10.0)):
        with pytest.raises(CommandError, match="has not selected"):
            selections.check_own("a", client, now_s=now_s)
    selections.check_own("a", "alice", now_s=6.0)
    selections.end("a")

    assert take(selections) == "not_selected"
