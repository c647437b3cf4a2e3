"""How old values get on random lines, some of whose motors run, against what `check` prints; virtual time."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from gateway.app.capacity import STANDING, VALUES, LineCapacity, prospects_of
from gateway.app.plant import Plant
from gateway.app.record_log import log_failure
from gateway.config.convert import policy_of, rights_of, timing_of
from gateway.config.load import parse
from gateway.config.schema import Config
from gateway.history.readings import Readings
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.records import Quality, RecordBus, RecordWriter, StateRecord, ValueRecord
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters.policy.policy import Policy
from gateway.starters.services.services import StarterServices
from gateway.starters.telemetry.polling import IDLE_STATES
from tests.local_host import LocalHost
from tests.plant_rig import HEAD, LINE, RunningPlant, setups
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock

FAMILIES = ("ssw06", "ssw07", "ssw900", "sst")
HANDED_OVER_S = 0.11  # results of polls may wait so long for more
IDENTIFIED_S = 60.0
AT_SPEED_S = 60.0
READING = ReadHoldingRegisters(0, 1)


def random_site(chance: random.Random) -> Config:
    """Return a line of a few starters, some with more to do than there is time for."""
    text = HEAD + LINE.format(name="hall").replace("19200", str(chance.choice((9600, 19200))))
    base_s, is_mixed = chance.choice((0.2, 1.0, 4.0)), chance.random() < 0.5
    for address in range(1, chance.choice((1, 2, 4, 6)) + 1):
        every_s = chance.choice((0.2, 1.0, 5.0)) if is_mixed else base_s
        family = chance.choice(FAMILIES)
        text += f'[[line.starter]]\nname = "m{address}"\naddress = {address}\nfamily = "{family}"\n'
        text += f"every_s = {every_s}\n"
    return parse(text, "site.toml")


def run_locally(unit: Any) -> None:
    """Start a motor at its own keys, and go back to remote."""
    if unit.family == "sst":
        unit.local_start()
        return
    unit._set_remote(is_remote=False)
    unit.keypad_start()
    unit._set_remote(is_remote=True)


@dataclass
class Ages:
    """The oldest that the values of each starter got, by its name and what `check` calls them."""

    plant: Plant = field(init=False)
    oldest_s: dict[tuple[str, str], float] = field(default_factory=dict)
    read_s: dict[tuple[str, str], float] = field(default_factory=dict)

    def note(self, name: str, readings: Readings) -> None:
        starter, now_s = self.plant.starters[name], asyncio.get_running_loop().time()
        for point in readings.values:
            group: str = starter.profile.points[point].group
            if group == VALUES and starter.state in IDLE_STATES:
                group = STANDING
            age_s = now_s - self.read_s.get((name, point), now_s)
            self.oldest_s[name, group] = max(age_s, self.oldest_s.get((name, group), 0.0))
            self.read_s[name, point] = readings.at_s

    def begin(self) -> None:
        self.read_s.clear()
        self.oldest_s.clear()


def slow_unit(family: str, address: int, response_time_s: float) -> SimulatedUnit:
    """Return a starter that takes nearly as long for each reply as it may."""
    unit, chance = make_unit(family, address), random.Random(address)
    unit.response_delay_s = lambda _: chance.uniform(0.7, 0.98) * response_time_s  # type: ignore[method-assign]
    return unit


@pytest.mark.parametrize("seed", range(6))
@virtually
async def test_no_value_gets_older_than_check_says_and_none_on_a_sound_line_is_stale(seed: int) -> None:
    chance = random.Random(seed)
    config = random_site(chance)
    (prospect,), table, ages = prospects_of(config), config.lines[0], Ages()
    here = RunningPlant(config=config)
    units = [
        slow_unit(each.profile.family, each.address, each.response_time_of(READING))
        for each in setups(config)
    ]
    here.buses[table.port] = SimulatedLine(timing_of(table), units, chunk_bytes=None)
    bus = RecordBus(log_failure)
    records = RecordWriter(bus, VirtualClock(asyncio.get_running_loop()))
    names = [each.table.name for each in prospect.starters]
    policy = Policy(policy_of(config), names, rights=rights_of(config), records=records)
    services = StarterServices(monitor_every_s=3600.0)
    bus.connect(policy, services, here.sink)
    ages.plant = Plant(
        publish_event=here.publish_event,
        forget=here.forget,
        policy=policy,
        services=services,
        make_opener=here.opener,
        on_readings=ages.note,
        records=records,
    )
    host = LocalHost(ages.plant.handle)
    ages.plant.build(host, config.lines, here)  # type: ignore[arg-type] # all that is asked of it
    await ages.plant.start()
    await asyncio.sleep(IDENTIFIED_S + 10 * prospect.forecast.sweep_s)
    here.sink.clear()
    for unit in units:
        if chance.random() < 0.5:
            run_locally(unit)
    await asyncio.sleep(AT_SPEED_S + longest_s(prospect))
    ages.begin()
    await asyncio.sleep(4 * longest_s(prospect))

    promised_s = {each.table.name: each.ages_s for each in prospect.starters}
    assert {name for name, _ in ages.oldest_s} == set(names)
    assert too_old(ages.oldest_s, promised_s) == {}
    assert "unknown" not in {record.state for record in here.sink.of(StateRecord)}
    assert Quality.STALE not in {record.quality for record in here.sink.of(ValueRecord)}
    await host.stop()
    await ages.plant.close()
    await services.close()


def longest_s(prospect: LineCapacity) -> float:
    """Return what `check` says of the oldest values of all but the slow rows."""
    return max(age_s for each in prospect.starters for key, age_s in each.ages_s.items() if key != "slow")


def too_old(
    oldest_s: Mapping[tuple[str, str], float], promised_s: Mapping[str, Mapping[str, float]]
) -> dict[tuple[str, str], tuple[float, float]]:
    """Return what got older than promised, with both ages."""
    return {
        (name, group): (age_s, promised_s[name][group])
        for (name, group), age_s in oldest_s.items()
        if age_s > promised_s[name][group] + HANDED_OVER_S
    }
