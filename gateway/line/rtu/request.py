"""A request in the bytes that go on the wire."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

from gateway.line.rtu.late_replies import Shape, expected_shape
from gateway.modbus import adu
from gateway.modbus.codes import Function
from gateway.modbus.pdu import Request

# Their normal reply repeats the request [APP 6.5, 6.6, 6.16], so it cannot be told from an adapter's echo.
MIRRORED = frozenset({Function.WRITE_COIL, Function.WRITE_REGISTER, Function.MASK_WRITE_REGISTER})

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


@dataclass(frozen=True, slots=True)
class EncodedRequest:
    """One request to one unit, ready to be sent."""

    unit: int
    request: Request
    adu: bytes
    reply_size: int | None  # of the normal reply's ADU; None = only the reply tells
    is_mirrored: bool
    shape: Shape
    asked: Request  # what is wanted: the request itself, or the one that it is an alternate of
    cut: Callable[[Any], Any] | None = None  # from an alternate's value to that of `asked`
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
