"""Many rows of one starter: refusals, silence, a busy starter."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gateway.contract import CommandError
from gateway.errors import PortLostError
from gateway.families.profile.load import load_profile
from gateway.families.reading import bulk_reads
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from tests.virtual_time import run_virtually

PROFILE = load_profile("ssw07")
CODES = ("P014", "P015", "P016", "P017")


class Starter:
    """Holds 100 + address everywhere, but at the addresses that it lacks; `script` comes first."""

    def __init__(self, *, lacks: set[int] = frozenset(), script: list[Outcome] | None = None) -> None:  # type: ignore[assignment]
        self.asked: list[tuple[int, int]] = []
        self._lacks = lacks
        self._script = script or []

    async def ask(self, request: Request) -> Outcome:
        start, count = request.address, request.count  # type: ignore[attr-defined]  # a register read
        self.asked.append((start, count))
        if self._script:
            return self._script.pop(0)
        run = range(start, start + count)
        if self._lacks.intersection(run):
            return Refused(2, at_s=0.0)
        return Answered(tuple(100 + address for address in run), at_s=0.0, response_time_s=0.0)


def read(starter: Starter, **options: int) -> BulkReading:
    reads = bulk_reads(PROFILE, CODES)
    return run_virtually(read_in_bulk(starter.ask, PROFILE, reads, **options))


def test_neighbours_are_read_at_once() -> None:
    starter = Starter()

    found = read(starter)

    assert starter.asked == [(14, 4)]
    assert found.rows == {"P014": (114,), "P015": (115,), "P016": (116,), "P017": (117,)}


def test_the_one_row_that_is_refused_is_found_and_the_others_are_read() -> None:
    starter = Starter(lacks={16})

    found = read(starter)

    assert set(found.rows) == {"P014", "P015", "P017"}
    assert found.refused == {"P016": "illegal data address"}
    assert starter.asked == [(14, 4), (14, 2), (16, 2), (16, 1), (17, 1)]


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


def test_each_request_is_reported_when_it_is_done() -> None:
    done: list[tuple[str, ...]] = []
    note: Callable[[object], None] = lambda each: done.append(each.codes)  # type: ignore[attr-defined]  # noqa: E731

    run_virtually(read_in_bulk(Starter().ask, PROFILE, bulk_reads(PROFILE, CODES), on_read=note))

    assert done == [CODES]
