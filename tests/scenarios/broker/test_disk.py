"""The disk fails or is damaged: lines and stops go on, and what waits comes once or is declared."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import Any

import pytest

from gateway.store import Connection, OutboxRow, OutboxTable, Rank, Store
from tests.rig import (
    RigPlant,
    command,
    event,
    frames,
    msg,
    never,
    played,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action, act
from tests.rig.sites import ALICE, QUICK, SSW07
from tests.rig.state import fail_disk, heal_disk
from tests.scenarios.broker.support import HEAL, TRIP

START, STOP = "05 00 64 ff 00", "05 00 64 00 00"


def in_the_way(plant: RigPlant) -> None:
    """Put a file where the state directory should be."""
    (plant.folder / "state").touch()


def out_of_the_way(plant: RigPlant) -> None:
    (plant.folder / "state").unlink()


def overwrite(name: str) -> Action:
    return lambda plant: (plant.folder / "state" / name).write_text("Dear diary, " * 1000)


DISKS = [
    row(
        "without a state directory no start is taken, a stop is, and all is as it was once it can be made",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        before=in_the_way,
        at={
            3.0: [command("pump/alice/start", id="1"), command("pump/alice/stop")],
            6.0: [out_of_the_way, TRIP],
            7.0: HEAL,
            20.0: command("pump/alice/unlock"),  # who may have been locked, is
            21.0: command("pump/alice/start"),
        },
        then={
            6.0: [
                results(
                    "start rejected not_stored",
                    "stop accepted ok",
                    "stop written ok",
                    "stop confirmed ok",
                ),
                frames("pump", STOP),
                event("store_unavailable", severity="error"),
            ],
            20.0: [
                event("store_available", severity="info"),
                seen("starter/pump/event", code="fault", times=1),
            ],
            25.0: [frames("pump", STOP, START), result("start confirmed ok")],
        },
    ),
    row(
        "a disk that fails under way refuses starts, lets stops through, and is used again when it is well",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            5.0: fail_disk,
            6.0: command("pump/alice/start"),
            7.0: command("pump/alice/start"),
            8.0: command("pump/alice/stop"),
            11.0: heal_disk,
            25.0: command("pump/alice/start"),
        },
        then={
            11.0: [
                frames("pump", STOP),
                event("store_unavailable"),
                never("result/pump/alice", verb="start", phase="written"),
            ],
            30.0: [event("store_available"), result("start confirmed ok"), frames("pump", STOP, START)],
        },
    ),
    row(
        "a ledger that was lost is set aside, and a new one begins; who may have been locked, is",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start"),
            6.0: ["end", overwrite("state.sqlite"), "start"],
            10.0: [command("pump/alice/start"), command("pump/alice/stop")],
            14.0: command("pump/alice/unlock"),
            15.0: command("pump/alice/start"),
        },
        then={
            13.0: [
                event("store_lost"),
                seen("result/pump/alice", verb="start", code="locked"),
                frames("pump", START, STOP),
            ],
            18.0: [result("start confirmed ok"), frames("pump", START, STOP, START)],
        },
    ),
    row(
        "ends that the disk has missed are stored once it is well: a later run knows them",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start", id="a start"),
            3.1: fail_disk,
            9.0: command("pump/alice/stop", id="a stop"),
            12.0: heal_disk,
            25.0: ["kill", "start"],
            40.0: command("pump/alice/start", id="a start"),
        },
        then={
            12.0: [
                seen("result/pump/alice", id="a start", phase="confirmed", since=3.1),
                result("stop confirmed ok"),
                event("store_unavailable"),
            ],
            45.0: [
                never("result/pump/alice", code="crashed"),
                msg("result/pump/alice", id="a start", phase="confirmed", duplicate=True),
                frames("pump", START, STOP),
            ],
        },
    ),
    row(
        "an outbox that was lost is declared, and what is new goes out",
        given=SSW07,
        at={
            4.0: "broker down",
            5.0: TRIP,
            7.0: HEAL,
            9.0: ["end", overwrite("state.sqlite"), "start"],
            12.0: TRIP,
            14.0: "broker up",
        },
        then={20.0: [event("store_lost"), seen("starter/pump/event", code="fault", times=1)]},
    ),
]


test_a_disk = played(DISKS)


def test_a_disk_that_is_too_slow_for_a_start_refuses_it_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.store.commands.INTEND_WITHIN_S", 0.0)
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=3.0)
        plant.command("pump/alice/start")
        plant.run(until=6.0)
        plant.command("pump/alice/stop")
        plant.run(until=8.0)

        assert plant.results()[:2] == ["start accepted ok", "start rejected not_stored"]
        assert plant.results()[-1] == "stop confirmed ok"
        assert "store_slow" in plant.events()


class _SlowStore(Store):
    """A store whose disk takes so long for everything."""

    takes_s = 0.0

    def submit(self, work: Callable[[Connection], Any], **how: Any) -> Future[Any]:
        done: Future[Any] = Future()

        def pass_on(found: Future[Any]) -> None:
            if (error := found.exception()) is None:
                done.set_result(found.result())
            else:
                done.set_exception(error)

        def begin() -> None:
            super(_SlowStore, self).submit(work, **how).add_done_callback(pass_on)

        asyncio.get_running_loop().call_later(self.takes_s, begin)
        return done


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[RigPlant]:
    """A plant 6 s after its start; its disk takes `_SlowStore.takes_s` from now on."""
    monkeypatch.setattr("gateway.store.state.Store", _SlowStore)
    monkeypatch.setattr(_SlowStore, "takes_s", 0.0)
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=6.0)
        _SlowStore.takes_s = 0.4
        yield plant


def test_a_command_that_ends_at_once_is_accepted_first(slow: RigPlant) -> None:
    for second in (7.0, 9.0):
        slow.command("pump/alice/select", args={"verb": "start"})
        slow.run(until=second + 1.5)

    assert slow.results() == ["select accepted ok", "select confirmed ok"] * 2


def test_a_repetition_learns_of_no_end_that_a_crash_may_change(slow: RigPlant) -> None:
    slow.command("pump/alice/start", id="once")
    for tenth in range(65, 80):
        slow.run(until=tenth / 10)
        if slow.last("audit")["decision"] == "confirmed":  # not yet on the disk, nor published
            break
    slow.command("pump/alice/start", id="once")
    slow.run(until=slow.world.now_s() + 0.1)
    slow.kill()
    slow.start()
    slow.run(until=20.0)

    assert "start confirmed ok" not in slow.results()
    assert slow.results()[-1] == "start unconfirmed crashed"


@pytest.mark.parametrize("killed_s", [8.5, 9.5])
def test_nothing_of_a_start_is_published_that_a_crash_would_take_back(
    killed_s: float, slow: RigPlant
) -> None:
    _SlowStore.takes_s = 60.0
    for at_s in (6.0, 6.2):
        slow.run(until=at_s)
        slow.command("pump/alice/start", id="once")
    slow.run(until=killed_s)
    first = slow.results()
    slow.kill()
    _SlowStore.takes_s = 0.0
    slow.start()
    slow.run(until=15.0)
    slow.command("pump/alice/start", id="once")
    slow.run(until=20.0)

    assert first == ["start rejected not_stored"] * (killed_s > 9.0)
    assert slow.results()[len(first) :] == ["start accepted ok", "start written ok", "start confirmed ok"]
    assert [pdu for _, pdu in slow.starter("pump").writes] == [START]


def test_a_disk_that_comes_back_after_an_end_adds_nothing_to_it(slow: RigPlant) -> None:
    _SlowStore.takes_s = 4.0
    slow.command("pump/alice/start", id="once")
    slow.run(until=12.0)
    slow.command("pump/alice/start", id="once")
    slow.run(until=17.0)

    assert slow.results() == ["start rejected not_stored"] * 2


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let little fit into memory, so that most of it is on the disk and read back page by page."""
    monkeypatch.setattr("gateway.mqtt.outbox.backlog.WINDOWS", dict.fromkeys(Rank, 8))
    monkeypatch.setattr("gateway.mqtt.outbox.backlog.MOST_VALUES", 5)
    monkeypatch.setattr("gateway.mqtt.outbox.disk_sync.PAGE_ROWS", 7)


@pytest.mark.usefixtures("small_windows")
def test_an_outbox_that_has_filled_the_disk_drains_when_the_broker_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("gateway.store.worker.MAX_BYTES", 60 * 4096)
    amps = [5 * number for number in range(1, 121)]  # by more than a deadband
    with RigPlant(SSW07, seed=1) as plant:
        plant.run(until=4.0)
        act(plant, "broker down")
        for number, amp in enumerate(amps):
            act(plant, HEAL if number % 2 else TRIP)
            act(plant, f"pump P003 = {10 * amp}")
            plant.run(until=6.5 + 2.5 * number)
        act(plant, "broker up")
        plant.run(until=400.0)

        assert "store_unavailable" in plant.events()
        assert plant.events()[-1] == "store_available"
        faults = {
            each.payload for each in plant.messages("starter/pump/event") if each.json["code"] == "fault"
        }
        assert len(faults) == 60
        published = [each.json for each in plant.messages("starter/pump/value/current")]
        for each in plant.messages("starter/pump/history"):
            published += [item for item in each.json["items"] if item["point"] == "current"]
        assert {each["value"] for each in published} >= set(amps)
        assert plant.last("gateway/outbox")["oldest_s"] < 1.0


def test_with_a_broker_no_value_and_no_event_is_written_to_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    written: Counter[Rank] = Counter()  # also what is deleted

    class Watched(OutboxTable):
        def insert(self, connection: Connection, rows: Iterable[OutboxRow]) -> None:
            rows = tuple(rows)
            written.update(row.rank for row in rows)
            super().insert(connection, rows)

        def delete(self, connection: Connection, ids: Iterable[tuple[Rank, int]]) -> None:
            ids = tuple(ids)
            written.update(rank for rank, _ in ids)
            super().delete(connection, ids)

    monkeypatch.setattr("gateway.app.uplink.OutboxTable", Watched)
    with RigPlant(SSW07) as plant:
        plant.run(until=4.0)
        written.clear()
        for second in range(5, 65):
            act(plant, f"pump P003 = {10 * second}")
            plant.run(until=second)
        act(plant, TRIP)
        plant.run(until=70.0)

        assert len(plant.messages("starter/pump/value/current")) > 20
        assert "fault" in plant.events("starter/pump/event")
        assert written.keys() == {Rank.RESULT}  # the trip
