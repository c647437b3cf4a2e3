"""Runs scenarios place by place and writes a row for each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from contextlib import AsyncExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gateway.line.capacity.outage import Restart
from tests.lab.torture import of_broker, of_disk, of_kills, of_port, of_process, of_soak, of_stale
from tests.lab.torture.scenario import Much, Place, Row, Scenario
from tests.lab.torture.supervisor import restart_of_unit
from tests.lab.torture.verdict import judge
from tests.lab.torture.world import World, world

SCENARIOS = (
    *of_process.SCENARIOS,
    *of_broker.SCENARIOS,
    *of_soak.SCENARIOS,
    *of_port.SCENARIOS,
    *of_disk.SCENARIOS,
    *of_kills.SCENARIOS,
    *of_stale.SCENARIOS,
)

SHORT_RESTART = Restart(restart_s=0.5, watchdog_s=3.0, abort_s=2.0, start_up_s=2.0)  # a hang ends sooner
PATIENT_RESTART = Restart(restart_s=0.1, watchdog_s=10.0, abort_s=2.0, start_up_s=2.0)


async def run_place(
    place: Place,
    scenarios: Iterable[Scenario],
    *,
    much: Much,
    seed: int,
    count: int | None = None,
    report: Callable[[Row], None],
) -> None:
    """Run the scenarios of one place in one world, with their own counts unless one is given."""
    restart = restart_of_unit() if much is Much.WHOLE else SHORT_RESTART
    if place in (Place.COMMANDS, Place.OLD_MQTT):
        restart = PATIENT_RESTART
    options: dict[str, Any] = {"seed": seed, "outlasts_hang": place is Place.HANG}
    async with AsyncExitStack() as stack:
        made = TemporaryDirectory(prefix=f"torture-{place.value}-", ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(made))
        if place is Place.HANG:
            options["module"] = "tests.lab.torture.blockable"
        if place is Place.PORT:
            options["deaf_after_s"] = of_port.DEAF_AFTER_S
        if place is Place.BROKER:
            options["is_persistent"] = True  # or the recorder would lose what the broker has for it
        if place is Place.OLD_MQTT:
            options["mqtt"] = "3.1.1"
        if place is Place.DISK:
            options["state_dir"] = folder / "disk"
            stack.enter_context(of_disk.small_disk(folder / "disk"))
        here = await stack.enter_async_context(world(folder, restart, **options))
        for each in scenarios:
            report(await _row(here, each, count or each.count(much)))


async def _row(here: World, scenario: Scenario, count: int) -> Row:
    """Run one scenario and judge it."""
    here.failures, here.measurements, here.samples, here.stops_s = [], {}, [], []
    await here.starters.order("mark")
    begun_s = time.monotonic()
    try:
        await scenario.run(here, count)
        await judge(here, begun_s=begun_s, may_trip=scenario.may_trip)
    except TimeoutError as error:
        here.check(False, str(error) or "something never came about")
    took_s = time.monotonic() - begun_s
    return Row(scenario.name, f"{count} {scenario.unit}", here.failures, here.measurements, took_s)
