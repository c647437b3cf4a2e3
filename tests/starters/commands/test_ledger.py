from __future__ import annotations

from collections.abc import Sequence

import pytest

from gateway.records import Phase, ResultRecord
from gateway.starters.commands.ledger import LONGEST_S, Key, Ledger

PROOF_S = 62.0


def result(
    id_: str | None, phase: Phase = Phase.CONFIRMED, *, client: str = "alice", verb: str = "start"
) -> ResultRecord:
    return ResultRecord("pump-1", client, id_, verb, phase, "ok", "", 0.0)


def test_an_unknown_id_is_not_found() -> None:
    assert Ledger().find("alice", "1") is None


def test_the_latest_result_of_a_command_is_found() -> None:
    ledger = Ledger()
    ledger.store(result("1", Phase.ACCEPTED), now_s=0.0)

    ledger.store(result("1", Phase.CONFIRMED), now_s=1.0)

    found = ledger.find("alice", "1")
    assert found is not None
    assert found.phase is Phase.CONFIRMED
    assert len(ledger) == 1


def test_the_same_id_of_another_client_is_another_command() -> None:
    ledger = Ledger()
    ledger.store(result("1"), now_s=0.0)

    assert ledger.find("bob", "1") is None


def test_a_result_without_an_id_is_not_stored() -> None:
    ledger = Ledger()

    ledger.store(result(None), now_s=0.0)

    assert len(ledger) == 0
    assert ledger.find("alice", None) is None


@pytest.mark.parametrize(
    ("phase", "verb"),
    [(Phase.REJECTED, "start"), (Phase.CONFIRMED, "read"), (Phase.CONFIRMED, "stop")],
)
def test_the_oldest_entry_that_did_nothing_goes_when_there_are_too_many(phase: Phase, verb: str) -> None:
    ledger = Ledger(most_entries=2)

    for id_ in ("1", "2", "3"):
        ledger.store(result(id_, phase, verb=verb), now_s=0.0)

    assert ledger.find("alice", "1") is None
    assert ledger.find("alice", "2") is not None
    assert len(ledger) == 2


@pytest.mark.parametrize("verb", ["start", "read"])
def test_a_command_under_way_is_not_forgotten_for_lack_of_room(verb: str) -> None:
    ledger = Ledger(most_entries=2)
    ledger.store(result("1", Phase.ACCEPTED, verb=verb), now_s=0.0)

    for id_ in ("2", "3"):
        ledger.store(result(id_, Phase.REJECTED), now_s=1000.0)

    assert ledger.find("alice", "1") is not None
    assert ledger.find("alice", "2") is None


def test_what_was_acted_on_outlasts_any_number_of_others_while_a_copy_could_still_be_fresh() -> None:
    ledger = Ledger(most_entries=100)
    ledger.store(result("start"), now_s=0.0)

    for number in range(10_600):
        ledger.store(result(f"{number}", Phase.REJECTED), now_s=PROOF_S * number / 10_600)

    assert ledger.find("alice", "start") is not None
    assert len(ledger) == 100


def test_a_command_that_was_accepted_and_then_refused_goes_like_any_refused_one() -> None:
    ledger = Ledger(most_entries=2)
    ledger.store(result("1", Phase.ACCEPTED), now_s=0.0)
    ledger.store(result("1", Phase.REJECTED), now_s=1.0)

    for id_ in ("2", "3"):
        ledger.store(result(id_), now_s=1.0)

    assert ledger.find("alice", "1") is None


def test_a_ledger_full_of_what_was_acted_on_has_no_room_until_the_first_proof_is_over() -> None:
    ledger = Ledger(most_entries=2)
    ledger.store(result("1"), now_s=0.0)
    ledger.store(result("2"), now_s=10.0)

    assert not ledger.has_room(PROOF_S)
    assert ledger.has_room(PROOF_S + 0.1)
    ledger.store(result("3"), now_s=PROOF_S + 0.1)
    assert [ledger.find("alice", id_) is None for id_ in ("1", "2", "3")] == [True, False, False]


def test_a_full_ledger_still_takes_a_stop_and_forgets_nothing_for_it() -> None:
    ledger = Ledger(most_entries=2)
    for id_ in ("1", "2"):
        ledger.store(result(id_), now_s=0.0)

    ledger.store(result("3", Phase.ACCEPTED, verb="stop"), now_s=1.0)

    assert all(ledger.find("alice", id_) is not None for id_ in ("1", "2", "3"))


def test_an_entry_is_forgotten_after_seven_days_of_this_run() -> None:
    ledger = Ledger()
    ledger.store(result("old"), now_s=0.0)
    ledger.store(result("young"), now_s=10.0)

    ledger.store(result("new"), now_s=LONGEST_S + 1.0)

    assert ledger.find("alice", "old") is None
    assert ledger.find("alice", "young") is not None


def test_ten_thousand_commands_are_remembered() -> None:
    ledger = Ledger()

    for number in range(10_001):
        ledger.store(result(str(number), Phase.REJECTED), now_s=0.0)

    assert len(ledger) == 10_000
    assert ledger.find("alice", "0") is None
    assert ledger.find("alice", "1") is not None


def test_everything_that_did_nothing_may_be_forgotten_at_once() -> None:
    ledger = Ledger(most_entries=0)

    ledger.store(result("1", Phase.REJECTED), now_s=0.0)

    assert len(ledger) == 0


def test_who_keeps_it_on_the_disk_learns_what_is_forgotten() -> None:
    gone: list[Key] = []

    def note(keys: Sequence[Key]) -> None:
        gone.extend(keys)

    ledger = Ledger(most_entries=1, on_forgotten=note)
    for id_ in ("1", "2", "3"):
        ledger.store(result(id_, Phase.REJECTED), now_s=0.0)

    assert gone == [("alice", "1"), ("alice", "2")]


def test_a_stop_under_the_id_of_a_start_does_not_push_the_start_out() -> None:
    ledger = Ledger(most_entries=2)
    ledger.store(result("1"), now_s=0.0)
    ledger.store(result("1", verb="stop"), now_s=1.0)

    for id_ in ("2", "3", "4"):
        ledger.store(result(id_, verb="read"), now_s=2.0)

    found = ledger.find("alice", "1")
    assert found is not None
    assert found.verb == "start"
