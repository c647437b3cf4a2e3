"""The length of a request, from its first bytes: the gateway reads replies only."""

from __future__ import annotations

from gateway.errors import BadFrameError
from gateway.modbus import adu
from gateway.modbus.codes import MEI_DEVICE_IDENTIFICATION, Function

_FIXED_REQUESTS = {
    Function.READ_COILS: 8,
    Function.READ_DISCRETE_INPUTS: 8,
    Function.READ_HOLDING_REGISTERS: 8,
    Function.READ_INPUT_REGISTERS: 8,
    Function.WRITE_COIL: 8,
    Function.WRITE_REGISTER: 8,
    Function.MASK_WRITE_REGISTER: 10,
    Function.ENCAPSULATED: 7,
}
_COUNTED_REQUESTS = {  # where the byte count stands
    Function.WRITE_COILS: 6,
    Function.WRITE_REGISTERS: 6,
}


def request_adu_size(head: bytes) -> int | None:
    """Return how long the request that begins with `head` is in all; None when that is not known yet.

    BadFrameError for what no request that we know can begin with: only silence ends such a frame.
    """
    if len(head) < 2:
        return None
    adu._require_known(head[1])
    function = Function(head[1])
    if function == Function.ENCAPSULATED and len(head) > 2 and head[2] != MEI_DEVICE_IDENTIFICATION:
        raise BadFrameError(f"MEI type {head[2]}")
    if function in _COUNTED_REQUESTS:
        return adu._counted_size(head, _COUNTED_REQUESTS[function])
    return _FIXED_REQUESTS[function]
