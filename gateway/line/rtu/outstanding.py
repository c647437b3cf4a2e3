"""Which replies may still come from the units of a line, and how none passes for another's; pure.

An RTU reply carries no number. It shows its unit and its *shape*: of a read the function and the byte count,
of a write the whole reply, of an identification (43) and of a refusal the function. A starter answers in the
order in which it was asked, and so does the way to it. So there is one list per unit of what was asked and
not answered, in the order asked; a unit without a list is *in step*.

1. Ask in a form whose shape is not listed. Where none is free a fence goes first: any readable row of that
   unit in a free shape. Where no shape is free at all, ask in the form whose reply cuts the list most.
2. Believe a reply to the request under way whose shape (of a refusal: whose function) is not listed. Whatever
   is older cannot come any more: the list is emptied.
3. Drop any other whole frame, and cut the list up to and including the oldest entry of its shape (of a
   refusal: of its function).
4. List what had no reply to believe in time. An entry expires `EXPIRES_S` after it was asked.
5. A refusal in doubt gives up its form, where that is not the row's own (`forms.py`).
6. Writes go out in step, but for a stop's, which are never held (`forms.py`).

The lists outlive silence, reopening and reset of the port, since a serial server may deliver to the next
connection. Nothing is inferred from one unit about another.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from gateway.modbus import EXCEPTION_BIT, FIXED_REPLIES, Function, Request

EXPIRES_S = 35.0  # a reply comes up to 30 s late; the rest is for requests that waited before it

Shape = bytes

_COUNTED_SIZE = 2  # function and byte count
_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


class Entry(NamedTuple):
    """A request without an answer."""

    shape: Shape
    asked_s: float


def shape_of(pdu: bytes) -> Shape:
    """Return what of a normal reply distinguishes it from others of its unit."""
    if pdu[0] in FIXED_REPLIES:
        return pdu
    return pdu[:1] if pdu[0] == Function.ENCAPSULATED else pdu[:_COUNTED_SIZE]


def expected_shape(request: Request) -> Shape:
    """Return the shape of a request's normal reply [APP 6]."""
    function = request.function
    if function in FIXED_REPLIES:  # the reply to a write begins as its request
        return request.encode()[: FIXED_REPLIES[Function(function)] - _ADU_EXTRA]
    size = request.reply_size()
    return bytes((function,)) if size is None else bytes((function, size - _COUNTED_SIZE))


class Outstanding:
    """The lists of one line; times in seconds on the line's clock."""

    def __init__(self) -> None:
        self.came_late: Counter[int] = Counter()  # listed replies that came after all, by unit
        self._lists: dict[int, list[Entry]] = {}  # none is empty

    def is_in_step(self, unit: int) -> bool:
        """Return whether no reply of this unit may still come but that to the request under way."""
        return unit not in self._lists

    def expire(self, unit: int, now_s: float) -> None:
        """Forget the replies that cannot come any more, however late."""
        listed = self._lists.get(unit, ())
        self._replace(unit, [entry for entry in listed if entry.asked_s > now_s - EXPIRES_S])

    def choose(self, unit: int, forms: Sequence[Shape], fences: Sequence[Shape]) -> int:
        """Return the place of the shape to ask in (rule 1), among a row's forms and the fences behind them.

        Of the fences one of a function that is not listed goes first: its refusal would prove as much.
        """
        first_at: dict[Shape, int] = {}
        for at, entry in enumerate(self._lists.get(unit, ())):
            first_at.setdefault(entry.shape, at)
        functions = {shape[0] for shape in first_at}
        shapes = (*forms, *fences)
        free = [place for place, shape in enumerate(shapes) if shape not in first_at]
        if not free:
            return max(range(len(forms) or len(fences)), key=lambda place: first_at[shapes[place]])
        if free[0] < len(forms):
            return free[0]
        return next((place for place in free if shapes[place][0] not in functions), free[0])

    def believe(self, unit: int, pdu: bytes) -> bool:
        """Return whether this reply to the request under way is its own (rule 2); then the list is empty."""
        listed = self._lists.get(unit)
        if listed is None:
            return True
        if _oldest_of(pdu, listed) is not None:
            return False
        del self._lists[unit]
        return True

    def drop(self, unit: int, pdu: bytes) -> bool:
        """Cut the list by a whole frame that is no answer (rule 3); return whether it was listed."""
        listed = self._lists.get(unit, [])
        at = _oldest_of(pdu, listed)
        if at is None:
            return False
        self.came_late[unit] += 1
        self._replace(unit, listed[at + 1 :])
        return True

    def add(self, unit: int, shape: Shape, asked_s: float) -> None:
        """List a request that had no reply to believe in time (rule 4)."""
        self._lists.setdefault(unit, []).append(Entry(shape, asked_s))

    def _replace(self, unit: int, entries: list[Entry]) -> None:
        if entries:
            self._lists[unit] = entries
        else:
            self._lists.pop(unit, None)


def _oldest_of(pdu: bytes, listed: Sequence[Entry]) -> int | None:
    """Return the place of the oldest entry that a frame may answer; None where there is none."""
    if pdu[0] & EXCEPTION_BIT:
        function = pdu[0] & ~EXCEPTION_BIT
        return next((at for at, entry in enumerate(listed) if entry.shape[0] == function), None)
    shape = shape_of(pdu)
    return next((at for at, entry in enumerate(listed) if entry.shape == shape), None)
