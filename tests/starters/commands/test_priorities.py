"""Which lane of the line a command takes, how late its write may be, and how many may wait."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from gateway.line.scheduler.requests import Priority
from gateway.modbus.pdu import Request
from gateway.modbus.reads import ReadHoldingRegisters
from gateway.records import Phase
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from tests.starters.fakes import TRANSACTION_S
from tests.starters.plant import Plant
from tests.starters.rig import virtually
from tests.starters.rules import ready


@pytest.mark.parametrize(
    ("verb", "args", "lanes"),
    [
        ("start", {}, {Priority.COMMAND, Priority.READ_BACK}),
        ("stop", {}, {Priority.STOP, Priority.FOLLOW_UP}),
        ("read", {"parameter": "P003"}, {Priority.PARAMETERS}),
        ("set", {"parameter": "P314", "value": 30}, {Priority.PARAMETERS}),
    ],
)
@virtually
async def test_what_moves_no_motor_lets_the_rest_pass_on_the_line(
    verb: str, args: dict[str, Any], lanes: set[Priority]
) -> None:
    rig = await ready()

    rig.submit(verb, args=args)
    await rig.poll_for(5.0)

    vb00 = ReadHoldingRegisters(5000, 1)  # now and then, whether it is still the same device
    assert {sent.lane for sent in rig.line.sent if sent.request != vb00} == lanes


@virtually
async def test_a_start_whose_slot_on_the_line_comes_when_it_is_no_longer_valid_is_never_written() -> None:
    rig = await ready()

    def delay(request: Request) -> None:
        """Occupy the line until the start is too old, right after the reading that allowed it."""
        rig.line.rules.clear()
        asyncio.get_running_loop().create_task(occupy())

    async def occupy() -> None:
        async with rig.line._bus:
            await asyncio.sleep(1.0)

    rig.line.rules.append(delay)
    rig.submit("start", expires_s=rig.clock.now_s() + TRANSACTION_S + 0.5)
    await asyncio.sleep(5.0)

    final = rig.sink.final()
    assert (final.phase, final.code) == (Phase.REJECTED, "expired")
    assert "nothing was written" in final.text
    assert rig.starts() == 0


@virtually
async def test_a_start_that_was_written_in_time_is_read_back_however_long_that_takes() -> None:
    rig = await ready()

    rig.submit("start", expires_s=rig.clock.now_s() + 2.5 * TRANSACTION_S)
    await asyncio.sleep(5.0)

    assert rig.sink.final().phase is Phase.CONFIRMED


@virtually
async def test_reads_that_would_wait_too_long_for_their_share_of_a_line_are_refused_and_starts_are_not() -> (
    None
):
    policy = PolicySettings(limits=RateLimits(parameters_on_line=2))
    plant = await Plant(None, "a@x", "b@x", "c@x", "d@x", "e@y", policy=policy).online()
    for name in "abce":
        plant.submit("read", name, starter=name, args={"parameter": "P003"})
    plant.submit("start", "d", starter="d")
    await plant.wait(5.0)

    assert {name: plant.sink.final(name).code for name in "abcde"} == {
        "a": "ok",
        "b": "ok",
        "c": "too_many",
        "d": "ok",
        "e": "ok",
    }
    assert "reads and settings" in plant.sink.final("c").text
