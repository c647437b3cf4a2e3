"""What a scenario does to the wires beyond the rig's faults, and what it looks for on them."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from gateway.modbus.adu import encode
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.sim.bus.faults import Impairment, Reply
from gateway.sim.factory import make_unit
from tests.rig import RigPlant
from tests.rig.rows import Action, Expectation
from tests.rig.sites import SSW07, line, starter
from tests.scenarios.values.words import answers

TWO = SSW07 + starter("fan", 2, "ssw07")
EIGHT = line() + "".join(starter(f"pump-{n}", n, "ssw07") for n in range(1, 9))
STOP_07 = "05 00 64 00 00"  # coil 100 = 0
START_07 = "05 00 64 ff 00"
RUNNING_07, READY_07 = "VB01 = 0x5123", "VB01 = 0x4102"
OCTET_S = 0.0006  # at 19200 bit/s
LIVELY = ("line_voltage", "pause_left_s", "standstill_s")  # values that change while a motor stands


def chatter(every_s: float, for_s: float, data: str = "55 aa 55 aa 55 aa", unit: int = 0) -> Action:
    """Put the same bytes on the wires again and again; of a unit: as a frame with a right CRC."""
    raw = encode(unit, bytes.fromhex(data)) if unit else bytes.fromhex(data)

    def begin(plant: RigPlant) -> None:
        until_s = plant.world.now_s() + for_s

        def again() -> None:
            if plant.world.now_s() < until_s:
                _put(plant, raw)
                plant.loop.call_later(every_s, again)

        plant.do(again)

    return begin


def _put(plant: RigPlant, raw: bytes) -> None:
    plant.lines["pumps"].bus._transmit(99, raw)


def impaired(by: Impairment, *names: str, chance: float = 1.0) -> Action:
    """Impair replies with a chance; all starters' by default."""

    def act(plant: RigPlant) -> None:
        for name in names or tuple(plant.lines["pumps"].starters):
            bus = plant.lines["pumps"].bus
            bus.impair(plant.starter(name).unit.address, by, chance=chance)

    return act


class InOrder:
    """Ordinary faults of replies on one way, each kind with its share; no reply overtakes another."""

    KINDS = ("late", "lost", "cut", "garbled", "refused")

    def __init__(self, *shares: float, late_s: float = 1.0) -> None:
        self.free_s = 0.0  # when the last reply is out
        self._shares, self._late_s = shares, late_s

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        kinds = {kind for kind, share in zip(self.KINDS, self._shares, strict=True) if dice.random() < share}
        adu = reply.adu
        if "refused" in kinds:
            adu = encode(adu[0], bytes((adu[1] | EXCEPTION_BIT, dice.choice((1, 2, 3, 4, 6)))))
        if "garbled" in kinds:
            adu = bytes((adu[0], adu[1] ^ 1 << dice.randrange(8), *adu[2:]))
        if "cut" in kinds:
            adu = adu[: dice.randrange(1, len(adu))]
        now_s = asyncio.get_running_loop().time()
        late_s = reply.deadline_s + dice.uniform(0.0, self._late_s) if "late" in kinds else 0.0
        start_s = max(self.free_s, now_s + reply.after_s + late_s)
        self.free_s = start_s + len(adu) * OCTET_S
        return () if "lost" in kinds else (replace(reply, adu=adu, after_s=start_s - now_s),)


def faults_together(share: float, seed: int) -> Action:
    """Let all that is ordinary go wrong with every starter's replies, in order; chance by the seed."""

    def act(plant: RigPlant) -> None:
        bus = plant.lines["pumps"].bus
        bus.impairments.dice.seed(seed)
        for name in plant.lines["pumps"].starters:
            bus.impair(plant.starter(name).unit.address, InOrder(*[share] * 5))

    return act


def healed(plant: RigPlant) -> None:
    """End every fault of every starter."""
    for name in plant.lines["pumps"].starters:
        plant.lines["pumps"].heal(name)


def twin(address: int, family: str = "ssw07", **options: Any) -> Action:
    """Connect a second starter at an address."""
    return lambda plant: plant.do(
        lambda: plant.lines["pumps"].bus.add(make_unit(family, address, seed=77, **options))
    )


def without(*functions: int) -> Callable[[RigPlant], object]:
    """Let no starter answer what is asked by these functions, as one that is too old or half broken."""

    def act(plant: RigPlant) -> None:
        for name in plant.lines["pumps"].starters:
            answers(name, lambda pdu: None if pdu[0] in functions else b"")(plant)

    return act


# What is looked for


def requests_on_wires(plant: RigPlant, name: str, since: float) -> list[tuple[float, bytes]]:
    """Return what was sent to a starter, whether or not it was there: when, and the PDU."""
    address, bus = plant.starter(name).unit.address, plant.lines["pumps"].bus
    sent = [(frame.start_s - 1000.0, frame.data) for frame in bus.transcript if frame.sender == 0]
    return [(at_s, data[1:-2]) for at_s, data in sent if data[0] == address and at_s >= since]


def requested_at_most(count: int, name: str, *, since: float) -> Expectation:
    """A starter got so many requests at most from a time on, whether or not it was there."""

    def check(plant: RigPlant) -> str:
        found = len(requests_on_wires(plant, name, since))
        return f"{found} requests to {name}" if found > count else ""

    return check


def asked_within_sweeps(sweeps: float, more_s: float, *, since: float, until: float) -> Expectation:
    """No starter was left without a request for longer than so many sweeps of this line."""

    def check(plant: RigPlant) -> str:
        most_s = sweeps * plant.last("gateway/line/pumps")["sweep_s"] + more_s
        return asked_within(most_s, since=since, until=until)(plant)

    return check


def gaps(plant: RigPlant, name: str, since: float, until: float) -> list[float]:
    """Return the times between the requests that reached a starter."""
    asked = [at_s for at_s, _ in plant.starter(name).asked if since <= at_s <= until]
    return [after - before for before, after in pairwise([since, *asked, until])]


def asked_within(most_s: float, *names: str, since: float, until: float) -> Expectation:
    """No starter was left without a request for longer."""
    return lambda plant: "\n".join(
        f"{name} was left for {longest:.3f} s"
        for name in names or tuple(plant.lines["pumps"].starters)
        if (longest := max(gaps(plant, name, since, until))) > most_s
    )


def true_values(plant: RigPlant) -> str:
    """While all motors stand, every value that is good is the one that was read before any fault."""
    first: dict[str, Any] = {}
    for message in plant.messages("starter/+/value/+"):
        if message.topic.endswith(LIVELY) or message.json["quality"] != "good":
            continue
        value = first.setdefault(message.topic, message.json["value"])
        if message.json["value"] != value:
            return f"{message.topic} was {value}, and at {message.at_s:.3f} s {message.json['value']}"
    return ""


def states_only(*states: str, name: str = "+") -> Expectation:
    """No other state was published."""
    return lambda plant: str(
        [
            (each.at_s, each.json["state"])
            for each in plant.messages(f"starter/{name}/state")
            if each.json["state"] not in states
        ]
        or ""
    )


@dataclass(frozen=True)
class Paced:
    """The writes of a starter come at these times (s after `since`), each within `within_s`."""

    name: str
    since: float
    at_s: tuple[float, ...]
    pdu: str = STOP_07
    within_s: float = 0.1

    def __call__(self, plant: RigPlant) -> str:
        found = [at_s - self.since for at_s, pdu in plant.starter(self.name).writes if pdu == self.pdu]
        found = [at_s for at_s in found if at_s >= 0]
        is_right = len(found) == len(self.at_s) and all(
            due <= at_s <= due + self.within_s for due, at_s in zip(self.at_s, found, strict=True)
        )
        return "" if is_right else f"written at {[round(at_s, 3) for at_s in found]}, not at {self.at_s}"


def repeated(name: str, since: float, *, count: int, most_s: float = 0.65, pdu: str = STOP_07) -> Expectation:
    """From then on this was written so often, or once more: at once, then every half second."""

    def check(plant: RigPlant) -> str:
        found = [at_s - since for at_s, each in plant.starter(name).writes if each == pdu and at_s >= since]
        apart = [after - before for before, after in pairwise(found)]
        is_right = (
            len(found) in (count, count + 1) and found[0] < 0.3 and min(apart) > 0.45 and max(apart) < most_s
        )
        return "" if is_right else f"{len(found)} frames, at {[round(at_s, 3) for at_s in found]}"

    return check


def written(name: str, *pdus: str) -> Expectation:
    """Nothing but these was written, each of them, however often."""

    def check(plant: RigPlant) -> str:
        found = {pdu for _, pdu in plant.starter(name).writes}
        return "" if found == set(pdus) else str(sorted(found))

    return check


def final_text(words: str) -> Expectation:
    """The newest result says so in words."""
    return lambda plant: (
        ""
        if words in (text := plant.messages("result/+/+")[-1].json["text"])
        else f"{words!r} is not in {text!r}"
    )
