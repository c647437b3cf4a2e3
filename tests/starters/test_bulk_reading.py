"""Many rows of one starter: refusals, silence, a busy starter."""

from __future__ import annotations

from collections.abc import Iterable

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
WHOLE = (14, 4)


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

    def read(self, tries: int = 3) -> BulkReading:
        return run_virtually(read_in_bulk(self.ask, PROFILE, bulk_reads(PROFILE, CODES), tries=tries))


@pytest.mark.parametrize(
    ("lacks", "script", "asked"),
    [
        (set(), [], [WHOLE]),  # neighbours at once
        ({16}, [], [WHOLE, (14, 2), (16, 2), (16, 1), (17, 1)]),  # the one that is refused is found
        *((set(), [each, each], [WHOLE] * 3) for each in (Silent(), Garbled("", b""), Refused(6, at_s=0.0))),
    ],
)
def test_all_rows_are_read_that_are_not_refused_alone(
    lacks: set[int], script: list[Outcome], asked: list[tuple[int, int]]
) -> None:
    starter = Starter(lacks=lacks, script=script)

    found = starter.read()

    assert found.rows == {f"P0{at}": (100 + at,) for at in range(14, 18) if at not in lacks}
    assert found.refused == {f"P0{at}": "illegal data address" for at in lacks}
    assert starter.asked == asked


@pytest.mark.parametrize("tries", [1, 3])
def test_a_starter_that_never_answers_ends_it(tries: int) -> None:
    starter = Starter(script=[Silent()] * tries)

    with pytest.raises(CommandError, match="P014 to P017"):
        starter.read(tries)

    assert len(starter.asked) == tries


def test_a_lost_port_ends_it_at_once() -> None:
    with pytest.raises(PortLostError):
        Starter(script=[Silent("port closed", is_sent=False)]).read()
