"""How exact the records are of motors of one line that start at the same time; virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gateway.records import StartRecord
from gateway.sim.core.start_curve import start_curve
from gateway.starters.commands.dispatcher import Dispatcher
from gateway.starters.policy.request import CommandRequest
from gateway.starters.policy.rights import Operator, Rights
from tests.plant_rig import RunningPlant, running, starter

OVER_S = 60.0
BASE = starter("fan", 2, "ssw06")


@dataclass(frozen=True)
class Deviation:
    """How far one record is from what the motor did, and how far it says that it may be; percent and s."""

    acceleration_s: float
    acceleration_pct: float
    within_s: float
    peak_pct: float
    i2t_pct: float | None
    i2t_within_pct: float | None
    rate_hz: float


async def deviations(count: int, *, is_ours: bool) -> list[Deviation]:
    """Let so many of 16 SSW-07 on one line at 19200 Bd start at once; by commands, or at their keypads."""
    names = {f"motor-{address}": address for address in range(3, 17)} | {"pump": 1}
    table = "".join(starter(name, address, "ssw07") for name, address in names.items() if name != "pump")
    more = [("hall", address, "ssw07") for name, address in names.items() if name != "pump"]
    async with running(60.0, (BASE, BASE + table), more=more) as here:
        chosen = list(names)[:count]
        if is_ours:
            _command(here, chosen)
        else:
            for name in chosen:
                unit = here.unit("hall", names[name])
                unit.advance(asyncio.get_running_loop().time())
                unit.motor.start()
        await asyncio.sleep(OVER_S)
        found = {record.starter: record.data for record in here.sink.of(StartRecord)}
        assert here.trips() == [], "a watchdog has tripped"
        return [_deviation(here, names[name], found[name]) for name in chosen]


def _command(here: RunningPlant, names: list[str]) -> None:
    rights = Rights([Operator("alice", ("*",), ("*",))])
    desk = Dispatcher(here.plant.starters, rights=rights, records=here.records)
    now_s = here.records.clock.now_s()
    for name in names:
        desk.submit(
            CommandRequest(name, "alice", "start", f"c-{name}", {}, received_s=now_s, expires_s=now_s + 5)
        )


def _deviation(here: RunningPlant, address: int, record: Mapping[str, Any]) -> Deviation:
    motor = here.unit("hall", address).motor
    true = start_curve(motor.data)
    off_s = record["acceleration_s"] - motor.start_s
    i2t = record.get("i2t_a2s")
    return Deviation(
        acceleration_s=abs(off_s),
        acceleration_pct=100 * abs(off_s) / motor.start_s,
        within_s=record["resolution_s"],
        peak_pct=100 * abs(record["peak_a"] / motor.start_max_a - 1),
        i2t_pct=None if i2t is None else 100 * abs(i2t / true.i2t_a2s - 1),
        i2t_within_pct=record.get("i2t_error_pct"),
        rate_hz=record["rate_hz"],
    )
