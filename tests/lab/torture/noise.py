"""What a noisy line does to values and commands: nothing false is shown as good, nothing false confirmed."""

from __future__ import annotations

import json
from functools import partial

from gateway.sim.bus.faults import Noisy
from gateway.sim.factory import make_unit
from tests.lab.torture.rig_row import STARTERS, RigScenario
from tests.lab.torture.scenario import Row
from tests.lab.torture.truth import Truth, never_had
from tests.rig import RigPlant

RUN_S, REST_S = 15.0, 165.0  # more starts would trip the overload
BIT_ERRORS = 0.02  # of a corrupted reply
UNDETECTED = 20_000  # one of so many corrupted frames passes a CRC-16 (1 in 51,000 with 1-6 wrong bits)
STARTED = "pump"
MOVING = ("starting", "running", "stopping")


def noise(plant: RigPlant, row: Row, count: int, _seed: int, *, share: float) -> None:
    """Corrupt this share of all replies; start and stop one motor again and again."""
    truths = [
        Truth(each.unit, name, each.unit.family, make_unit(each.unit.family, each.unit.address, seed=address))
        for address, (name, each) in enumerate(plant.lines["pumps"].starters.items(), 1)
    ]
    noisy_s = plant.world.now_s() + 60.0  # until then every point was read once, rightly
    plant.run(until=noisy_s)
    for name in STARTERS:
        plant.lines["pumps"].bus.impair(plant.starter(name).unit.address, Noisy(BIT_ERRORS), chance=share)
    unit, starts, confirmed = plant.starter(STARTED).unit, 0, 0
    while _handled(plant) < count or not starts:
        started, starts = len(unit.starts), starts + 1
        id_ = plant.command(f"{STARTED}/alice/start")
        plant.run(until=plant.world.now_s() + RUN_S)
        phases = [each.json["phase"] for each in plant.messages("result/+/+") if each.json["id"] == id_]
        confirmed += "confirmed" in phases
        if "confirmed" in phases and len(unit.starts) == started:
            row.failures.append(f"{id_} is said to be confirmed, but nothing was started")
        plant.publish(f"command/{STARTED}/alice/stop")
        plant.run(until=plant.world.now_s() + REST_S)
    good = {
        (each.topic.split("/")[-3], each.topic.split("/")[-1], json.dumps(each.json["value"]))
        for each in plant.messages("starter/+/value/+", since=noisy_s)
        if each.json["quality"] == "good"
    }
    false = never_had(good, {truth.name: truth.values for truth in truths})
    moving = {
        each.topic
        for each in plant.messages("starter/+/state", since=noisy_s)
        if each.json["quality"] == "good" and each.json["state"] in MOVING
    }
    violations = plant.lines["pumps"].violations
    for is_right, what in (
        (len(false) <= 1 + share * _handled(plant) / UNDETECTED, f"shown as good, never had: {false[:3]}"),
        (moving <= {plant.topic(f"starter/{STARTED}/state")}, f"shown as moving: {moving}"),
        (len(unit.start_frames) <= starts, f"{len(unit.start_frames)} start frames for {starts} commands"),
        (confirmed > 0, "no start was confirmed"),
        (not violations, f"line violations: {violations[:3]}"),
    ):
        if not is_right:
            row.failures.append(what)
    row.measurements = {"transactions": _handled(plant), "starts": starts, "confirmed": confirmed}
    row.measurements |= {"good values": len(good), "false values": len(false)}


def _handled(plant: RigPlant) -> int:
    return sum(plant.starter(name).unit.handled for name in STARTERS)


SCENARIOS = tuple(
    RigScenario(
        f"errors {share:.0%}".replace("%", " %"), partial(noise, share=share), 100_000, 1_500, "frames"
    )
    for share in (0.01, 0.03, 0.10)
)
