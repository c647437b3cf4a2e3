"""What a kill between the history's file and the broker leaves: nothing unpublished, nothing taken back."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path

from gateway.app.history import HistoryService
from gateway.app.history.delivery import HELD_AT_MOST_S, MOST_MARKS, UNDELIVERED
from gateway.records import (
    EventRecord,
    Record,
    RecordWriter,
    Severity,
    StartRecord,
    ValueRecord,
)
from gateway.storage.history import HistoryStore, read_history
from tests.history.memory_file import MemoryFile
from tests.history.support import AnalyticStart, ReadMotor
from tests.plant_rig import setups, site
from tests.starters.fakes import RecordingSink
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock

BETWEEN_S = 100.0


class SlowFile(MemoryFile):
    """A file whose transactions end when `commit` is called."""

    def __init__(self) -> None:
        super().__init__()
        self._waiting: list[Callable[[], None]] = []

    def when_stored(self, call: Callable[[], None]) -> None:
        self._waiting.append(call)

    def commit(self) -> None:
        waiting, self._waiting = self._waiting, []
        for call in waiting:
            call()


class Run:
    """One run of the history, with what it publishes and what it publishes again."""

    def __init__(self, file: MemoryFile, boot: str) -> None:
        self.sink = RecordingSink()
        self.again: list[Record] = []
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.service = HistoryService(
            Path("state"),
            setups(site()),
            boot=boot,
            records=RecordWriter(self.sink, self.clock),
            publish_event=lambda *_: None,
            publish_again=self._publish_again,
            make_file=lambda *_: file,
        )
        self.service.start()
        self._starts = 0

    def start(self) -> None:
        """Let the pump start."""
        motor = ReadMotor(AnalyticStart(20.0), is_ours=True, seed=self._starts)
        late_s = self._starts * BETWEEN_S
        for each in motor.replies(0.0, 40.0):
            moved = each._replace(at_s=each.at_s + late_s, time_s=each.time_s + late_s)
            self.service.take_readings("pump", moved)
        self._starts += 1

    async def trip(self) -> None:
        """Let the pump trip, and wait until its record is made."""
        now_s = self.clock.now_s()
        data = {"alarm": "e05", "from": "running"}
        self.service.put(EventRecord("pump", "fault", Severity.ERROR, "Motor overload", now_s, 77, data))
        await asyncio.sleep(20.0)

    def counts(self) -> list[object]:
        return [each.value for each in self.sink.values("starts_total") if each.value is not None]

    def _publish_again(self, records: Sequence[Record]) -> None:
        self.again += records


@virtually
async def test_neither_a_start_nor_its_count_is_published_before_the_file_has_the_start() -> None:
    file = SlowFile()
    run = Run(file, "boot-1")
    await run.service.loaded()
    run.start()
    await asyncio.sleep(0.5)

    before = run.sink.of(StartRecord), run.counts()
    file.commit()

    assert before == ([], [0])
    assert len(run.sink.of(StartRecord)) == 1
    assert run.counts() == [0, 1]
    seqs = [each.seq for each in run.sink.of(ValueRecord) if each.point == "starts_total"]
    assert seqs == sorted(seqs)


@virtually
async def test_a_second_start_waits_for_its_own_transaction() -> None:
    file = SlowFile()
    run = Run(file, "boot-1")
    await run.service.loaded()
    run.start()
    await asyncio.sleep(0.1)
    run.start()  # its transaction has not been handed over when that of the first ends
    file.commit()

    first = run.counts()
    await asyncio.sleep(0.1)
    file.commit()

    assert first[-1] == 1
    assert run.counts()[-1] == 2
    assert len(run.sink.of(StartRecord)) == 2


@virtually
async def test_a_disk_that_hangs_delays_a_start_by_two_seconds_at_most() -> None:
    run = Run(SlowFile(), "boot-1")
    await run.service.loaded()
    run.start()
    await asyncio.sleep(HELD_AT_MOST_S + 0.1)

    assert len(run.sink.of(StartRecord)) == 1


@virtually
async def test_a_run_does_not_publish_its_own_starts_again_when_it_reads_the_file_late() -> None:
    file = MemoryFile()
    run = Run(file, "boot-1")
    await run.service.loaded()
    run.start()
    run.service.follow([], changed=())
    run.service.follow(setups(site()), changed=())
    await run.service.loaded()

    assert run.again == []


@virtually
async def test_a_mark_without_its_curve_goes_and_marks_are_bounded() -> None:
    file = MemoryFile()
    first = Run(file, "boot-1")
    await first.service.loaded()
    for _ in range(MOST_MARKS + 5):
        first.start()
    await asyncio.sleep(0.1)
    for key in [key for key in file.rows if key[1] == "curve"][:1]:
        del file.rows[key]

    second = Run(file, "boot-2")
    await second.service.loaded()

    assert len(second.again) == MOST_MARKS - 1
    assert len(file.of("pump", UNDELIVERED)) == MOST_MARKS - 1


async def test_a_mark_is_stored_with_its_start_and_goes_when_it_was_delivered(tmp_path: Path) -> None:
    sink = RecordingSink()
    clock = VirtualClock(asyncio.get_running_loop())
    service = HistoryService(
        tmp_path,
        setups(site()),
        boot="boot-1",
        records=RecordWriter(sink, clock),
        publish_event=lambda *_: None,
        make_file=lambda path, on_news: HistoryStore(path, on_news=on_news, collect_s=0.0),
    )
    service.start()
    await service.loaded()
    for readings in ReadMotor(AnalyticStart(20.0), is_ours=True).replies(0.0, 40.0):
        service.take_readings("pump", readings)
    await service.flushed()
    kinds = [row.kind for row in read_history(tmp_path, "pump")]
    service.delivered(sink.of(StartRecord)[0].key)
    await service.close()

    assert kinds.count("start") == kinds.count(UNDELIVERED) == 1
    assert UNDELIVERED not in [row.kind for row in read_history(tmp_path, "pump")]
