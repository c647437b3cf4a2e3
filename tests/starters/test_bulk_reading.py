"""Many rows of one starter: refusals, silence, a busy starter."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.errors import PortLostError
from gateway.families import load_profile
from gateway.families.reading import bulk_reads
from gateway.line import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from tests.virtual_time import run_virtually

PROFILE = load_profile("ssw07")
CODES = ("P014", "P015", "P016", "P017")


class Starter:
    """Holds 100 + address everywhere, but at the addresses that it lacks; `script` comes first."""

    def __init__(self, *, lacks: Iterable[int] = (), script: Iterable[Outcome] = ()) -> None:
        self.asked: list[tuple[int, int]] = []
        self._lacks = set(lacks)
        self._script = list(script)

    async def ask(self, request: Request) -> Outcome:
        start, count = request.address, request.count  # type: ignore[attr-defined]  # a register read
        self.asked.append((start, count))
        if self._script:
            return self._script.pop(0)
        run = range(start, start + count)
        if self._lacks.intersection(run):
            return Refused(2, at_s=0.0)
        return Answered(tuple(100 + address for address in run), at_s=0.0, response_time_s=0.0)


def read(starter: Starter, **options: Any) -> BulkReading:
    reads = bulk_reads(PROFILE, CODES)
    return run_virtually(read_in_bulk(starter.ask, PROFILE, reads, **options))


@pytest.mark.parametrize(
    ("lacks", "asked"),
    [
        (set(), [(14, 4)]),  # neighbours at once
        ({16}, [(14, 4), (14, 2), (16, 2), (16, 1), (17, 1)]),
    ],
)
def test_the_one_row_that_is_refused_is_found_and_the_others_are_read(
    lacks: set[int], asked: list[tuple[int, int]]
) -> None:
    starter = Starter(lacks=lacks)

    found = read(starter)

    rows = {f"P0{address}": (100 + address,) for address in range(14, 18) if address not in lacks}
    assert found.rows == rows
    assert found.refused == {f"P0{address}": "illegal data address" for address in lacks}
    assert starter.asked == asked


@pytest.mark.parametrize("outcome", [Silent(), Garbled("bad CRC", b""), Refused(6, at_s=0.0)])
def test_what_passes_is_tried_again(outcome: Outcome) -> None:
    assert set(read(Starter(script=[outcome, outcome])).rows) == set(CODES)


@pytest.mark.parametrize("tries", [1, 3])
def test_a_starter_that_never_answers_ends_it(tries: int) -> None:
    starter = Starter(script=[Silent()] * tries)

    with pytest.raises(CommandError, match="P014 to P017"):
        read(starter, tries=tries)

    assert len(starter.asked) == tries


def test_a_lost_port_ends_it_at_once() -> None:
    with pytest.raises(PortLostError):
        read(Starter(script=[Silent("port closed", is_sent=False)]))
