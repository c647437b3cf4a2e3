"""A power cut at any instant: each result has one end, and nothing that was published is lost or untrue.

What no flush has followed may be missing after it, whole sectors of it, in any choice. A flush is taken for
granted where SQLite makes one: at the end of a transaction with `synchronous` FULL, and before it writes its
log back into the file (sqlite.org/wal.html, sqlite.org/pragma.html). It takes its time, during which lines go
on: what is cut off meanwhile was not flushed.
"""

from __future__ import annotations

import asyncio
import random
import threading
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from gateway.store import Connection, Work
from gateway.store.database import Database, read_file
from tests.rig import RigPlant
from tests.rig.rows import act
from tests.rig.sites import ALICE, QUICK, SSW07
from tests.scenarios.broker.support import HEAL, TRIP
from tests.store.store_rig import THINGS, insert, texts

SECTOR = 512
FULL = 2  # [PRAGMA synchronous]
START = "05 00 64 ff 00"
CUTS = 14
NOTED_S = 6.5  # of a fault: a later run does not take it for a new one
SETTLED_S = 12.0  # after a start: what was cut short has been published
AROUND = ("broker down", "broker up", "broker drops", "broker stalls", "broker goes")
PUBLISHED = ("result/pump/alice", "pump/event")
WRITE_COIL = 5  # [Modbus 6.5]
LONGEST_S = 3.0
FLUSH_S = (0.0, 0.2)
FINAL = ("confirmed", "unconfirmed", "rejected")


class Disk:
    """The files of a state directory as they were flushed, and as they may be after a power cut.

    `flush_s` says how long the next flush takes.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, flush_s: Callable[[], float] = lambda: 0.0) -> None:
        self._flushed: dict[Path, tuple[bytes, bytes]] = {}  # database and log
        open_, transact = Database.open, Database.transact

        def opened(database: Database) -> None:
            open_(database)
            self._flush(database.path)

        def transacted(database: Database, works: Iterable[Work], *, is_flushed: bool = True) -> list[Any]:
            used: list[Connection] = []

            def note(work: Work, connection: Connection) -> Any:
                used.append(connection)
                return work(connection)

            def watched() -> Iterator[Work]:
                for work in works:
                    yield partial(note, work)

            answers = transact(database, watched(), is_flushed=is_flushed)
            is_full = bool(used) and used[0].execute("PRAGMA synchronous").fetchone() == (FULL,)
            file, _ = self._flushed.get(database.path, (b"", b""))
            if is_full:
                threading.Event().wait(flush_s())
            if is_full or file != _content(database.path):
                self._flush(database.path)
            return answers

        monkeypatch.setattr(Database, "open", opened)
        monkeypatch.setattr(Database, "transact", transacted)

    def cut(self, dice: random.Random) -> dict[Path, bytes]:
        """Return what is in the files now: what was flushed, and of the rest what chance leaves."""
        share = dice.choice((0.0, 0.5, 0.9, 1.0))
        files: dict[Path, bytes] = {}
        for path, (flushed, flushed_log) in self._flushed.items():
            files[path], log = _content(path), _content(_log_of(path))
            files[_log_of(path)] = log
            if files[path] == flushed and log != flushed_log:  # else the log was flushed to be written back
                files[_log_of(path)] = _torn(flushed_log, log, share, dice)
        self._flushed.clear()
        return files

    def _flush(self, path: Path) -> None:
        self._flushed[path] = (_content(path), _content(_log_of(path)))


def _log_of(path: Path) -> Path:
    return path.with_name(f"{path.name}-wal")


def _content(path: Path) -> bytes:
    return path.read_bytes() if path.exists() else b""


def _torn(flushed: bytes, written: bytes, share: float, dice: random.Random) -> bytes:
    """Return what may be there of a file: each sector as it was written since the flush, or as before."""
    size = max(len(flushed), len(written))
    before, after = flushed.ljust(size, b"\0"), written.ljust(size, b"\0")
    sectors = bytearray()
    for at in range(0, size, SECTOR):
        sectors += (after if dice.random() < share else before)[at : at + SECTOR]
    return bytes(sectors[: dice.choice((len(flushed), len(written), size))])


class Watched(list[Any]):
    """A list that says what is appended."""

    on_append: Callable[[Any], None] = staticmethod(lambda _: None)

    def append(self, each: Any) -> None:
        super().append(each)
        self.on_append(each)


class Story:
    """One gateway whose power is cut again and again, and what it has published."""

    def __init__(self, plant: RigPlant, disk: Disk, dice: random.Random) -> None:
        self.plant = plant
        self.disk = disk
        self.dice = dice
        self.log = plant.broker.log = Watched(plant.broker.log)
        self.asked = plant.starter("pump").asked = Watched(plant.starter("pump").asked)

    def wait(self, seconds: float) -> None:
        self.plant.run(until=self.plant.world.now_s() + seconds)

    def finals(self, since: int = 0, **fields: Any) -> set[tuple[str, str, float]]:
        """Return the ends that were published, each once however often its message came."""
        found = [
            each.json for each in self.plant.broker.log[since:] if each.topic.endswith("result/pump/alice")
        ]
        return {
            (each["phase"], each["code"], each["time"])
            for each in found
            if each["phase"] in FINAL and not each["duplicate"] and fields.items() <= each.items()
        }

    def starts(self) -> int:
        return [pdu for _, pdu in self.plant.starter("pump").writes].count(START)

    def cut(self) -> None:
        """Cut the power at some time, or a moment after something was written or published."""
        match self.dice.choice(("time", "written", "published", "published")):
            case "written":
                self._until(self.asked, lambda each: each[1][0] == WRITE_COIL)
            case "published":
                self._until(self.log, lambda each: each.topic.endswith(self.dice.choice(PUBLISHED)))
            case _:
                self.wait(self.dice.choice((0.0, 0.02, 0.1, 0.5, 3.0)) * self.dice.random())
        for _ in range(self.dice.choice((0, 1, 3, 40))):
            self.plant.await_(asyncio.sleep(0))
        files = self.disk.cut(self.dice)
        self.plant.kill()
        for path, content in files.items():
            path.with_name(f"{path.name}-shm").unlink(missing_ok=True)
            path.write_bytes(content)
        self.plant.start()

    def _until(self, watched: Watched, is_it: Callable[[Any], bool]) -> None:
        """Let everything go on until such a thing is appended, or for a while."""
        found = self.plant.loop.create_future()

        def end(each: Any = None) -> None:
            if not found.done() and (each is None or is_it(each)):
                found.set_result(None)

        watched.on_append = end
        self.plant.loop.call_later(LONGEST_S, end)
        self.plant.await_(found)
        watched.on_append = lambda _: None

    def heal(self) -> None:
        """Let the broker be there, and answer."""
        self.plant.broker.ack_after_s = 0.0
        act(self.plant, "broker goes")
        act(self.plant, "broker up")

    def start(self, number: int) -> None:
        """Cut the power around a start; ask what became of it, and then once more."""
        id_, frames, since = f"start-{number}", self.starts(), len(self.plant.broker.log)
        self.plant.command("pump/alice/start", id=id_)
        self.cut()
        if self.dice.random() < 0.3:
            self.cut()
        self.heal()
        self.wait(SETTLED_S)
        frames = self.starts() - frames
        published = self.finals(since, id=id_)
        assert frames <= 1
        assert len(published) <= 1, f"{id_} has several ends: {published}"
        assert published or not frames, f"{id_} was written, and has no end"
        self.plant.command("pump/alice/start", id=id_)
        self.wait(4.0)
        answer = self.plant.last("result/pump/alice")
        if published:
            (end,) = published
            assert answer["duplicate"], f"{id_} was forgotten: {published}, then {answer}"
            assert (answer["phase"], answer["code"]) == end[:2]
            assert end[0] != "rejected" or not frames, f"{id_} was written, and published as {end}"
            assert end[0] != "confirmed" or frames == 1, f"{id_} was not written, and published as {end}"

    def stop(self, id_: str | None) -> None:
        """Cut the power around a stop."""
        since = len(self.plant.broker.log)
        self.plant.command("pump/alice/stop", id=id_)
        self.cut()
        self.heal()
        self.wait(SETTLED_S)
        published = self.finals(since, verb="stop", id=id_)
        late = {each for each in published if each[1] == "crashed"}  # its end did not wait for the disk
        assert max(len(late), len(published - late)) <= 1, f"a stop has several ends: {published}"

    def trip(self) -> None:
        """Cut the power around a trip, which stands until the next run has seen it."""
        before, is_lasting = len(self.faults()), self.dice.random() < 0.5
        act(self.plant, TRIP)
        self.wait(NOTED_S if is_lasting else 0.0)
        self.cut()
        self.heal()
        self.wait(SETTLED_S)
        act(self.plant, HEAL)
        self.wait(3.0)
        published = len(self.faults()) - before
        assert published == 1 or (published == 2 and not is_lasting), (
            f"a trip was published {published} times"
        )

    def faults(self) -> set[bytes]:
        """Return the events of trips, each once however often it came."""
        found = self.plant.messages("starter/pump/event")
        return {each.payload for each in found if each.json["code"] == "fault"}


@pytest.mark.parametrize("seed", range(6))
def test_a_power_cut_at_any_instant(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    dice = random.Random(seed)
    slow = random.Random(seed)
    disk = Disk(monkeypatch, lambda: slow.choice(FLUSH_S))
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}, seed=seed) as plant:
        story = Story(plant, disk, dice)
        story.wait(4.0)
        for number in range(CUTS):
            plant.broker.ack_after_s = dice.choice((0.0, 0.0, 0.05, 1.0, None))
            act(plant, dice.choice(AROUND))
            story.wait(dice.choice((0.0, 0.3, 2.0)))
            match dice.randrange(4):
                case 0 | 1 if plant.broker.is_up and not plant.broker.is_stalled:
                    story.start(number)
                case 2 if plant.broker.is_up and not plant.broker.is_stalled:
                    story.stop(dice.choice((None, f"stop-{number}")))
                case _:
                    story.trip()
            story.heal()
            story.wait(6.0)
            plant.command("pump/alice/stop")
            story.wait(4.0)
        story.wait(30.0)

        assert plant.last("gateway/outbox")["depth"] == 0


def test_what_no_flush_has_followed_may_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk, left = Disk(monkeypatch), set()
    for seed in range(8):
        path = tmp_path / str(seed)
        database = Database(path, THINGS, max_bytes=2**20)
        database.open()
        for text in ("flushed", "not flushed"):
            database.transact([insert(text)], is_flushed=text == "flushed")
        files = disk.cut(random.Random(seed))
        database.close()
        for name, content in files.items():
            name.write_bytes(content)
        left.add(tuple(read_file(path, THINGS, texts)))

    assert left == {("flushed",), ("flushed", "not flushed")}
