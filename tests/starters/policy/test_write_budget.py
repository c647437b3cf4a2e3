"""The non-volatile memory of a starter is not worn out, however often a program sets something."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from gateway.contract import CommandError
from gateway.starters.policy.write_budget import HOUR_S, WriteBudget

ASKED = [  # of a limit of three an hour: what was written when, what is asked for when, the end of a refusal
    ([], (1, 0.0), ""),
    ([(1, 0.0), (1, 600.0), (1, 1200.0)], (1, 1800.0), "try again in 30 min"),
    ([(1, 0.0), (1, 600.0), (1, 1200.0)], (1, HOUR_S), ""),  # the first does not count any more
    ([(1, 0.0), (1, 100.0)], (3, 200.0), "try again in 59 min"),  # there must be room for all
    ([], (4, 0.0), "this command has more"),
    ([(3, 0.0)], (0, 0.0), ""),  # what writes nothing that is stored is never refused
]


@pytest.mark.parametrize(("written", "asked", "refusal"), ASKED)
def test_so_many_writes_an_hour_wear_no_memory_out(
    written: list[tuple[int, float]], asked: tuple[int, float], refusal: str
) -> None:
    wear = WriteBudget(3)
    for writes, now_s in written:
        wear.take("pump", writes, now_s=now_s)
    total = wear.total("pump")

    with pytest.raises(CommandError, match=refusal) if refusal else nullcontext():
        wear.take("pump", asked[0], now_s=asked[1])

    assert wear.total("pump") == total + (0 if refusal else asked[0])
    wear.take("fan", 3, now_s=asked[1])  # each starter has its own count


def test_each_count_is_reported_with_the_hour_and_the_total() -> None:
    values: list[tuple[str, int]] = []
    wear = WriteBudget(10, on_count=lambda *what: values.append(what))
    wear.restore({"pump": 240})

    wear.take("pump", 1, now_s=0.0)
    wear.take("pump", 2, now_s=1.0)
    wear.take("pump", 0, now_s=2.0)

    assert values == [("pump", 1), ("pump", 2)]
    assert (wear.last_hour("pump"), wear.total("pump")) == (3, 243)
    assert wear.totals() == {"pump": 243}
