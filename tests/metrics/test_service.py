"""The text of a scrape, made once a second at most, and the file for node-exporter."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gateway.metrics.scrape import MetricsSettings, ScrapedGateway
from gateway.metrics.service import WRITE_EVERY_S, MetricsService
from gateway.records import StartRecord
from tests.metrics.support import Scrape, here, scraped_gateway, scraped_starter
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock


class CountingSource:
    """Counts how often it is read."""

    def __init__(self) -> None:
        self.reads = 0

    def scraped(self) -> ScrapedGateway:
        self.reads += 1
        return scraped_gateway(scraped_starter())


class Service:
    """A service with what is around it."""

    def __init__(self, textfile: Path | None = None, in_thread: Any = here) -> None:
        self.source = CountingSource()
        self.troubles: list[str] = []
        self.service = MetricsService(
            MetricsSettings(textfile=textfile),
            self.source,
            VirtualClock(asyncio.get_running_loop()),
            verbs=frozenset(),
            on_trouble=self.troubles.append,
            in_thread=in_thread,
        )


@virtually
async def test_one_text_serves_all_scrapes_of_a_second() -> None:
    rig = Service()

    texts = await asyncio.gather(*(rig.service.text() for _ in range(20)))
    await asyncio.sleep(1.0)
    await rig.service.text()

    assert len(set(texts)) == 1
    assert rig.source.reads == 2


@virtually
async def test_other_settings_take_effect_with_the_next_scrape() -> None:
    rig = Service()
    await rig.service.text()

    rig.service.move(MetricsSettings(has_all_points=True))

    assert "point_value" in Scrape(await rig.service.text()).types


@virtually
async def test_while_a_text_is_made_nothing_else_waits_and_a_second_scrape_makes_no_second_one() -> None:
    going_on = asyncio.Event()

    async def slow(work: Callable[[], Any], /) -> Any:
        await going_on.wait()
        return work()

    rig = Service(in_thread=slow)
    scrapes = [asyncio.create_task(rig.service.text()) for _ in range(3)]
    await asyncio.sleep(0.5)
    rig.service.put(StartRecord("pump-1", "s", {}))
    assert rig.source.reads == 1

    going_on.set()

    assert [Scrape(text).one("starts_total") for text in await asyncio.gather(*scrapes)] == [0.0] * 3


def names_in(folder: Path) -> list[str]:
    return [each.name for each in folder.iterdir()]


def file_of(path: Path) -> os.stat_result:
    return path.stat()


def run_with_file(tmp_path: Path, scenario: Callable[[Service, Path], Any], name: str = "sg.prom") -> None:
    @virtually
    async def run() -> None:
        path = tmp_path / name
        rig = Service(path)
        task = asyncio.create_task(rig.service.run())
        await asyncio.sleep(1.0)
        await scenario(rig, path)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert not path.exists(), "node-exporter would go on serving it"

    run()


def test_a_reader_sees_a_whole_file_whenever_it_looks(tmp_path: Path) -> None:
    async def scenario(rig: Service, path: Path) -> None:
        with path.open("rb") as before:
            await asyncio.sleep(WRITE_EVERY_S)
            assert os.fstat(before.fileno()).st_ino != file_of(path).st_ino  # another file took its place
            assert Scrape(before.read()).one("build_info") == 1.0

    run_with_file(tmp_path, scenario)


def test_another_name_takes_the_first_files_place(tmp_path: Path) -> None:
    async def scenario(rig: Service, path: Path) -> None:
        other = tmp_path / "other.prom"
        rig.service.move(MetricsSettings(textfile=other))
        await asyncio.sleep(1.0)
        assert names_in(tmp_path) == ["other.prom"]
        rig.service.move(MetricsSettings())
        await asyncio.sleep(1.0)
        assert names_in(tmp_path) == []

    run_with_file(tmp_path, scenario)


def test_a_text_that_was_on_its_way_to_the_disk_at_the_end_does_not_come_back(tmp_path: Path) -> None:
    late: list[Callable[[], Any]] = []

    async def to_a_slow_disk(work: Callable[[], Any], /) -> Any:
        if work.__name__ == "replace":
            late.append(work)
            await asyncio.Event().wait()
        return work()

    @virtually
    async def run() -> None:
        rig = Service(tmp_path / "sg.prom", to_a_slow_disk)
        task = asyncio.create_task(rig.service.run())
        await asyncio.sleep(1.0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    run()
    for work in late:
        work()

    assert late
    assert list(tmp_path.iterdir()) == []
