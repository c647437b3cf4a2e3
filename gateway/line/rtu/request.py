"""A request in the bytes that go on the wire, and the forms in which a read may be sent; pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

from gateway.line.rtu.late_replies import LateReplies, Shape, expected_shape
from gateway.modbus import adu
from gateway.modbus.codes import Function
from gateway.modbus.pdu import Request

# A read that says what another does, by a reply of another length; and what takes the other's value from it.
Alternate = tuple[Request, Callable[[Any], Any]]
Alternates = Callable[[Request], tuple[Alternate, ...]]

# Their normal reply repeats the request [APP 6.5, 6.6, 6.16], so it looks like an adapter's echo.
MIRRORED = frozenset({Function.WRITE_COIL, Function.WRITE_REGISTER, Function.MASK_WRITE_REGISTER})

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


@dataclass(frozen=True, slots=True)
class EncodedRequest:
    """One request to one unit, ready to be sent."""

    unit: int
    request: Request
    adu: bytes
    reply_size: int | None  # of the normal reply's ADU; None = only the reply shows it
    is_mirrored: bool
    shape: Shape
    asked: Request  # what is wanted: the request itself, or the one that it is an alternate of
    cut: Callable[[Any], Any] | None = None  # from an alternate's value to that of `asked`
    is_literal: bool = False  # what is asked is whether there is this one
    times: int = 1  # so many equal answers count as one, since earlier replies would pass for them

    @classmethod
    def of(
        cls,
        unit: int,
        request: Request,
        *,
        asked: Request | None = None,
        cut: Callable[[Any], Any] | None = None,
    ) -> Self:
        """Prepare a request, or an alternate of `asked`; ValueError for what no frame can hold."""
        size = request.reply_size()
        return cls(
            unit,
            request,
            adu.encode(unit, request.encode()),
            None if size is None else size + _ADU_EXTRA,
            request.function in MIRRORED,
            expected_shape(request),
            asked or request,
            cut,
        )


class Forms:
    """The forms in which the units of one line are read."""

    def __init__(self, late: LateReplies) -> None:
        self.late = late
        self._refused: dict[tuple[int, Request], set[Request]] = {}  # alternates, by unit and what is asked

    def choose(
        self,
        encoded: EncodedRequest,
        alternates: Alternates,
        now_s: float,
        *,
        is_decisive: bool = True,
        is_patient: bool = False,
        is_literal: bool = False,
    ) -> EncodedRequest | None:
        """Return in which form this may be sent now; None when not yet. Flags as `LateReplies.choose`.

        What `is_literal` has no other form: what is asked is whether there is this one.
        """
        request = encoded.request
        if request.is_write:
            return encoded
        if is_literal:
            encoded = replace(encoded, is_literal=True)
        if self.late.is_calm(encoded.unit, now_s):
            return encoded
        refused = self._refused.get((encoded.unit, request), ())
        others = [] if is_literal else [each for each in alternates(request) if each[0] not in refused]
        chosen = self.late.choose(
            encoded.unit,
            request,
            [encoded.shape, *(expected_shape(each) for each, _ in others)],
            now_s,
            is_decisive=is_decisive,
            is_patient=is_patient,
            is_literal=is_literal,
        )
        if chosen is None:
            return None
        form = encoded
        if chosen.at:
            other, cut = others[chosen.at - 1]
            form = EncodedRequest.of(encoded.unit, other, asked=request, cut=cut)
        return form if chosen.times == 1 else replace(form, times=chosen.times)

    def give_up(self, form: EncodedRequest) -> None:
        """Send an alternate no more, which its unit refused."""
        self._refused.setdefault((form.unit, form.asked), set()).add(form.request)

    def forget(self, unit: int) -> None:
        """Know nothing of a unit's forms any more: it is another one now."""
        self.late.forget(unit)
        self._refused = {key: refused for key, refused in self._refused.items() if key[0] != unit}
