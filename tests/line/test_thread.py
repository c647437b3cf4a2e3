"""The lines' thread; real threads and a real clock, but no waiting longer than a few transactions."""

from __future__ import annotations

import asyncio
import itertools
import logging
import sys
import threading
from collections.abc import Iterator

import pytest

from gateway.line import thread as host_module
from gateway.line.port.base import Port
from gateway.line.rtu.outcome import Answered
from gateway.line.thread import SWITCH_INTERVAL_S, LineHost
from tests.line.fakes import FakeOpener, FakePort, Units
from tests.line.hosted import LONG_S, NO_PORT, WaitingListener, add, ask, fake_opener


@pytest.fixture(autouse=True)
def _switch_interval() -> Iterator[None]:
    before_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before_s)


class BrokenOpener(FakeOpener):
    """An opener with a bug."""

    def __init__(self) -> None:
        super().__init__(lambda: FakePort(Units({1})))
        self.has_bug = True

    async def __call__(self) -> FakePort:
        if self.has_bug:
            raise RuntimeError("bug")
        return await super().__call__()


async def test_the_app_transacts_on_lines_that_run_in_a_thread_of_their_own() -> None:
    listener = WaitingListener()
    host = LineHost(listener.handle)
    line = add(host, opener := fake_opener())
    assert await ask(line) == NO_PORT

    await host.start()
    await listener.wait_for("pumps poll a")
    outcomes = await asyncio.gather(*(ask(line) for _ in range(5)))
    await host.stop()

    assert all(isinstance(outcome, Answered) and outcome.value == (100, 101) for outcome in outcomes)
    assert listener.order == ["pumps port True", "pumps unit 1", "pumps poll a"]
    assert opener.ports[0].is_closed
    assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
    assert "lines" not in [thread.name for thread in threading.enumerate()]
    assert await ask(line) == NO_PORT
    await host.stop()  # once more does no harm


async def test_a_line_with_a_bug_is_started_again_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(host_module, "RESTART_PAUSE_S", 0.01)
    monkeypatch.setattr(host_module, "STATISTICS_EVERY_S", 0.01)
    listener = WaitingListener()
    host = LineHost(listener.handle)
    broken = add(host, opener := BrokenOpener(), "broken")
    sound = add(host, fake_opener(), "sound", every_s=0.0)

    await host.start()
    await listener.wait_for("sound poll a")
    assert await ask(broken) == NO_PORT
    assert isinstance(await ask(sound), Answered)
    opener.has_bug = False
    await listener.wait_for("broken poll a")
    while broken.statistics()["polls"] == 0:
        await listener.wait_for("sound poll a")
    progress = host.progress()
    await host.stop()

    assert broken.statistics()["crashes"] >= 1
    assert sound.statistics()["crashes"] == 0
    assert sound.statistics()["answered"] > 1
    assert set(progress) == {"broken", "sound"}
    assert all(progress.values())
    crash = next(record for record in caplog.records if "line=broken crashed" in record.getMessage())
    assert crash.levelno == logging.ERROR
    assert crash.exc_info is not None


async def test_frames_are_handed_on_to_the_app_while_it_captures() -> None:
    listener = WaitingListener()
    host = LineHost(listener.handle)
    add(host, fake_opener(), "pumps", every_s=0.0)
    add(host, fake_opener(), "fans", every_s=0.0)
    frames: asyncio.Queue[tuple[str, float, str, bytes]] = asyncio.Queue()

    def note(*frame: object) -> None:
        assert threading.current_thread() is threading.main_thread()
        frames.put_nowait(frame)  # type: ignore[arg-type] # what OnFrame says

    await host.start()
    host.capture(note)
    async with asyncio.timeout(LONG_S):
        seen = [await frames.get() for _ in range(8)]
    host.capture(None)
    await host.stop()

    assert {line for line, *_ in seen} == {"pumps", "fans"}
    directions = [direction for line, _, direction, _ in seen if line == "pumps"]
    assert {">>", "<<"} >= set(directions)
    assert all(first != second for first, second in itertools.pairwise(directions))


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
