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


def test_what_is_there_when_all_is_settled_is_not_looked_through_until_the_end() -> None:
    async def scenario() -> list[bool]:
        collector = TunedCollector()
        collector.spare()
        assert gc.get_threshold() == THRESHOLDS
        thing = Cyclic()
        looked = [is_looked_through(thing)]
        await asyncio.sleep(SETTLED_S[0] + 1.0)
        looked.append(is_looked_through(thing))
        collector.end()
        return [*looked, is_looked_through(thing)]

    before = gc.get_threshold()

    assert run_virtually(scenario()) == [True, False, True]
    assert gc.get_threshold() == before
