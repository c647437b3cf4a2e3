"""In which form a read is sent: as it is asked for, or by an alternate; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gateway.line.job import Alternate
from gateway.line.prepared import Prepared
from gateway.line.rtu.late_replies import LateReplies, expected_shape
from gateway.modbus import adu
from gateway.modbus.pdu import Request


class Forms:
    """The forms that may be sent on one open port at the moment."""

    def __init__(self, late: LateReplies, time: Callable[[], float]) -> None:
        self._late = late
        self._time = time
        self._unusable: set[bytes] = set()  # alternates that were refused

    def give_up(self, prepared: Prepared) -> None:
        """Send an alternate no more, which its unit refused."""
        self._unusable.add(prepared.adu)

    def form_of(self, prepared: Prepared, alternates: Callable[[], tuple[Alternate, ...]]) -> Prepared | None:
        """Return in which form this may be sent now: as it is, or as an alternate; None when not yet."""
        unit, request, now_s = prepared.unit, prepared.request, self._time()
        if self._late.may_send(unit, request, prepared.shape, now_s):
            return prepared
        others = self._usable(unit, alternates())
        shapes = ((prepared.shape,), *(tuple(map(expected_shape, parts)) for parts, _ in others))
        chosen = self._late.choose(unit, request, shapes, now_s)
        if chosen is None:
            return None
        place, times = chosen
        if place == 0:
            return prepared if times == 1 else replace(prepared, times=times)
        parts, cut = others[place - 1]
        if len(parts) > 1:
            return Prepared.of(unit, parts[0], asked=request, cut=cut, parts=parts)
        form = Prepared.of(unit, parts[0], asked=request, cut=cut)
        return form if times == 1 else replace(form, times=times)

    def part_of(self, prepared: Prepared, part: Request) -> Prepared | None:
        """Return one more part of what is asked in parts; None when it may not be sent now."""
        forms = ((expected_shape(part),),)
        if self._late.choose(prepared.unit, prepared.request, forms, self._time()) != (0, 1):
            return None
        return Prepared.of(prepared.unit, part, asked=prepared.request, parts=(part,))

    def is_in_question(self, prepared: Prepared) -> bool:
        """Return whether a read's reply is owed already by a unit that has sent nothing since."""
        unit, late = prepared.unit, self._late
        if prepared.request.is_write or not late.is_unheard(unit):
            return False
        return late.owes(unit, prepared.shape, now_s=self._time())

    def free_from_s(self, prepared: Prepared) -> float:
        """Return from when on it is worth looking again whether this may be sent."""
        return self._late.free_from_s(prepared.unit, prepared.request, self._time())

    def _usable(self, unit: int, alternates: tuple[Alternate, ...]) -> list[Alternate]:
        if not self._unusable:
            return list(alternates)
        return [
            each
            for each in alternates
            if all(adu.encode(unit, part.encode()) not in self._unusable for part in each[0])
        ]
