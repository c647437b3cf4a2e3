"""The lines' thread; real threads and a real clock, but no waiting longer than a few transactions."""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
from collections.abc import Iterator
from itertools import pairwise

import pytest

from gateway.line import thread as host_module
from gateway.line.client import LineClient
from gateway.line.port.base import Port
from gateway.line.rtu.transaction import Answered, Outcome, Silent
from gateway.line.scheduler.requests import Priority
from gateway.line.thread import SWITCH_INTERVAL_S
from tests.line.line_rig import READ, LineRig, Wires, poll

NO_PORT = Silent("port closed", is_sent=False)
RARE, OFTEN = poll("a", every_s=10.0), poll("a", every_s=0.0)


@pytest.fixture(autouse=True)
def _switch_interval() -> Iterator[None]:
    before_s = sys.getswitchinterval()
    yield
    sys.setswitchinterval(before_s)


async def ask(line: LineClient) -> Outcome:
    return await line.transact(1, READ, response_time_s=1.0, lane=Priority.COMMAND)


async def test_the_app_transacts_on_lines_that_run_in_a_thread_of_their_own() -> None:
    rig = LineRig(Wires(), RARE, has_thread=True)
    assert await ask(rig.line) == NO_PORT

    async with rig:
        await rig.until("pumps poll a")
        outcomes = await asyncio.gather(*(ask(rig.line) for _ in range(5)))

    assert all(isinstance(outcome, Answered) and outcome.value == (1, 2) for outcome in outcomes)
    assert rig.order == ["pumps port True", "pumps unit 1", "pumps poll a"]
    assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
    assert "lines" not in [thread.name for thread in threading.enumerate()]
    assert await ask(rig.line) == NO_PORT
    await rig.host.stop()  # once more does no harm


async def test_a_line_with_a_bug_is_started_again_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(host_module, "RESTART_PAUSE_S", 0.01)
    monkeypatch.setattr(host_module, "STATISTICS_EVERY_S", 0.01)
    wires = Wires(name="broken")
    wires.bug = RuntimeError("bug")
    async with LineRig(wires, RARE, has_thread=True) as rig:
        sound = rig.add(Wires(name="sound"), OFTEN)
        await rig.until("sound poll a")
        assert await ask(rig.line) == NO_PORT
        assert isinstance(await ask(sound), Answered)
        wires.bug = None
        await rig.until("broken poll a")
        while rig.line.statistics()["polls"] == 0:
            await rig.until("sound poll a")
        progress = rig.host.progress()

    assert rig.line.statistics()["crashes"] >= 1
    assert (sound.statistics()["crashes"], sound.statistics()["answered"] > 1) == (0, True)
    assert progress.keys() == {"broken", "sound"}
    assert all(progress.values())
    crash = next(record for record in caplog.records if "line=broken crashed" in record.getMessage())
    assert crash.levelno == logging.ERROR
    assert crash.exc_info is not None


async def test_frames_are_handed_on_to_the_app_while_it_captures() -> None:
    frames: asyncio.Queue[tuple[str, float, str, bytes]] = asyncio.Queue()

    def note(*frame: object) -> None:
        assert threading.current_thread() is threading.main_thread()
        frames.put_nowait(frame)  # type: ignore[arg-type] # what OnFrame says

    async with LineRig(Wires(), OFTEN, has_thread=True) as rig:
        rig.add(Wires(name="fans"), OFTEN)
        rig.host.capture(note)
        async with asyncio.timeout(10.0):
            seen = [await frames.get() for _ in range(8)]
        rig.host.capture(None)

    assert {line for line, *_ in seen} == {"pumps", "fans"}
    directions = [direction for line, _, direction, _ in seen if line == "pumps"]
    assert set(directions) <= {">>", "<<"}
    assert all(first != second for first, second in pairwise(directions))


class LateWires(Wires):
    """A port that cannot be opened again before it is closed, which takes a while."""

    users = most_users = 0

    async def __call__(self) -> Port:
        LateWires.users += 1
        LateWires.most_users = max(LateWires.users, LateWires.most_users)
        return await super().__call__()

    async def wait_closed(self) -> None:
        await asyncio.sleep(0.05)
        LateWires.users -= 1


async def test_a_line_that_is_removed_is_silent_and_one_of_its_name_begins_once_its_port_is_closed() -> None:
    async with LineRig(LateWires(), OFTEN, has_thread=True) as rig:
        stays = rig.add(Wires(name="stays"), OFTEN)
        await rig.until("pumps poll a")

        ended = rig.host.remove_line("pumps")
        events = sum(words.startswith("pumps") for words in rig.order)
        comes = rig.add(Wires(name="comes"), RARE)
        await rig.until("comes poll a")
        await rig.until("stays poll a")
        assert await ask(rig.line) == NO_PORT
        assert [type(await ask(line)) for line in (stays, comes)] == [Answered, Answered]
        assert sum(words.startswith("pumps") for words in rig.order) == events
        again = rig.add(LateWires(), OFTEN)
        await rig.until("pumps port True")
        await ended
        assert isinstance(await ask(again), Answered)
        assert rig.host.progress().keys() == {"pumps", "stays", "comes"}

    assert LateWires.most_users == 1
