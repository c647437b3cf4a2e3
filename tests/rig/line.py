"""A line of simulated starters that a scenario can disturb.

A starter that has raw words answers reads with them; all else is as the simulated starter has it.
"""

from __future__ import annotations

import csv
import functools
import random
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gateway.families
from gateway.sim import controls
from gateway.sim.bus.faults import CutShort, Doubled, Impairment, Noisy, NoReply, Reply, WrongUnit
from gateway.sim.bus.port import SimulatedLine
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit

PROFILES = Path(gateway.families.__file__).parent / "profiles"
TABLES = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}  # by the function that reads them
_PLACE = re.compile(r"(coil|discrete|holding|input)\s*(\d+)")


@functools.cache
def places(family: str) -> dict[str, tuple[int, int]]:
    """Return by the manual's code the table (as the function that reads it) and the address on the wire."""
    with (PROFILES / family / "parameters.csv").open(encoding="utf-8") as file:
        return {row["code"]: (TABLES[row["table"]], int(row["address"])) for row in csv.DictReader(file)}


@dataclass(frozen=True)
class Delayed:
    """Replies come so much later."""

    by_s: float

    def apply(self, reply: Reply, dice: random.Random) -> tuple[Reply, ...]:
        return (replace(reply, after_s=reply.after_s + self.by_s),)


class Starter:
    """One simulated starter; `words` are what it answers instead of its own, by table and address."""

    def __init__(self, name: str, unit: SimulatedUnit, line: RigLine) -> None:
        self.name = name
        self.line = line
        self.words: dict[tuple[int, int], int] = {}
        self.refused: tuple[int, frozenset[int]] | None = None  # exception code, functions; none: all
        self.is_deaf = False
        self.asked: list[tuple[float, bytes]] = []  # every request: when, and its PDU
        self.become(unit)

    def become(self, unit: SimulatedUnit) -> None:
        """Be another starter from now on, at the same address."""
        self.unit = unit
        self._own = unit.handle
        unit.handle = self._handle  # type: ignore[method-assign]

    def set_word(self, code: str, value: int | None) -> None:
        """Answer a row (`VB01`, `R19`, `COIL9`, `holding 5001`) with this word; None: as it is by itself."""
        place = _PLACE.fullmatch(code)
        rows = {} if place else places(self.unit.family)
        found = {(TABLES[place[1]], int(place[2])): value} if place else {rows[code.upper()]: value}
        for bit in range(16):  # the bits of VB01 are coils too
            if f"{code.upper()}.{bit}" in rows:
                found[rows[f"{code.upper()}.{bit}"]] = None if value is None else value >> bit & 1
        for key, word in found.items():
            if word is None:
                self.words.pop(key, None)
            else:
                self.words[key] = word & 0xFFFF

    @property
    def writes(self) -> list[tuple[float, str]]:
        """Return the writes that reached it: when, and the PDU in hex."""
        return [
            (round(at_s, 6), pdu.hex(" ")) for at_s, pdu in self.asked if pdu[0] in (5, 6, 15, 16, 22, 23)
        ]

    def _handle(self, pdu: bytes, now_s: float) -> bytes | None:
        if self.is_deaf:
            self.unit.advance(now_s)
            return None
        self.asked.append((self.line.now_s(), pdu))
        if self.refused is not None and (not self.refused[1] or pdu[0] in self.refused[1]):
            return bytes((pdu[0] | 0x80, self.refused[0]))
        reply = self._own(pdu, now_s)
        if not self.words or reply is None or reply[0] not in TABLES.values():
            return reply
        return self._with_words(reply, first=int.from_bytes(pdu[1:3], "big"))

    def _with_words(self, reply: bytes, *, first: int) -> bytes:
        answered = bytearray(reply)
        for (table, address), value in self.words.items():
            at = address - first
            if table != reply[0] or at < 0:
                continue
            if table in (3, 4) and at < reply[1] // 2:
                answered[2 + 2 * at : 4 + 2 * at] = value.to_bytes(2, "big")
            elif table in (1, 2) and at < reply[1] * 8:
                mask = 1 << at % 8
                answered[2 + at // 8] = answered[2 + at // 8] & ~mask | (mask if value else 0)
        return bytes(answered)


class _Wires(SimulatedLine):
    """A simulated line whose adapter may echo what it sends."""

    has_echo = False

    def send(self, data: bytes, timing: Any = None) -> None:
        super().send(data, timing)
        if self.has_echo and self.inbox.sink is not None:
            at_s = self._now_s() + self.timing.wire_s(len(data))
            self._running().call_at(at_s, self.inbox.sink, data, at_s)


class RigLine:
    """The line of one port. `for_s` ends a fault by itself; without it `heal` does."""

    def __init__(self, name: str, call_later: Callable[..., Any], now_s: Callable[[], float]) -> None:
        self.name = name
        self.now_s = now_s
        self.starters: dict[str, Starter] = {}
        self.bus: _Wires  # from the moment when the gateway has the port's timing
        self._call_later = call_later

    def lay(self, timing: Any) -> SimulatedLine:
        """Return the wires with their units, made once."""
        if not hasattr(self, "bus"):
            units = [each.unit for each in self.starters.values()]
            self.bus = _Wires(timing, units, name=self.name, chunk_bytes=None, frames_stored=100_000)
        return self.bus

    def add(self, name: str, family: str, address: int, **options: Any) -> Starter:
        """Connect a starter; `options` are those of the simulator."""
        unit = make_unit(family, address, **{"seed": address, **options})
        starter = self.starters[name] = Starter(name, unit, self)
        if hasattr(self, "bus"):
            self.bus.add(unit)
        return starter

    def swap(self, name: str, family: str, address: int | None = None, **options: Any) -> None:
        """Put another starter in the place of one, or at another address."""
        old = self.starters[name]
        self.bus.remove(old.unit)
        at = old.unit.address if address is None else address
        old.become(make_unit(family, at, **{"seed": at, **options}))
        self.bus.add(old.unit)

    # Faults

    def silent(self, name: str, for_s: float | None = None) -> None:
        """The starter does not get its requests."""
        starter = self.starters[name]
        starter.is_deaf = True
        self._end_later(for_s, lambda: setattr(starter, "is_deaf", False))

    def refuse(
        self, name: str, code: int, functions: Iterable[int] = (), *, for_s: float | None = None
    ) -> None:
        """The starter refuses what it is asked (only these functions) with an exception code."""
        starter = self.starters[name]
        starter.refused = code, frozenset(functions)
        self._end_later(for_s, lambda: setattr(starter, "refused", None))

    def lose(self, name: str, for_s: float | None = None, count: int | None = None) -> None:
        """The starter acts, but its replies are lost."""
        self.impair(name, NoReply(), for_s, count)

    def garble(self, name: str, for_s: float | None = None, count: int | None = None) -> None:
        """Its replies arrive with wrong bits."""
        self.impair(name, Noisy(0.05), for_s, count)

    def cut(self, name: str, for_s: float | None = None, count: int | None = None) -> None:
        """The end of its replies is missing."""
        self.impair(name, CutShort(), for_s, count)

    def delay(self, name: str, by_s: float, for_s: float | None = None, count: int | None = None) -> None:
        """Its replies come later, perhaps after the gateway has given them up."""
        self.impair(name, Delayed(by_s), for_s, count)

    def double(self, name: str, for_s: float | None = None, count: int | None = None) -> None:
        """It sends each reply twice."""
        self.impair(name, Doubled(), for_s, count)

    def impersonate(self, name: str, address: int, for_s: float | None = None) -> None:
        """It answers in the name of another address."""
        self.impair(name, WrongUnit(address), for_s)

    def impair(self, name: str, by: Impairment, for_s: float | None = None, count: int | None = None) -> None:
        address = self.starters[name].unit.address
        self.bus.impair(address, by, count=count)
        self._end_later(for_s, lambda: self.bus.heal(address))

    def heal(self, name: str) -> None:
        """End every fault of a starter."""
        starter = self.starters[name]
        starter.is_deaf, starter.refused = False, None
        self.bus.heal(starter.unit.address)

    def echo(self, for_s: float | None = None) -> None:
        """The adapter receives what it sends."""
        self.bus.has_echo = True
        self._end_later(for_s, lambda: setattr(self.bus, "has_echo", False))

    def noise(self, bit_error_rate: float, for_s: float | None = None) -> None:
        """Flip bits of everything, both ways."""
        self.bus.noise = Noisy(bit_error_rate)
        self._end_later(for_s, lambda: setattr(self.bus, "noise", None))

    def unplug(self, for_s: float | None = None) -> None:
        """Pull the adapter out."""
        self.bus.unplug()
        self._end_later(for_s, self.bus.plug_in)

    def plug(self) -> None:
        self.bus.plug_in()

    def set_knob(self, name: str, knob: str, setting: str = "") -> None:
        """Do what a person beside the starter can do (`starter-gateway simulate --knobs`)."""
        self.bus.advance()
        controls.set_knob(self.starters[name].unit, knob, setting)

    @property
    def violations(self) -> list[str]:
        """Return what the gateway did wrong on the wires."""
        return [str(each) for each in self.bus.violations]

    def _end_later(self, for_s: float | None, end: Callable[[], object]) -> None:
        if for_s is not None:
            self._call_later(for_s, end)
