"""Which replies may still come on a line, so that none is taken for the answer to a later request; pure.

An RTU reply carries no number. What it shows is its unit, its function and its length (a write's reply: what
was written); function and length are its *shape* here. So a unit is never asked for a shape that it may still
send: the same registers are then read by an alternate request, whose reply is a register longer or of another
function. Late, doubled and swapped replies show by their shape or their unit; nothing is guessed from times.

Invariants
 1. From the moment a request is written its unit owes the shape of its reply: until that reply comes, whether
    as the answer or late, or `LATE_S` have passed.
 2. A read is only sent while its unit does not owe its shape. Where all alternates are owed, the one owed
    least often, n times, is asked until n + 1 answers in a row are equal: n may be late ones, one is fresh.
 3. For `COPY_S` after each reply its copy may begin: within that time no read has its shape, and none of a
    function follows a refusal of that function. Only on a calm line the same read may follow at once in the
    same shape: a first copy is its value of a moment before.
 4. An exception reply shows only its function. It is not believed while its unit owes any other reply to that
    function; what was refused so is asked again once nothing of that function is owed.
 5. A write is never held back. While its unit owes an equal reply its acknowledgement is not believed: the
    read-back decides. FC15 and FC16 acknowledgements of one address count as equal.
 6. Identification replies (FC43) name what they answer and do not change: they are always believed.
 7. A line is disturbed for `DISTURBED_S` after anything late, doubled or foreign. Meanwhile successive
    answers to one request have different shapes where it has alternates.
 8. A unit that has sent nothing since it owes a shape is first asked for life, by a read whose answer counts
    for nothing else: no alternate is spent on a unit that is gone.
 9. What is owed outlives the port: a serial server may deliver it to the next connection.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from gateway.modbus.codes import EXCEPTION_BIT, Function
from gateway.modbus.pdu import Request

LATE_S = 30.0  # a reply that was not in time may come for so long
MOST_OWED = 7  # replies of one shape, with which it may still be asked for
COPY_S = 0.025  # from the end of a reply to the beginning of its copy, at most
LONGEST_REPLY_S = 0.3  # on the wire at 9600 bit/s
DISTURBED_S = 60.0
LOOK_AGAIN_S = 0.5  # what waits for a late reply is looked at so often

_NAMED = frozenset({Function.WRITE_COIL, Function.WRITE_REGISTER, Function.MASK_WRITE_REGISTER})
_ADDRESSED = frozenset({Function.WRITE_COILS, Function.WRITE_REGISTERS})
_ADDRESSED_SIZE = 3  # function and address
_COUNTED_SIZE = 2  # function and byte count

Shape = bytes


def shape_of(pdu: bytes) -> Shape:
    """Return what of a reply tells it from others of its unit."""
    function = pdu[0]
    if function in _NAMED:
        return pdu
    if function in _ADDRESSED:
        return pdu[:_ADDRESSED_SIZE]
    if function == Function.ENCAPSULATED or function & EXCEPTION_BIT:
        return pdu[:1]
    return pdu[:_COUNTED_SIZE]


def expected_shape(request: Request) -> Shape:
    """Return the shape of a request's normal reply."""
    function = request.function
    if function in _NAMED or function in _ADDRESSED or function == Function.ENCAPSULATED:
        return shape_of(request.encode())  # such a reply begins as its request
    return bytes((function, (request.reply_size() or _COUNTED_SIZE) - _COUNTED_SIZE))


class _Copy(NamedTuple):
    """A second sending of a reply, which may begin until then."""

    until_s: float
    shape: Shape
    request: Request | None  # that it answers; None: not known


class LateReplies:
    """What the units of one line may still send; times in seconds on the line's clock."""

    def __init__(self, *, late_s: float = LATE_S) -> None:
        self._late_s = late_s
        self._owed: dict[int, dict[Shape, list[float]]] = {}  # by unit: when it was asked
        self._copies: dict[int, list[_Copy]] = {}  # by unit: of its latest replies
        self._doubted: dict[int, set[Request]] = {}  # by unit: refused, as it seemed
        self._answered_in: dict[tuple[int, Request], Shape] = {}  # on a disturbed line
        self._seen_s: dict[tuple[int, Shape], float] = {}  # when it came last
        self._unheard: set[int] = set()
        self._sent: dict[tuple[int, Shape], int] = {}  # how many requests
        self._disturbed_until_s = -inf

    def is_disturbed(self, now_s: float) -> bool:
        """Return whether anything was late, doubled or foreign in the last minute."""
        return now_s < self._disturbed_until_s

    def owes(self, unit: int, shape: Shape | None = None, *, now_s: float = -inf) -> bool:
        """Return whether a unit owes this shape, or anything."""
        owed = self._current(unit, now_s)
        return bool(owed) if shape is None else shape in owed

    def is_anyone_late(self, now_s: float, *, but: tuple[int, Shape]) -> bool:
        """Return whether anyone owes anything beside one shape of one unit."""
        return any((unit, shape) != but for unit in self._owed for shape in self._current(unit, now_s))

    def is_unheard(self, unit: int) -> bool:
        """Return whether nothing was heard of a unit since a request that it did not answer."""
        return unit in self._unheard

    def may_pass(self, unit: int, request: Request, shape: Shape, now_s: float) -> bool:
        """Return whether what a unit may still send would pass for the answer to a request sent now."""
        is_owed = shape in self._current(unit, now_s)
        return is_owed or (request.is_write and self.may_be_copied(unit, shape, request, now_s))

    def may_be_copied(self, unit: int, shape: Shape, request: Request | None, now_s: float) -> bool:
        """Return whether a copy may still begin that would pass for the answer of this shape to a request."""
        copies = self._copies.get(unit)
        if not copies:
            return False
        copies[:] = [each for each in copies if each.until_s > now_s]
        is_same_harmless = request is not None and not self.is_disturbed(now_s)
        return any(
            each.shape == shape and not (is_same_harmless and each.request == request) for each in copies
        )

    def may_send(self, unit: int, request: Request, shape: Shape, now_s: float) -> bool:
        """Return whether this may be sent as it is, without looking for an alternate."""
        if request.is_write or request.function == Function.ENCAPSULATED:
            return True
        if shape in self._current(unit, now_s) or unit in self._doubted or self.is_disturbed(now_s):
            return False
        copies = self._copies.get(unit)
        if not copies or copies[-1].until_s <= now_s:
            return True
        return not (
            self.may_be_copied(unit, shape, request, now_s) or self._is_refusal_near(unit, request, now_s)
        )

    def choose(
        self, unit: int, request: Request, forms: tuple[tuple[Shape, ...], ...], now_s: float
    ) -> tuple[int, int] | None:
        """Return which of these equivalent forms of a read may be sent, the request itself being the first.

        The second number says how many equal answers count as one. A form of several requests has several
        shapes. None while there is none.
        """
        owed = self._current(unit, now_s)
        if self._is_doubted(unit, request, owed) or self._is_refusal_near(unit, request, now_s):
            return None
        latest = self._answered_in.get((unit, request)) if self.is_disturbed(now_s) else None
        calm = [
            at
            for at, shapes in enumerate(forms)
            if not self.may_be_copied(unit, shapes[0], None if at else request, now_s)
        ]
        free = [at for at in calm if owed.keys().isdisjoint(forms[at])]
        for at in free:
            if forms[at][-1] != latest:
                return at, 1
        if free:
            return free[0], 1
        if any(owed.keys().isdisjoint(shapes) for shapes in forms):
            return None  # only copies are in the way, not for long
        return self._least_owed(unit, forms, owed, now_s)

    def sent(self, unit: int, shape: Shape) -> int:
        """Return how many requests for this shape were sent to a unit."""
        return self._sent.get((unit, shape), 0)

    def note_sent(self, unit: int, shape: Shape, at_s: float) -> None:
        """Record that a request is written."""
        self._unheard.add(unit)
        self._sent[unit, shape] = self._sent.get((unit, shape), 0) + 1
        self._owed.setdefault(unit, {}).setdefault(shape, []).append(at_s)

    def note_answer(
        self, unit: int, shape: Shape, request: Request, *, asked: Request, at_s: float, seen: Shape
    ) -> None:
        """Record the believed reply `seen` to the latest request, which expected `shape`.

        `asked` is the request that it was a form of.
        """
        self._unheard.discard(unit)
        self._settle(unit, shape, is_latest=True)
        self._seen_s[unit, seen] = at_s
        self._add_copy(unit, _Copy(at_s + COPY_S, seen, request))
        if at_s < self._disturbed_until_s:
            self._answered_in[unit, asked] = seen
        elif self._answered_in:
            self._answered_in.clear()

    def note_damaged(self, unit: int, shape: Shape) -> None:
        """Record that the reply came, though with a wrong CRC."""
        self._settle(unit, shape, is_latest=True)

    def note_refusal_doubted(self, unit: int, request: Request) -> None:
        """Record that an exception came which may answer an earlier request."""
        self._doubted.setdefault(unit, set()).add(request)

    def note_stray(self, unit: int, pdu: bytes, *, at_s: float, asked: Shape | None = None) -> None:
        """Record a whole frame that is no answer; `asked` is the shape that is awaited from this unit now."""
        self._disturbed_until_s = at_s + DISTURBED_S
        self._unheard.discard(unit)
        shape = shape_of(pdu)
        owed = self._owed.get(unit, {})
        seen_s = self._seen_s.get((unit, shape), -inf)
        self._seen_s[unit, shape] = at_s
        if at_s - seen_s <= COPY_S + LONGEST_REPLY_S:
            pass  # it may be a copy of the one before
        elif pdu[0] & EXCEPTION_BIT:
            function = pdu[0] & ~EXCEPTION_BIT
            possible = [each for each in owed if each[0] == function]
            if len(possible) == 1 and possible[0] != asked:
                self._settle(unit, possible[0])
        elif shape != asked:
            self._settle(unit, shape)
        self._add_copy(unit, _Copy(at_s + COPY_S, shape, None))

    def is_exception_clear(self, unit: int, function: int, asked: Shape, now_s: float) -> bool:
        """Return whether an exception reply can only answer the request that expects `asked`."""
        others = (each for each in self._current(unit, now_s) if each[0] == function and each != asked)
        return next(others, None) is None

    def free_from_s(self, unit: int, request: Request, now_s: float) -> float:
        """Return from when on it is worth looking again whether a read may be sent."""
        owed = self._current(unit, now_s)
        until_s = max((copy.until_s for copy in self._copies.get(unit, ())), default=now_s)
        if until_s <= now_s or self._is_doubted(unit, request, owed):
            return now_s + LOOK_AGAIN_S
        return until_s

    def forget(self, unit: int) -> None:
        """Drop what was noted of a unit's refusals: it is another one now. What it owes may still come."""
        self._doubted.pop(unit, None)

    def _least_owed(
        self, unit: int, forms: tuple[tuple[Shape, ...], ...], owed: dict[Shape, list[float]], now_s: float
    ) -> tuple[int, int] | None:
        """Return the form whose one shape is owed least often, no copy being near, and the answers needed."""
        counts = {
            at: len(owed[shape])
            for at, (shape, *more) in enumerate(forms)
            if not more and shape in owed and not self.may_be_copied(unit, shape, None, now_s)
        }
        least = min(counts, key=lambda at: counts[at], default=None)
        return None if least is None or counts[least] > MOST_OWED else (least, counts[least] + 1)

    def _is_refusal_near(self, unit: int, request: Request, now_s: float) -> bool:
        return self.may_be_copied(unit, bytes((request.function | EXCEPTION_BIT,)), None, now_s)

    def _is_doubted(self, unit: int, request: Request, owed: dict[Shape, list[float]]) -> bool:
        doubted = self._doubted.get(unit)
        if doubted is None or request not in doubted:
            return False
        if any(shape[0] == request.function for shape in owed):
            return True
        doubted.discard(request)
        return False

    def _current(self, unit: int, now_s: float) -> dict[Shape, list[float]]:
        """Return what a unit still owes."""
        owed = self._owed.get(unit)
        if not owed:
            return {}
        from_s = now_s - self._late_s
        for shape in [shape for shape, asked_s in owed.items() if asked_s[0] <= from_s]:
            owed[shape] = [at_s for at_s in owed[shape] if at_s > from_s]
            if not owed[shape]:
                del owed[shape]
        return owed

    def _settle(self, unit: int, shape: Shape, *, is_latest: bool = False) -> None:
        """Owe one less of a shape: the latest, or the earliest where the latest may still be to come."""
        owed = self._owed.get(unit, {})
        times_s = owed.get(shape)
        if times_s is not None:
            del times_s[-1 if is_latest else 0]
            if not times_s:
                del owed[shape]

    def _add_copy(self, unit: int, copy: _Copy) -> None:
        copies = self._copies.setdefault(unit, [])
        if copies and copies[-1].until_s + COPY_S <= copy.until_s:
            copies.clear()
        copies.append(copy)
