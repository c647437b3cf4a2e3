"""What the garbage collector does not look at."""

from __future__ import annotations

import asyncio
import gc

from gateway.system.gc_tuning import SETTLED_S, THRESHOLDS, TunedCollector
from tests.virtual_time import run_virtually


class Cyclic:
    """Something that stays."""


def is_looked_through(thing: object) -> bool:
    return any(each is thing for each in gc.get_objects())


def test_what_is_there_when_all_is_settled_is_not_looked_through_any_more() -> None:
    async def scenario() -> list[bool]:
        collector = TunedCollector()
        collector.spare()
        thing = Cyclic()
        looked = [is_looked_through(thing)]
        await asyncio.sleep(SETTLED_S[0] + 1.0)
        looked.append(is_looked_through(thing))
        collector.end()
        return [*looked, is_looked_through(thing)]

    assert run_virtually(scenario()) == [True, False, True]


def test_afterwards_collection_is_as_it_was_before() -> None:
    async def scenario() -> tuple[int, int, int]:
        collector = TunedCollector()
        collector.spare()
        meanwhile = gc.get_threshold()
        collector.end()
        return meanwhile

    before = gc.get_threshold()

    assert run_virtually(scenario()) == THRESHOLDS
    assert gc.get_threshold() == before
