"""A request in the bytes that go on the wire."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

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

    @classmethod
    def of(cls, unit: int, request: Request) -> Self:
        """Compute what will be needed; ValueError for what no frame can hold."""
        size = request.reply_size()
        return cls(
            unit,
            request,
            adu.encode(unit, request.encode()),
            None if size is None else size + _ADU_EXTRA,
            request.function in MIRRORED,
        )
