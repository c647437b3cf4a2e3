"""Which registers are read together: those between which less time is lost than with another request."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from gateway.families.schema import Parameter
from gateway.modbus.timing import LineTiming

LEAST_DELAY_S = 0.005  # of a starter's answer; a longer one makes joining worth even more

_REQUEST_BYTES = 8  # a read request, with unit and CRC [APP 6.3, 6.4; SERIAL 2.5.1]
_REPLY_BYTES = 5  # what is in its reply besides the registers
_WORD_BYTES = 2


def cheapest_runs(rows: Sequence[Parameter], timing: LineTiming, *, longest: int) -> list[list[Parameter]]:
    """Return the rows, which are in order of address, in the runs that take the line the least time.

    All registers between two rows must be readable; no run has more than `longest` registers.
    """
    request_s = timing.wire_s(_REQUEST_BYTES + _REPLY_BYTES) + timing.silence_s + LEAST_DELAY_S
    word_s = timing.wire_s(_WORD_BYTES)
    least_s = [0.0] + [inf] * len(rows)  # for the first so many rows
    starts = [0] * (len(rows) + 1)  # of the last run in that
    for count in range(1, len(rows) + 1):
        end = 0
        for start in range(count - 1, -1, -1):
            end = max(end, rows[start].address + rows[start].words)
            size = end - rows[start].address
            if size > longest:
                break
            cost_s = least_s[start] + request_s + size * word_s
            if cost_s < least_s[count]:
                least_s[count], starts[count] = cost_s, start
    runs: list[list[Parameter]] = []
    count = len(rows)
    while count:
        runs.append(list(rows[starts[count] : count]))
        count = starts[count]
    return runs[::-1]
