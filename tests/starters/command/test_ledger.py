"""What is remembered of commands, and what may be forgotten for lack of room."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import Phase, ResultRecord
from gateway.starters.command.ledger import LONGEST_S, Key, Ledger

PROOF_S = 62.0
START, READ, STOP = "start confirmed", "read confirmed", "stop confirmed"
REFUSED, BEGUN = "start rejected", "start accepted"


def result(id_: str | None, what: str) -> ResultRecord:
    """Return a result of Alice's at the pump; `what` is its verb and phase."""
    verb, phase = what.split()
    named: Any = {"starter": "pump", "client": "alice", "id": id_, "verb": verb}
    return ResultRecord(**named, phase=Phase(phase), code="ok", text="", time_s=0.0)


def known_of(*stored: tuple[str, str, float], room: int = 2) -> str:
    """Store results (id, verb and phase, when) in a ledger of two; return the ids that it knows then."""
    gone: list[Key] = []
    times_s = iter([now_s for _, _, now_s in stored])
    ledger = Ledger(now_s=lambda: next(times_s), most_entries=room, on_forgotten=gone.extend)
    for id_, what, _ in stored:
        ledger.store(result(id_, what))
    known = [id_ for id_ in dict.fromkeys(each for each, _, _ in stored) if ledger.find("alice", id_)]
    assert {id_ for _, id_ in gone}.isdisjoint(known)
    return " ".join(known)


@pytest.mark.parametrize(
    ("stored", "known"),
    [
        ([("1", BEGUN, 0), ("1", START, 1)], "1"),
        ([("1", REFUSED, 0), ("2", REFUSED, 0), ("3", REFUSED, 0)], "2 3"),
        ([("1", READ, 0), ("2", READ, 0), ("3", READ, 0)], "2 3"),
        ([("1", STOP, 0), ("2", STOP, 0), ("3", STOP, 0)], "2 3"),
        ([("1", BEGUN, 0), ("2", REFUSED, 1000), ("3", REFUSED, 1000)], "1 3"),  # one under way stays
        ([("1", "read accepted", 0), ("2", REFUSED, 0), ("3", REFUSED, 0)], "1 3"),
        ([("1", START, 0), ("2", REFUSED, 1), ("3", REFUSED, 60), ("4", READ, PROOF_S)], "1 4"),
        ([("1", BEGUN, 0), ("1", REFUSED, 1), ("2", START, 1), ("3", START, 1)], "2 3"),
        ([("1", START, 0), ("2", START, 0), ("3", "stop accepted", 1)], "1 2 3"),  # a stop is always taken
        ([("1", START, 0), ("2", START, 10), ("3", START, PROOF_S + 0.1)], "2 3"),
        ([("1", START, 0), ("1", STOP, 1), ("2", READ, 2), ("3", READ, 2), ("4", READ, 2)], "1 4"),
        ([("1", START, 0), ("2", START, 10), ("3", START, LONGEST_S + 1)], "2 3"),
        ([("1", REFUSED, 0), ("2", REFUSED, LONGEST_S + 1)], "2"),  # though there is room
    ],
)
def test_what_a_copy_could_repeat_is_remembered_and_the_oldest_of_the_rest_is_forgotten(
    stored: list[tuple[str, str, float]], known: str
) -> None:
    assert known_of(*stored) == known


def test_what_was_acted_on_stays_beyond_the_room_until_its_proof_is_over() -> None:
    acted = [(id_, START, now_s) for id_, now_s in (("1", 0.0), ("2", 10.0), ("3", PROOF_S))]

    assert known_of(*acted) == "1 2 3"
    assert known_of(*acted, ("4", START, PROOF_S + 0.1)) == "2 3 4"


def test_an_id_is_its_clients_and_a_stop_without_one_has_no_entry() -> None:
    ledger = Ledger(now_s=lambda: 0.0)
    ledger.store(result("1", START))

    assert ledger.find("bob", "1") is None
    assert not ledger.store(result(None, STOP))


def test_ten_thousand_commands_are_remembered() -> None:
    everything = [(str(number), REFUSED, 0.0) for number in range(10_001)]

    assert known_of(*everything, room=10_000).split() == [id_ for id_, _, _ in everything[1:]]
