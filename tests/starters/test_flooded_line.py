"""A flood of reads on a line with a starter of each family, in virtual time: polls and stops go on."""

from __future__ import annotations

import asyncio
from collections import Counter, defaultdict
from itertools import pairwise

from gateway.families.profile.load import FAMILIES
from gateway.line.rtu.outcome import Outcome
from gateway.records import ResultRecord
from tests.starters.four_starters import Site, site
from tests.starters.rig import virtually

CALM_S, FLOOD_S = 20.0, 40.0
EVERY_S = 1.0  # of the status
PARAMETERS = {"ssw06": "P003", "ssw07": "P003", "ssw900": "S1.1.4", "sst": "R6"}
LONGEST_TRANSACTION_S = 0.15  # of the polls of these four, at 19200 bit/s


class Watch:
    """Notes when each poll is answered."""

    def __init__(self, here: Site) -> None:
        self.times_s: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
        for name, telemetry in here.telemetries.items():
            self._listen(name, telemetry)

    def _listen(self, name: str, telemetry: object) -> None:
        on_poll = telemetry.on_poll  # type: ignore[attr-defined]  # of a StarterTelemetry

        def note(key: str, outcome: Outcome) -> None:
            self.times_s[name, key].append(asyncio.get_running_loop().time())
            on_poll(key, outcome)

        telemetry.on_poll = note  # type: ignore[attr-defined]

    def rates(self, since_s: float, until_s: float) -> dict[tuple[str, str], float]:
        return {
            key: sum(since_s <= at_s < until_s for at_s in times_s) / (until_s - since_s)
            for key, times_s in self.times_s.items()
        }

    def longest_gap_s(self, since_s: float) -> float:
        """Return the longest gap of any status poll."""
        return max(
            b - a
            for key, times_s in self.times_s.items()
            if "status" in key[1]
            for a, b in pairwise(at_s for at_s in times_s if at_s >= since_s)
        )


async def flood(here: Site, seconds: float) -> None:
    """Read parameters as fast as the gateway takes them, from every starter."""
    for number in range(int(seconds * 80)):
        family = FAMILIES[number % 4]
        here.submit(family, "read", f"{number}", parameter=PARAMETERS[family])
        await asyncio.sleep(1 / 80)


@virtually
async def test_a_flood_of_reads_costs_the_polls_nothing_and_what_is_too_much_is_refused() -> None:
    async with site() as here:
        watch, began_s = Watch(here), asyncio.get_running_loop().time()
        await asyncio.sleep(CALM_S)
        flooded_s = asyncio.get_running_loop().time()

        await flood(here, FLOOD_S)

        ended_s = asyncio.get_running_loop().time()
        calm, now = watch.rates(began_s, flooded_s), watch.rates(flooded_s, ended_s)
        frequent = {key: rate for key, rate in calm.items() if rate >= 0.5}
        assert frequent
        assert all(now[key] >= 0.9 * rate for key, rate in frequent.items()), (frequent, now)
        assert watch.longest_gap_s(flooded_s) < 2 * EVERY_S
        codes = Counter(each.code for each in here.sink.of(ResultRecord) if each.phase.is_final)
        assert codes["ok"] > 100
        assert codes["too_many"] + codes["busy"] > 0
        assert set(codes) <= {"ok", "too_many", "busy"}


@virtually
async def test_a_stop_in_the_flood_goes_out_before_all_reads() -> None:
    async with site() as here:
        flooding = asyncio.create_task(flood(here, 35.0))
        unit = here.unit("ssw07")
        for number in range(15):
            await asyncio.sleep(1.13)
            asked_s, before = asyncio.get_running_loop().time(), len(unit.writes)
            here.submit("ssw07", "stop", f"stop {number}")
            await asyncio.sleep(1.0)

            assert unit.writes[before].at_s - asked_s <= LONGEST_TRANSACTION_S
        await flooding
