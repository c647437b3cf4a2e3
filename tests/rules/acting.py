"""Carries commands out on a simulated starter as the gateway does: real PDUs, no line, no waiting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gateway.contract import CommandError, ResultCode
from gateway.families.command.interlock import check
from gateway.families.command.procedures import build, prepare, stop
from gateway.families.profile.decode import decode_points
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import Expect, Procedure, Read
from gateway.families.profile.schema import Variant
from gateway.families.reading import rows_in
from gateway.modbus.pdu import exception_code
from gateway.sim.core.unit import SimulatedUnit
from gateway.sim.factory import make_unit
from tests.sim.wire import Talk

PAUSE_S = 0.1
SLOT_1 = Variant(slot=1)

Rows = dict[str, tuple[int, ...]]


@dataclass(frozen=True)
class Done:
    """How a command went: `end` is confirmed, unchanged, refused, unconfirmed, or the rule it broke."""

    end: str
    text: str = ""
    written: list[str] = field(default_factory=list)  # PDUs in hex


class Actor:
    """One starter and somebody who commands it."""

    def __init__(self, family: str, *, variant: Variant = SLOT_1, **options: Any) -> None:
        self.profile = load_profile(family)
        self.variant = variant
        self.unit: SimulatedUnit = make_unit(family, 1, **options)
        self.talk = Talk(self.unit)
        self.rows: Rows = {}  # what was read last

    def act(self, verb: str, args: Mapping[str, Any] | None = None, *, seen: Rows | None = None) -> Done:
        """Read, judge, write once, read back; with `seen` without reading or judging anything."""
        given = args or {}
        written: list[str] = []
        try:
            if seen is None:
                is_local = self.points(self.rows).get("remote") is False
                preparation = prepare(self.profile, self.variant, verb, given, is_local=is_local)
                seen = self.read(preparation.reads)
                points = self.points(seen)
                violations = check(self.profile, preparation.requires, points, variant=self.variant)
                if violations:
                    return Done(violations[0].code, violations[0].text)
            procedure = build(self.profile, self.variant, verb, given, seen=seen)
        except CommandError as error:
            return Done(error.code, error.text)
        for step in procedure.steps:
            pdu = self.talk.pdu(step.request)
            written.append(step.request.encode().hex())
            is_refused = pdu is not None and exception_code(step.request, pdu) is not None
            if is_refused and not step.may_be_refused:
                return self._abandoned(procedure, Done("refused", written=written))
            if step.then is not None and not self._see(step.then):
                return self._abandoned(procedure, Done("unconfirmed", written=written))
        said = "; ".join(note.text for note in procedure.notes)
        if not procedure.steps:
            return Done("unchanged" if procedure.is_unchanged else "confirmed", said)
        if procedure.verify is None or not self._see(procedure.verify):
            return self._abandoned(procedure, Done("unconfirmed", said, written))
        return Done("confirmed", said, written)

    def trip(self) -> None:
        self.unit.trip(12 if self.profile.family == "sst" else 3)

    def read(self, reads: Sequence[Read]) -> Rows:
        """Return freshly read rows; CommandError when one is refused or not answered."""
        rows: Rows = {}
        for read in reads:
            pdu = self.talk.pdu(read.request)
            if pdu is None or exception_code(read.request, pdu) is not None:
                raise CommandError(ResultCode.NO_ANSWER, "status", reason="no reply")
            rows |= rows_in(self.profile, read, read.request.decode_reply(pdu))
        self.rows |= rows
        return rows

    def points(self, rows: Rows) -> dict[str, Any]:
        """Return points by name and rows by code, as a read-back is judged."""
        decoded = decode_points(self.profile, self.variant, rows)
        return {**rows, **{name: point.value for name, point in decoded.items()}}

    def _see(self, expect: Expect) -> bool:
        until_s = self.talk.now_s + expect.within_s
        count = 0
        while count < 2:
            try:
                values = self.points(self.read(expect.reads))
            except CommandError:
                values = {}
            count = count + 1 if expect.is_met(values) else 0
            if count == 0 and self.talk.now_s >= until_s:
                return False
            self.talk.wait(PAUSE_S)
        return True

    def _abandoned(self, procedure: Procedure, done: Done) -> Done:
        run_off = stop(self.profile, self.variant, seen=self.rows, with_jog=True).steps
        for request in (*procedure.abandon, *(step.request for step in run_off if procedure.is_run_cleared)):
            self.talk.pdu(request)
        return done
