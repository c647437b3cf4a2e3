"""Several works at once, of which the first that ends, ends the others."""

from __future__ import annotations

import asyncio

from gateway.system.supervised import until_first
from tests.virtual_time import run_virtually


async def after(seconds: float, said: list[str], *, error: Exception | None = None) -> None:
    try:
        await asyncio.sleep(seconds)
    except asyncio.CancelledError:
        await asyncio.sleep(1.0)  # it ends in order
        said.append(f"{seconds:g} cancelled")
        raise
    said.append(f"{seconds:g} ended")
    if error is not None:
        raise error


def test_the_first_that_ends_ends_the_others_in_order() -> None:
    said: list[str] = []

    run_virtually(until_first(after(5.0, said), after(2.0, said), after(9.0, said)))

    assert said == ["2 ended", "5 cancelled", "9 cancelled"]


def test_who_is_cancelled_cancels_them_all() -> None:
    said: list[str] = []

    async def cancelled() -> None:
        work = asyncio.ensure_future(until_first(after(5.0, said), after(2.0, said)))
        await asyncio.sleep(1.0)
        work.cancel()
        await asyncio.wait((work,))
        assert work.cancelled()

    run_virtually(cancelled())

    assert said == ["5 cancelled", "2 cancelled"]
