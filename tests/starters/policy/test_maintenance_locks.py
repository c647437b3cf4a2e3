"""Maintenance locks: what they refuse, who may lift them, what outlives a crash."""

from __future__ import annotations

import asyncio

from gateway.records import AuditRecord, EventRecord, Phase, ResultRecord
from gateway.starters.policy.rights import Operator
from tests.starters.plant import FakeMemory, Plant
from tests.starters.rig import virtually


@virtually
async def test_a_lock_refuses_commands_and_is_published_with_the_state() -> None:
    plant = await Plant().online()

    assert await plant.do("lock", "1", args={"reason": "belt is off"}, operator="Alice A.") == "ok"

    assert plant.locks() == ["alice"]
    assert await plant.do("start", "2", client="bob") == "locked"
    assert "alice (Alice A.): belt is off; this replaces no physical lock" in plant.sink.final("2").text
    assert await plant.do("set", "3", args={"parameter": "P314", "value": 30}) == "locked"
    assert await plant.do("read", "4", args={"parameter": "P003"}) == "ok"
    assert await plant.do("stop", "5") == "ok"
    assert await plant.do("start", "6", starter="pump-2") == "ok"
    assert plant.starts() == 0
    locked = next(event for event in plant.sink.of(EventRecord) if event.code == "locked")
    assert locked.data == {"client": "alice", "operator": "Alice A.", "reason": "belt is off"}


@virtually
async def test_an_unlocked_starter_takes_commands_again() -> None:
    plant = await Plant().online()
    await plant.do("lock", "1", args={"reason": "belt is off"})

    assert await plant.do("unlock", "2", reason="belt is on") == "ok"

    assert plant.locks() == ["alice", None]
    assert await plant.do("start", "3") == "ok"
    decisions = [(a.verb, a.decision) for a in plant.sink.of(AuditRecord) if a.verb in ("lock", "unlock")]
    assert decisions == [
        ("lock", "accepted"),
        ("lock", "confirmed"),
        ("unlock", "accepted"),
        ("unlock", "confirmed"),
    ]


@virtually
async def test_a_lock_outlives_the_gateway_and_stands_before_the_first_command_is_judged() -> None:
    before = await Plant().online()
    await before.do("lock", args={"reason": "belt is off"})

    after = Plant(memory=FakeMemory(before.memory.document))
    after.submit("start", "1")
    await after.online()
    assert await after.do("start", "2") == "locked"

    assert after.starts() == 0
    assert after.policy.motor_history.lock_of("pump-1") is not None


@virtually
async def test_a_lock_comes_before_a_start_that_is_not_yet_written() -> None:
    plant = await Plant().online()
    plant.submit("start", "1", client="bob")
    await asyncio.sleep(0.01)

    plant.submit("lock", "2", args={"reason": "belt is off"})
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "locked"
    assert plant.sink.final("2").code == "ok"
    assert plant.starts() == 0


@virtually
async def test_a_lock_lets_a_reading_under_way_be() -> None:
    plant = await Plant().online()
    plant.submit("read", "1", args={"parameter": "P003"})

    plant.submit("lock", "2", args={"reason": "belt is off"})
    await plant.wait(3.0)

    assert plant.sink.final("1").code == "ok"


@virtually
async def test_another_client_cannot_take_a_lock_over_but_the_same_can_give_another_reason() -> None:
    operators = (Operator("alice", ("*",), ("*",)), Operator("carol", ("*",), ("*",)))
    plant = await Plant(operators=operators).online()
    await plant.do("lock", "1", args={"reason": "belt is off"})

    assert await plant.do("lock", "2", client="carol", args={"reason": "mine"}) == "locked"
    assert await plant.do("lock", "3", args={"reason": "bearing too"}) == "ok"

    lock = plant.policy.motor_history.lock_of("pump-1")
    assert lock is not None
    assert (lock.by, lock.reason) == ("alice", "bearing too")
    assert await plant.do("unlock", "4", client="carol", args={"nonsense": 1}) == "bad_arguments"
    assert await plant.do("unlock", "5", client="carol") == "ok"
    assert await plant.do("unlock", "6") == "not_locked"


@virtually
async def test_a_lock_that_cannot_be_stored_holds_and_an_unlocking_that_cannot_be_stored_does_not() -> None:
    plant = await Plant().online()
    plant.memory.is_away = True

    assert await plant.do("lock", "1", args={"reason": "belt is off"}) == "not_kept"
    assert await plant.do("start", "2") == "locked"
    assert await plant.do("unlock", "3") == "not_kept"
    assert await plant.do("start", "4") == "locked"
    assert {plant.sink.final(id_).phase for id_ in "13"} == {Phase.FAILED}


@virtually
async def test_locking_needs_the_right_to_lock_an_id_and_a_reason() -> None:
    plant = await Plant().online()

    assert await plant.do("lock", "1", client="bob", args={"reason": "x"}) == "not_allowed"
    assert await plant.do("lock", "2") == "bad_arguments"
    plant.submit("lock", None, args={"reason": "x"})

    assert plant.sink.of(ResultRecord)[-1].code == "no_id"
    assert plant.policy.motor_history.lock_of("pump-1") is None


@virtually
async def test_who_removes_anothers_lock_is_named_to_its_owner_and_the_audit_says_whose_it_was() -> None:
    operators = (Operator("alice", ("*",), ("*",)), Operator("carol", ("*",), ("*",)))
    plant = await Plant(operators=operators).online()
    await plant.do("lock", "1", args={"reason": "belt is off"}, operator="Alice A.")
    plant.sink.clear()

    assert await plant.do("unlock", "2", client="carol", args={"reason": "shift ends"}) == "ok"

    lock = {"by": "alice", "operator": "Alice A.", "reason": "belt is off"}
    audit = next(each for each in plant.sink.of(AuditRecord) if each.decision == "confirmed")
    assert (audit.client, audit.before) == ("carol", {"lock": lock})
    event = next(each for each in plant.sink.of(EventRecord) if each.code == "unlocked")
    assert event.data["lock"] == lock
    assert "carol" in event.text
    assert "the lock was alice (Alice A.)'s: belt is off" in event.text
    (notice,) = [each for each in plant.sink.of(ResultRecord) if each.client == "alice"]
    assert (notice.id, notice.verb, notice.code) == (None, "unlock", "lock_removed")
    assert "carol: shift ends" in notice.text
    assert "the lock was alice (Alice A.)'s" in plant.sink.final("2").text


@virtually
async def test_who_removes_his_own_lock_gets_one_result() -> None:
    plant = await Plant().online()
    await plant.do("lock", "1", args={"reason": "belt is off"})
    plant.sink.clear()

    await plant.do("unlock", "2")

    assert {each.id for each in plant.sink.of(ResultRecord)} == {"2"}
