"""How long one request and its reply take at most; pure."""

from __future__ import annotations

from gateway.modbus import MAX_ADU_SIZE, LineTiming, Request

ALLOWANCE_S = 0.02  # for adapters, drivers and this machine, on top of the unit's own response time

_ADU_EXTRA = 3  # bytes around a PDU: unit and CRC


def request_wire_s(request: Request, timing: LineTiming) -> float:
    """Return how long the request is on the wire."""
    return timing.wire_s(len(request.encode()) + _ADU_EXTRA)


def reply_within_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float
) -> float:
    """Return how long after the request's end its reply is waited for, at most."""
    size = request.reply_size()
    reply_s = timing.wire_s(MAX_ADU_SIZE if size is None else size + _ADU_EXTRA)
    return response_time_s + reply_s + allowance_s


def longest_s(
    request: Request, timing: LineTiming, *, response_time_s: float, allowance_s: float = ALLOWANCE_S
) -> float:
    """Return how long this request can keep others from the line: no reply, then listening for a late one."""
    within_s = reply_within_s(request, timing, response_time_s=response_time_s, allowance_s=allowance_s)
    return request_wire_s(request, timing) + within_s + max(response_time_s, timing.silence_s)
