"""Several works at once, of which the first that ends, ends the others."""

from __future__ import annotations

import asyncio

import pytest

from gateway.system.supervised import until_first
from tests.virtual_time import run_virtually


@pytest.mark.parametrize(
    ("cancelled_at_s", "expected"),
    [(9.0, ["2 ended", "5 cancelled"]), (1.0, ["5 cancelled", "2 cancelled"])],
)
def test_the_first_that_ends_or_a_cancellation_ends_the_others_in_order(
    cancelled_at_s: float, expected: list[str]
) -> None:
    said: list[str] = []

    async def after(seconds: float) -> None:
        try:
            await asyncio.sleep(seconds)
        except asyncio.CancelledError:
            await asyncio.sleep(1.0)  # it ends in order
            said.append(f"{seconds:g} cancelled")
            raise
        said.append(f"{seconds:g} ended")

    async def work() -> None:
        task = asyncio.ensure_future(until_first(after(5.0), after(2.0)))
        await asyncio.wait((task,), timeout=cancelled_at_s)
        task.cancel()
        await asyncio.wait((task,))

    run_virtually(work())

    assert said == expected
