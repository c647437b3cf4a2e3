from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Iterable

import pytest

from gateway.line.rtu.outcome import Answered, Garbled
from gateway.modbus import adu
from tests.line.fakes import ALTERNATES, RESPONSE_TIME_S, TIMING, LineRig, Said, Units, poll
from tests.line.served import run_for
from tests.virtual_time import run_virtually


def test_a_garbled_poll_is_reported_only_when_its_repetition_is_no_better() -> None:
    replies = iter([b"\x01\x03\x00", None, b"\x01\x03\x00", b"\x01\x03\x00"])

    def answer(frame: bytes) -> Iterable[Said]:
        corrupted = next(replies, None)
        return Units({1})(frame) if corrupted is None else [Said(corrupted)]

    rig = run_for(1.9, answer, [poll("a")])

    first, second, *_ = rig.listener.outcomes("a")
    assert isinstance(first, Answered)
    assert isinstance(second, Garbled)
    assert rig.line.statistics()["garbled"] == 3


def test_a_bug_on_the_line_ends_its_loop_with_the_port_closed_and_it_can_be_started_again() -> None:
    def answer(frame: bytes) -> Iterable[Said]:
        if not has_failed:
            has_failed.append(True)
            raise RuntimeError("bug")
        return Units({1})(frame)

    has_failed: list[bool] = []
    rig = LineRig(answer, [poll("a")])

    async def scenario() -> None:
        async with rig:
            await asyncio.wait([rig.task])
            assert isinstance(rig.task.exception(), RuntimeError)
            assert rig.port.is_closed
            rig.task = asyncio.create_task(rig.line.run())
            await asyncio.sleep(3.0)

    run_virtually(scenario())

    assert len(rig.listener.outcomes("a")) == 4


def test_polls_can_be_added_removed_expedited_and_changed_while_the_line_idles() -> None:
    rig = LineRig(Units({1}), [])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(1.25)
            rig.client.add_poll(poll("a", every_s=100.0))
            await asyncio.sleep(1.0)
            rig.client.expedite("a")
            await asyncio.sleep(1.0)
            rig.client.set_every("a", 0.5)
            await asyncio.sleep(0.9)
            rig.client.remove_poll("a")
            await asyncio.sleep(10.0)

    run_virtually(scenario())

    sent_s = [at_s for at_s, _ in rig.port.sent]
    assert sent_s == pytest.approx([1.25, 2.25, 3.75], abs=0.001)


def test_an_expected_silence_is_not_reported() -> None:
    units = Units({1})
    rig = LineRig(units, [poll("a", every_s=0.5)])

    async def scenario() -> None:
        async with rig:
            await asyncio.sleep(2.0)
            rig.client.expect_silence(1, 8.0)
            units.alive.clear()
            await asyncio.sleep(6.0)
            units.alive.add(1)
            await asyncio.sleep(5.0)

    run_virtually(scenario())

    assert [event[2] for event in rig.listener.units] == [True]


def test_progress_grows_while_the_line_idles_and_while_its_port_is_away() -> None:
    rig = LineRig(Units({1}), [])

    async def scenario() -> list[int]:
        seen = []
        async with rig:
            for _ in range(3):
                seen.append(rig.line.progress)
                await asyncio.sleep(2.5)
            rig.opener.failure = "no such port"
            rig.port.hang_up()
            for _ in range(3):
                seen.append(rig.line.progress)
                await asyncio.sleep(10.5)
        return seen

    seen = run_virtually(scenario())

    assert all(earlier < later for earlier, later in itertools.pairwise(seen))


def test_the_computed_stop_latency_is_the_longest_poll_unanswered() -> None:
    rig = LineRig(Units({1}), [poll("a", count=1), poll("b", count=100)])

    latency_s = rig.client.statistics()["stop_latency_s"]["computed"]

    wire_s = TIMING.wire_s(8 + 205 + 2 * ALTERNATES)  # asked in the longest of its alternate forms
    assert latency_s == pytest.approx(wire_s + 2 * RESPONSE_TIME_S + 0.02 + TIMING.silence_s)
    assert rig.client.name == "pumps"
    assert rig.client.timing is TIMING


def test_frames_are_logged_in_hex_at_debug_only(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "gateway.line")

    rig = run_for(0.5, Units({1}), [poll("a")])

    shown = [record.getMessage() for record in caplog.records if " >> " in record.getMessage()]
    assert len(shown) == 1
    assert shown[0].endswith(rig.port.sent[0][1].hex(" "))
    assert adu.decode(rig.port.sent[0][1]).unit == 1
