from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from gateway.line.port.buffered import ImmediateFuture


async def begun(wakeup: ImmediateFuture, then: Callable[[], object]) -> asyncio.Task[None]:
    """Return a task that waits for this already."""

    async def wait() -> None:
        await wakeup
        then()

    task = asyncio.create_task(wait())
    await asyncio.sleep(0)
    return task


async def test_a_task_goes_on_within_the_callback_that_wakes_it() -> None:
    loop = asyncio.get_running_loop()
    wakeup = ImmediateFuture(loop)
    order: list[str] = []
    task = await begun(wakeup, lambda: order.append("task"))

    def wake() -> None:
        wakeup.wake()
        order.append("after the call")

    loop.call_soon(wake)
    await task

    assert order == ["task", "after the call"]


async def test_a_task_that_is_woken_by_another_one_goes_on_when_that_one_waits() -> None:
    wakeup = ImmediateFuture(asyncio.get_running_loop())
    order: list[str] = []
    task = await begun(wakeup, lambda: order.append("woken"))

    wakeup.wake()
    order.append("waker")
    await task

    assert order == ["waker", "woken"]


async def test_what_is_woken_before_anyone_waits_is_not_waited_for() -> None:
    wakeup = ImmediateFuture(asyncio.get_running_loop())

    wakeup.wake()
    wakeup.wake()
    await wakeup

    assert wakeup.done()
    assert not wakeup.cancel()


async def test_a_task_that_waits_can_be_cancelled() -> None:
    wakeup = ImmediateFuture(asyncio.get_running_loop())
    task = await begun(wakeup, lambda: None)

    task.cancel()

    with pytest.raises(asyncio.CancelledError):
        await task
    assert wakeup.done()
    wakeup.wake()  # nobody is left


async def test_to_be_cancelled_before_anyone_waits_is_told_to_the_first_who_does() -> None:
    wakeup = ImmediateFuture(asyncio.get_running_loop())

    assert wakeup.cancel()

    with pytest.raises(asyncio.CancelledError):
        await wakeup


async def test_a_time_limit_around_it_works() -> None:
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.001):
            await ImmediateFuture(asyncio.get_running_loop())


async def test_a_task_that_fails_when_it_is_woken_does_not_fail_its_waker() -> None:
    loop = asyncio.get_running_loop()
    wakeup = ImmediateFuture(loop)

    def fail() -> None:
        raise ValueError("of the task")

    task = await begun(wakeup, fail)
    loop.call_soon(wakeup.wake)

    with pytest.raises(ValueError, match="of the task"):
        await task


async def test_the_task_that_runs_is_known_while_it_goes_on() -> None:
    loop = asyncio.get_running_loop()
    wakeup = ImmediateFuture(loop)
    seen: list[asyncio.Task[None] | None] = []
    task = await begun(wakeup, lambda: seen.append(asyncio.current_task()))

    loop.call_soon(wakeup.wake)
    await task

    assert seen == [task]
