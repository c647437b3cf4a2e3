from __future__ import annotations

from gateway.starters.ledger import LONGEST_S, Ledger
from gateway.starters.records import Phase, ResultRecord


def result(id_: str | None, phase: Phase = Phase.CONFIRMED, *, client: str = "alice") -> ResultRecord:
    return ResultRecord("pump-1", client, id_, "start", phase, "ok", "", 0.0)


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


def test_a_result_without_an_id_is_not_kept() -> None:
    ledger = Ledger()

    ledger.store(result(None), now_s=0.0)

    assert len(ledger) == 0
    assert ledger.find("alice", None) is None


def test_the_oldest_entry_goes_when_there_are_too_many() -> None:
    ledger = Ledger(most_entries=2)

    for id_ in ("1", "2", "3"):
        ledger.store(result(id_), now_s=0.0)

    assert ledger.find("alice", "1") is None
    assert ledger.find("alice", "2") is not None
    assert len(ledger) == 2


def test_a_command_under_way_is_not_forgotten_for_lack_of_room() -> None:
    ledger = Ledger(most_entries=2)
    ledger.store(result("1", Phase.WRITTEN), now_s=0.0)

    for id_ in ("2", "3"):
        ledger.store(result(id_), now_s=0.0)

    assert ledger.find("alice", "1") is not None
    assert ledger.find("alice", "2") is None


def test_an_entry_is_forgotten_after_seven_days() -> None:
    ledger = Ledger()
    ledger.store(result("old"), now_s=0.0)
    ledger.store(result("young"), now_s=10.0)

    ledger.store(result("new"), now_s=LONGEST_S + 1.0)

    assert ledger.find("alice", "old") is None
    assert ledger.find("alice", "young") is not None


def test_ten_thousand_commands_are_remembered() -> None:
    ledger = Ledger()

    for number in range(10_001):
        ledger.store(result(str(number)), now_s=0.0)

    assert len(ledger) == 10_000
    assert ledger.find("alice", "0") is None
    assert ledger.find("alice", "1") is not None


def test_everything_may_be_forgotten_at_once() -> None:
    ledger = Ledger(most_entries=0)

    ledger.store(result("1"), now_s=0.0)

    assert len(ledger) == 0
