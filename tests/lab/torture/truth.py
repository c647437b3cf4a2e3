"""What a simulated starter has ever said, decoded: nothing else may be shown as good."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

from gateway.contract import to_level
from gateway.errors import GatewayError
from gateway.families.diagnosis.identification import identify, identify_requests
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant
from gateway.modbus.codes import EXCEPTION_BIT, Function
from gateway.modbus.server import decode_request
from gateway.modbus.timing import Framing, LineTiming
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from gateway.starters import StarterSetup, merged
from gateway.starters import own_points_of as own_points
from gateway.starters.state import PointSources

# What the gateway adds: no starter has these.
OWN_POINTS = {each.name for family in FAMILIES for each in own_points(load_profile(family))}
_REMEMBERED = 50_000  # some hours of one starter's requests

_TABLES: dict[int, Table] = {
    Function.READ_COILS: Table.COIL,
    Function.READ_HOLDING_REGISTERS: Table.HOLDING,
    Function.READ_INPUT_REGISTERS: Table.INPUT,
}


class Truth:
    """Listens to one unit's requests and replies, before anything on the line can corrupt them."""

    def __init__(self, unit: SimulatedUnit, name: str) -> None:
        """Wrap the unit's `handle`; another one like it is asked who it is."""
        family, twin = unit.family, make_unit(unit.family, unit.address, seed=unit.address)
        self.name = name
        self.values: dict[str, set[Any]] = {}
        self.requests_s: deque[float] = deque(maxlen=_REMEMBERED)  # when requests came
        self._profile = load_profile(family)
        self._sources = PointSources(self._profile)
        self._variants = (Variant(), self._identified(twin))
        self._known: dict[str, tuple[int, ...]] = {}
        self._handle = unit.handle
        unit.handle = self.handle  # type: ignore[method-assign] # that is the point of it

    def handle(self, pdu: bytes, now_s: float) -> bytes | None:
        reply = self._handle(pdu, now_s)
        if reply is not None:
            self.requests_s.append(now_s)
            if not reply[0] & EXCEPTION_BIT:
                self._learn(pdu, reply)
        return reply

    def _learn(self, pdu: bytes, reply: bytes) -> None:
        table = _TABLES.get(pdu[0])
        if table is None:
            return
        request: Any = decode_request(pdu)
        words = [int(word) for word in request.decode_reply(reply)]
        rows = {
            row.code: tuple(words[at : at + row.words])
            for at in range(request.count)
            for row in self._profile.rows_at.get((table, request.address + at), ())
            if at + row.words <= request.count
        }
        rows |= _words_of_bits(rows)
        self._known.update(rows)
        for variant in self._variants:
            found = self._sources.decode(variant, rows, known=self._known)
            for point, decoded in found.points.items():
                self.values.setdefault(to_level(point), set()).add(decoded.value)

    def _identified(self, twin: SimulatedUnit) -> Variant:
        answers: dict[str, Any] = {}
        twin.advance(1000.0)
        for question in identify_requests(self._profile):
            reply = twin.handle(question.request.encode(), 1000.0)
            try:
                answers[question.tag] = question.request.decode_reply(reply or b"")
            except GatewayError:
                answers[question.tag] = None
        timing = LineTiming(19200, Framing.parse("8E1"))
        setup = StarterSetup(self.name, "line", 1, self._profile, Variant(), timing)
        return merged(setup.variant, identify(self._profile, answers))


def never_had(
    good: Iterable[tuple[str, str, str]], values: Mapping[str, Mapping[str, Iterable[Any]]]
) -> list[tuple[str, str, str]]:
    """Return what was shown as good (starter, point, value as JSON), and no starter has ever said."""
    true = {
        (name, point, json.dumps(value))
        for name, points in values.items()
        for point, seen in points.items()
        for value in seen
    }
    return sorted(each for each in set(good) - true if each[1] not in OWN_POINTS)


def _words_of_bits(rows: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, ...]]:
    """Return the words whose 16 bits were read as coils: a status may be read in that form."""
    bits: dict[str, dict[int, int]] = {}
    for code, (value, *_) in rows.items():
        word, _, place = code.rpartition(".")
        if word and place.isdecimal():
            bits.setdefault(word, {})[int(place)] = value
    return {
        word: (sum(value << place for place, value in each.items()),)
        for word, each in bits.items()
        if each.keys() == set(range(16))
    }
