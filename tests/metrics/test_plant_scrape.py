"""The metrics of four simulated starters of all families: complete, current, and alone with their faults."""

from __future__ import annotations

import asyncio
import builtins
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from gateway.app.integrations.integration import Integration
from gateway.line.scheduler.requests import Priority
from gateway.metrics.catalogue import PREFIX, SPECS, STARTER
from gateway.metrics.scrape import MetricsSource, ScrapedGateway
from gateway.modbus.writes import WriteCoil
from gateway.records import (
    EventRecord,
    LockRecord,
    Phase,
    Record,
    ResultRecord,
    Severity,
    StartRecord,
    TripRecord,
)
from tests.metrics.contrib import expressions, metrics_in
from tests.metrics.promtool import promtool
from tests.metrics.support import METRICS, Scrape, ScrapedPlant, scraped_plant, site_of
from tests.plant_rig import RunningPlant, starter
from tests.starters.fakes import RUN_COIL
from tests.starters.rig import virtually
from tests.virtual_time import run_virtually

ALL_POINTS = f"{METRICS}all_points = true\n"
LONGEST_SLOT_S = 0.25  # of any request on its line
FAN = starter("fan", 2, "ssw06")


def records() -> list[Record]:
    """Return what makes every counter that begins with its first record."""

    def result(phase: Phase, code: str, id_: str) -> ResultRecord:
        return ResultRecord("pump", "alice", id_, "start", phase, code, "", 0.0)

    return [
        result(Phase.ACCEPTED, "ok", "1"),
        result(Phase.CONFIRMED, "ok", "1"),
        result(Phase.REJECTED, "in_local", "2"),
        StartRecord("pump", "s", {}),
        TripRecord("pump", "t", {"code": "e05"}),
        EventRecord("pump", "start_drift", Severity.WARNING, "", 0.0, 1),
    ]


async def stop_pump(rig: RunningPlant) -> None:
    """Write run = 0 as a stop does (SSW-07, 4.2.2)."""
    request = WriteCoil(RUN_COIL, is_on=False)
    await rig.plant.lines["hall"].transact(1, request, response_time_s=0.5, lane=Priority.STOP)


def run_plant(scenario: Callable[[ScrapedPlant], Any], *tables: str, **options: Any) -> None:
    async def run() -> None:
        async with scraped_plant(site_of(*(tables or (METRICS,))), **options) as here:
            await scenario(here)

    run_virtually(run())


def whole_scrape() -> Scrape:
    """Return a scrape of a plant in which a stop was sent and each counter has something to count."""
    scrapes: list[Scrape] = []

    async def scenario(here: ScrapedPlant) -> None:
        here.rig.unit("yard", 1).trip(5)
        for record in records():
            here.integration.put(record)
        await stop_pump(here.rig)
        await asyncio.sleep(30.0)
        scrapes.append(await here.scrape())

    run_plant(scenario, ALL_POINTS)
    return scrapes[0]


@pytest.fixture(scope="module")
def whole() -> Scrape:
    return whole_scrape()


def test_every_metric_of_the_catalogue_is_in_a_scrape_of_the_simulators_plant(whole: Scrape) -> None:
    suffixes = {"histogram": "_count"}

    missing = [name for name, spec in SPECS.items() if not whole.all(name + suffixes.get(spec.kind, ""))]

    assert missing == []


def test_nothing_is_in_a_scrape_that_is_not_in_the_catalogue(whole: Scrape) -> None:
    families = {name + ("_total" if kind == "counter" else "") for name, kind in whole.types.items()}

    assert families - SPECS.keys() == set()
    for name, spec in SPECS.items():
        for sample in (name, f"{name}_bucket", f"{name}_count"):
            for labels, _ in whole.samples.get(sample, ()):
                assert labels.keys() - {"le", "quantile"} == set(spec.labels), sample


def test_every_metric_of_the_alerts_and_the_dashboard_is_in_a_scrape(whole: Scrape) -> None:
    named = set().union(*(metrics_in(each) for each in expressions())) - {"up"}

    assert len(named) > 30
    assert {name for name in named if not whole.all(name.removeprefix(PREFIX))} == set()


def test_promtool_finds_nothing_in_it(whole: Scrape) -> None:
    assert promtool("check", "metrics", standard_input=whole.text) == ""


def test_every_counter_of_every_starter_is_there_from_the_beginning() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        found = await here.scrape()
        of_starters = [name for name, spec in SPECS.items() if set(STARTER) <= set(spec.labels)]
        counters = [name for name in of_starters if SPECS[name].kind == "counter"]

        assert len(counters) == 5
        for each in ("pump", "fan", "mill", "belt"):
            assert [name for name in counters if not found.all(name, starter=each)] == []
        assert found.one("trips_total", starter="pump", code="e05") == 0.0
        assert found.one("trips_total", starter="fan", code="fault") == 0.0

    run_plant(scenario, settled_s=1.0)


def test_a_starter_that_goes_silent_loses_its_values_and_keeps_its_times() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        before = await here.scrape()
        here.rig.unit("hall", 1).power_off()
        await asyncio.sleep(60.0)
        after = await here.scrape()

        assert before.one("starter_online", starter="pump") == 1.0
        assert before.all("motor_current_amperes", starter="pump")
        assert after.one("starter_online", starter="pump") == 0.0
        assert after.all("motor_current_amperes", starter="pump") == []
        assert after.one("starter_state", starter="pump", state="unknown") == 1.0
        assert after.all("starter_fault_active", starter="pump") == []
        last_s = after.one("starter_last_good_reading_timestamp_seconds", starter="pump")
        assert 50.0 < here.rig.records.clock.utc_s() - last_s < 61.0
        assert after.all("motor_current_amperes", starter="belt")

    run_plant(scenario)


def test_a_value_that_does_not_change_is_as_fresh_as_its_last_reading_not_as_its_last_publication() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        await asyncio.sleep(200.0)
        now = await here.scrape()

        last_s = now.one("starter_last_good_reading_timestamp_seconds", starter="pump")
        assert here.rig.records.clock.utc_s() - last_s < 2.0

    run_plant(scenario)


def test_a_lock_is_seen() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        here.locks["fan"] = LockRecord("alice", 0.0, "work")
        found = await here.scrape()

        assert found.one("starter_locked", starter="fan") == 1.0
        assert found.one("starter_locked", starter="pump") == 0.0

    run_plant(scenario)


def test_a_starter_that_a_reload_takes_away_is_gone_with_all_its_series() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        for record in records():
            here.integration.put(replace(record, starter="fan"))  # type: ignore[call-arg, arg-type]
        await here.rig.reload((FAN, ""))
        await asyncio.sleep(5.0)

        assert b'starter="pump"' in (await here.scrape()).text
        assert b"fan" not in (await here.scrape()).text

    run_plant(scenario, ALL_POINTS)


def test_a_reload_switches_the_metrics_on_with_all_that_is_known_and_off_again() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        assert here.integration.service is None
        here.integration.move(site_of(METRICS))
        await asyncio.sleep(0.1)
        found = await here.scrape()
        assert found.all("motor_current_amperes", starter="pump")  # read before the metrics began
        assert found.one("starter_info", starter="pump", family="ssw07") == 1.0

        here.integration.move(site_of())
        await asyncio.sleep(0.1)
        assert here.integration.service is None

    run_plant(scenario, "")


def test_a_reload_changes_the_points_and_the_token() -> None:
    async def scenario(here: ScrapedPlant) -> None:
        assert here.integration.service is not None
        assert here.integration.service.token is None
        here.integration.move(site_of(ALL_POINTS, token="secret"))

        assert here.integration.service.token == "secret"
        assert (await here.scrape()).all("point_value", starter="pump")

    run_plant(scenario)


class Faulty:
    """A source that fails on order."""

    def __init__(self, source: MetricsSource) -> None:
        self._source = source
        self.is_broken = False

    def scraped(self) -> ScrapedGateway:
        if self.is_broken:
            raise ZeroDivisionError("ordered")
        return self._source.scraped()


class Deeds(NamedTuple):
    """What a plant did; of requests at the same instant chance decides which goes first."""

    requests: dict[str, int]  # by "port address"
    pauses_s: dict[str, float]  # the longest between two requests
    records: Counter[str]  # by kind, starter and point
    writes: int
    trips: list[str]


def subject_of(record: Record) -> tuple[str, str]:
    return getattr(record, "starter", ""), getattr(record, "point", "")


def deeds(rig: RunningPlant) -> Deeds:
    requests_s = rig.requests_s.items()
    pauses_s = {unit: max(later - at for at, later in pairwise(times)) for unit, times in requests_s}
    names = [" ".join((type(each).__name__, *subject_of(each))) for each in rig.sink.records]
    requests = {unit: len(times) for unit, times in requests_s}
    return Deeds(requests, pauses_s, Counter(names), rig.writes(), rig.trips())


def what_happened(*, with_metrics: bool, fault: str = "") -> Deeds:
    """Return what a plant did in a minute."""
    seen: list[Deeds] = []
    sources: list[Faulty] = []

    def wrap(source: MetricsSource) -> MetricsSource:
        sources.append(Faulty(source))
        return sources[0]

    async def scenario(here: ScrapedPlant) -> None:
        for _ in range(3):
            await asyncio.sleep(10.0)
            break_it(here.integration, fault)
            sources[0].is_broken = fault == "scrape"
            if fault == "scrape":
                with pytest.raises(ZeroDivisionError):
                    await here.scrape()
            elif fault == "" and with_metrics:
                assert (await here.scrape()).all("motor_current_amperes")
            await stop_pump(here.rig)
        seen.append(deeds(here.rig))

    run_plant(scenario, METRICS if with_metrics else "", wrap=wrap)
    return seen[0]


@pytest.fixture(scope="module")
def without() -> Deeds:
    return what_happened(with_metrics=False)


def break_it(integration: Integration, fault: str) -> None:
    """Let the service fail at the next record, configuration or wake-up."""

    def fail(*_: object) -> None:
        raise ZeroDivisionError("ordered")

    service = integration._service
    if service is None or fault in ("", "scrape"):
        return
    inner: Any = service
    if fault == "put":
        inner._counts.put = fail
    elif fault == "move":
        inner.move = fail
        integration.move(site_of(METRICS))
    elif fault == "run":
        inner._write = fail
        inner._settings = replace(inner._settings, textfile=Path("x.prom"))
        inner._moved.set()


@pytest.mark.parametrize("fault", ["", "scrape", "put", "move", "run"])
def test_lines_and_starters_do_the_same_whatever_fails_in_the_metrics(fault: str, without: Deeds) -> None:
    beside = what_happened(with_metrics=True, fault=fault)

    assert beside.records == without.records
    assert (beside.writes, beside.trips) == (without.writes, [])
    for unit, count in without.requests.items():
        assert abs(beside.requests[unit] - count) <= 1
        assert beside.pauses_s[unit] < without.pauses_s[unit] + LONGEST_SLOT_S


@virtually
async def test_after_a_fault_the_metrics_begin_anew_with_all_that_is_known() -> None:
    async with scraped_plant() as here:
        break_it(here.integration, "put")
        here.integration.put(records()[0])
        assert here.integration.service is None
        await asyncio.sleep(5.0)

        assert (await here.scrape()).all("motor_current_amperes", starter="pump")


def test_without_its_package_it_says_so_once_and_everything_else_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [each for each in sys.modules if each.startswith(("prometheus_client", "gateway.metrics."))]:
        if name not in ("gateway.metrics.scrape", "gateway.metrics.catalogue"):
            monkeypatch.delitem(sys.modules, name)
    imports = builtins.__import__

    def no_prometheus(name: str, *rest: Any) -> Any:
        if name.startswith("prometheus_client"):
            raise ImportError(name)
        return imports(name, *rest)

    monkeypatch.setattr(builtins, "__import__", no_prometheus)

    async def scenario(here: ScrapedPlant) -> None:
        await asyncio.sleep(60.0)
        assert here.events == ["metrics_away"]
        assert here.integration.service is None
        assert len(here.rig.requests_s["hall 1"]) > 60

    run_plant(scenario)


def test_the_gateway_itself_imports_no_prometheus() -> None:
    code = "import sys, gateway.cli.run; print('prometheus_client' in sys.modules)"

    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert found.stdout.strip() == "False"
