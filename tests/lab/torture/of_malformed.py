"""Malformed payloads: each is refused once, with a reason, and nothing is written."""

from __future__ import annotations

from collections import Counter

from tests.lab.torture.malformed import BIG_EVERY, Mutator
from tests.lab.torture.recorder import is_final
from tests.lab.torture.rig_row import STARTERS, RigScenario
from tests.lab.torture.scenario import Row
from tests.rig import RigPlant

PACE_S = 0.24  # between commands of one client to one starter, so that none is refused as too many
ENDED_S = 5.0  # a read that was accepted is over by then


def malformed(plant: RigPlant, row: Row, count: int, seed: int) -> None:
    """Publish that many, slowly enough for each to get an answer of its own."""
    since_s, fresh = plant.world.now_s(), plant.topic("gateway/fresh")

    def token() -> str:
        newest = next(each for each in reversed(plant.broker.log) if each.topic == fresh)
        return str(newest.json["token"])

    for number, (verb, payload) in enumerate(Mutator(seed, token).payloads(count), 1):
        starter = STARTERS[number % len(STARTERS)]
        plant.publish(f"command/{starter}/alice/{verb}", payload, client="alice")
        if number % len(STARTERS) == 0:
            plant.run(until=plant.world.now_s() + PACE_S)
    plant.run(until=plant.world.now_s() + ENDED_S)
    finals = [each.json for each in plant.messages("result/+/+", since=since_s) if is_final(each.json)]
    wrong = [each for each in finals if each["phase"] != "rejected" or not each["code"] or not each["text"]]
    writes = [write for name in STARTERS for write in plant.starter(name).writes]
    delivered = count - count // BIG_EVERY  # the broker keeps to the largest packet that we take
    codes = Counter(each["code"] for each in finals)
    for is_right, what in (
        (len(finals) == delivered, f"{len(finals)} final results for {delivered} payloads"),
        (not wrong, f"not refused: {wrong[:3]}"),
        (not writes, f"the line was written to: {writes[:3]}"),
        ("too_many" not in codes, f"{codes['too_many']} got no reason of their own"),
    ):
        if not is_right:
            row.failures.append(what)
    row.measurements = dict(codes.most_common())


SCENARIOS = (RigScenario("malformed payloads", malformed, 20_000, 400, "payloads"),)
