"""What a node says of two starters over two minutes, every kind of message, as a host reads it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

from gateway.sim.core.power import MotorData
from tests.rig import RigPlant
from tests.rig.broker import MqttMessage
from tests.rig.sites import ALICE, SPARKPLUG, SSW07, starter
from tests.rig.sparkplug import SaidMetric, metrics_of
from tests.scenarios.plugins.doors import born, write

PLANT = SSW07 + starter("fan", 2, "ssw06") + ALICE + SPARKPLUG + 'commands = true\noperator = "alice"\n'
SLOW = {"motor": MotorData(ramp_up_s=50.0, full_voltage_s=0.2, ramp_down_s=1.0, coast_s=0.5)}
REBIRTH_S = 100.0  # asked for


@dataclass
class NodeMessage:
    """A message of the node; `sent_ms` is when the server got it, UTC."""

    topic: str
    kind: str
    device: str | None
    qos: int
    retain: bool
    sent_ms: float
    time_ms: int
    seq: int | None
    metrics: list[SaidMetric]
    payload: bytes = field(repr=False)

    @property
    def values(self) -> dict[str, Any]:
        return {each.name: each.value for each in self.metrics}

    def __getitem__(self, name: str) -> SaidMetric:
        return next(each for each in self.metrics if each.name == name)


def connected(*, speaks_5: bool) -> tuple[NodeMessage, NodeMessage, bool]:
    """Return the will and the birth of a connection, and whether it began clean."""
    with RigPlant(PLANT) as plant:
        plant.broker.speaks_5 = speaks_5
        plant.run(until=5.0)
        (node,) = [each for each in plant.broker.connections if each.name.endswith("-spb")]
        assert node.will is not None
        birth = plant.messages(born("NBIRTH"))[-1]
        return _read(plant, node.will), _read(plant, birth), node.is_clean  # type: ignore[attr-defined]


@cache
def said(*, has_datatypes: bool = False) -> list[NodeMessage]:
    """Let the node be born, its starters run, trip, fall silent and return, and the node end."""
    more = "datatypes_in_data = true\n" if has_datatypes else ""
    with RigPlant(PLANT + more, sim={"pump": SLOW, "fan": SLOW}) as plant:
        plant.run(until=5.0)
        line = plant.lines["pumps"]
        plant.command("pump/alice/start")
        plant.command("fan/alice/start")
        plant.run(until=60.0)
        plant.do(lambda: line.lose("pump", for_s=3.5))
        plant.run(until=66.0)
        plant.do(lambda: line.refuse("pump", 2, (6,)))
        plant.do(lambda: line.set_knob("fan", "trip", "E05"))
        plant.run(until=76.0)
        plant.do(lambda: line.silent("fan", for_s=10.0))
        plant.command("pump/alice/lock", args={"reason": "work"})
        plant.run(until=REBIRTH_S)
        write({"Node Control/Rebirth": True}, device="")(plant)
        plant.run(until=120.0)
        plant.end()
        ours = [each for each in plant.messages("spBv1.0/#") if each.topic != born("NCMD")]
        return [_read(plant, each) for each in ours]


def said_of(*kinds: str) -> list[NodeMessage]:
    return [each for each in said() if each.kind in kinds]


def _read(plant: RigPlant, message: MqttMessage) -> NodeMessage:
    levels, said = message.topic.split("/"), message.json
    return NodeMessage(
        message.topic,
        levels[2],
        levels[4] if len(levels) > 4 else None,
        message.qos,
        message.retain,
        1000 * (plant.world.utc_s() - plant.world.now_s() + message.at_s),
        said["timestamp"],
        said.get("seq"),
        metrics_of(message.payload),
        message.payload,
    )
