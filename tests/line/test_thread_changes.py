"""Lines that come to the thread and leave it while the others are served; real threads, a real clock."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterator

import pytest

from gateway.line.port.base import Port
from gateway.line.rtu.outcome import Answered
from gateway.line.thread import LineHost
from tests.line.fakes import FakeOpener, FakePort, Units
from tests.line.hosted import NO_PORT, WaitingListener, add, ask, fake_opener


@pytest.fixture(autouse=True)
def _switch_interval() -> Iterator[None]:
    before_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before_s)


class LateOpener(FakeOpener):
    """One port that cannot be opened again before it is closed, which takes a while."""

    users = 0

    def __init__(self) -> None:
        super().__init__(lambda: FakePort(Units({1})))
        self.most_users = 0

    async def __call__(self) -> Port:
        LateOpener.users += 1
        self.most_users = LateOpener.users
        return await super().__call__()

    async def wait_closed(self) -> None:
        await asyncio.sleep(0.05)
        LateOpener.users -= 1


async def test_a_line_that_is_added_later_is_served_and_one_that_is_removed_no_more() -> None:
    listener = WaitingListener()
    host = LineHost(listener.handle)
    stays = add(host, fake_opener(), "stays", every_s=0.0)
    goes = add(host, opener := fake_opener(), "goes", every_s=0.0)
    await host.start()
    await listener.wait_for("goes poll a")

    ended = host.remove_line("goes")
    events = len([text for text in listener.order if text.startswith("goes")])
    await ended
    comes = add(host, fake_opener(), "comes")
    await listener.wait_for("comes poll a")
    await listener.wait_for("stays poll a")
    outcomes = [await ask(stays), await ask(comes), await ask(goes)]
    await host.stop()

    assert [type(outcome) for outcome in outcomes[:2]] == [Answered, Answered]
    assert outcomes[2] == NO_PORT
    assert opener.ports[0].is_closed
    assert len([text for text in listener.order if text.startswith("goes")]) == events
    assert set(host.progress()) == {"stays", "comes"}


async def test_a_line_of_the_same_name_begins_when_the_ports_of_those_before_are_closed() -> None:
    listener = WaitingListener()
    host = LineHost(listener.handle)
    add(host, LateOpener(), every_s=0.0)
    await host.start()
    await listener.wait_for("pumps poll a")

    ended = host.remove_line("pumps")
    add(host, again := LateOpener())
    await listener.wait_for("pumps port True")
    await ended
    await host.stop()

    assert again.most_users == 1
