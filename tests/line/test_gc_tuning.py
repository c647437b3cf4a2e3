"""What the garbage collector does not look at."""

from __future__ import annotations

import asyncio
import gc
import subprocess
import sys

import pytest

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


THREADS = """
import re, threading
from gateway.system.gc_tuning import use_one_arena
{first}
held, done = [], threading.Barrier(5)
def work():
    held.append([bytes(5000) for _ in range(100)])
    done.wait(20)
for _ in range(4):
    threading.Thread(target=work, daemon=True).start()
done.wait(20)
maps = open("/proc/self/maps").read()
sizes = [(int(b, 16) - int(a, 16)) >> 20 for a, b in re.findall(r"(\\w+)-(\\w+) ---p", maps)]
print(sum(30 < size <= 64 for size in sizes))
"""


def test_threads_share_one_arena_of_malloc() -> None:
    reserved = [
        int(subprocess.check_output([sys.executable, "-c", THREADS.format(first=first)], timeout=60))
        for first in ("", "use_one_arena()")
    ]

    if not reserved[0]:
        pytest.skip("this malloc reserves no arena for a thread")
    assert reserved[1] == 0
