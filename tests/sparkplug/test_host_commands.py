"""DCMDs as they arrive: floods, what is too large or broken, and the stops among them."""

from __future__ import annotations

import asyncio
import random
import time
from collections import Counter
from collections.abc import Collection
from typing import Any

import pytest

from gateway.mqtt.contract.commands import Incoming, Rejection
from gateway.mqtt.contract.topics import Topics
from gateway.sparkplug.commands import CommandMapper
from gateway.sparkplug.host_commands import (
    DECODED,
    MOST_BYTES,
    REFUSED_EVERY_S,
    SHORT_BYTES,
    HostCommands,
)
from tests.sparkplug.support import dcmd, write
from tests.virtual_time import VirtualClock, run_virtually

BROKEN_TAIL = b"\x12\x50abc"


class Rig:
    """Takes DCMDs for two starters, born a minute ago."""

    def __init__(self) -> None:
        self.clock = VirtualClock(asyncio.get_running_loop())
        self.taken: list[Incoming] = []
        self.rejected: list[Rejection] = []
        self.events: list[tuple[str, str, dict[str, Any]]] = []
        self.done: list[tuple[str, set[str]]] = []
        self.commands = HostCommands(
            CommandMapper(Topics("b"), "ops", ttl_s=5.0),
            clock=self.clock,
            take=self.taken.append,
            reject=self.rejected.append,
            publish_event=lambda code, _, text, data=None, /: self.events.append(
                (code, text, dict(data or {}))
            ),
            show_done=self._show_done,
        )

    def _show_done(self, starter: str, names: Collection[str]) -> None:
        self.done.append((starter, set(names)))

    def get(self, payload: bytes, starter: str = "pump", *, is_retained: bool = False) -> None:
        incoming = Incoming(f"spBv1.0/g/DCMD/n/{starter}", payload, is_retained=is_retained)
        self.commands.take(starter, incoming, self.clock.utc_s() - 60.0)

    def write(self, *names: str, **more: Any) -> bytes:
        return dcmd(*(write(name, **more) for name in names), time_s=self.clock.utc_s())

    @property
    def verbs(self) -> Counter[str]:
        return Counter(each.topic.rpartition("/")[2] for each in self.taken)

    @property
    def codes(self) -> Counter[str]:
        return Counter(each.code for each in self.rejected)


def run(scenario: Any) -> None:
    async def main() -> None:
        await scenario(Rig())

    run_virtually(main())


@pytest.mark.parametrize("size", [MOST_BYTES + 1, 60_000, 130_000])
@pytest.mark.parametrize("is_retained", [True, False])
def test_what_is_too_large_is_not_decoded_but_counted_once_a_second(size: int, is_retained: bool) -> None:
    async def scenario(rig: Rig) -> None:
        for _ in range(1000):
            rig.get(rig.write("Command/Start") + b"\x12\x00" * (size // 2), is_retained=is_retained)
            await asyncio.sleep(0.01)
        await asyncio.sleep(2.0)

        assert rig.taken == []
        assert 10 <= len(rig.events) <= 12
        assert sum(data["count"] for _, _, data in rig.events) == 1000
        assert {(code, data["code"]) for code, _, data in rig.events} == {("dcmd_refused", "too_big")}
        assert rig.codes == {"too_big": len(rig.events)}
        assert len({each.request.id for each in rig.rejected}) == len(rig.rejected)
        assert rig.done[0] == ("pump", {"Command/Stop", "Command/Start", "Command/Reset"})

    run(scenario)


def test_what_is_as_large_as_allowed_is_decoded() -> None:
    async def scenario(rig: Rig) -> None:
        start = rig.write("Command/Start")
        rig.get(start + b"\x12\x00" * ((MOST_BYTES - len(start)) // 2))

        assert rig.verbs == {"start": 1}
        assert rig.codes["too_many"] == 1  # of the metrics beyond the most that are looked into

    run(scenario)


def test_in_a_flood_every_stop_acts_and_of_all_else_a_few_a_second_are_looked_into() -> None:
    async def scenario(rig: Rig) -> None:
        for place in range(2000):
            rig.get(rig.write("Command/Reset"))
            if place % 100 == 50:
                rig.get(rig.write("Command/Stop"), "fan")
            await asyncio.sleep(0.001)
        await asyncio.sleep(2.0)

        assert rig.verbs["stop"] == 20
        assert rig.verbs["reset"] <= DECODED.burst + 2.0 * DECODED.per_s
        counts = [data["count"] for _, _, data in rig.events if data["code"] == "too_many"]
        assert sum(counts) + rig.verbs["reset"] == 2000
        assert len(counts) <= 2.0 / REFUSED_EVERY_S + 2

    run(scenario)


def test_beyond_the_rate_a_stop_acts_and_what_stands_beside_it_does_not() -> None:
    async def scenario(rig: Rig) -> None:
        for _ in range(DECODED.burst):
            rig.get(rig.write("Command/Reset"))
        rig.taken.clear()

        rig.get(rig.write("Command/Start"))
        rig.get(dcmd(write("Command/Stop", value=False), write("Command/Start"), time_s=rig.clock.utc_s()))
        assert rig.taken == []
        rig.get(rig.write("Command/Start", "Command/Stop", "Command/Reset"))
        assert rig.verbs == {"stop": 1}

        await asyncio.sleep(1.0)
        rig.get(rig.write("Command/Start"))
        assert rig.verbs == {"stop": 1, "start": 1}

    run(scenario)


def test_beyond_the_rate_what_is_long_is_not_looked_into_and_a_short_stop_acts() -> None:
    """Many empty metrics before a stop, and a broken tail, are what takes the longest to read."""

    async def scenario(rig: Rig) -> None:
        long = b"\x12\x00" * SHORT_BYTES + rig.write("Command/Stop") + b"\xff"
        for _ in range(DECODED.burst):
            rig.get(rig.write("Command/Other"))
        rig.get(long)
        assert rig.verbs["stop"] == 0

        rig.get(rig.write("Command/Stop"))
        assert rig.verbs["stop"] == 1
        assert rig.codes["bad_payload"] == 0

    run(scenario)


def test_a_stop_that_is_whole_acts_in_a_payload_that_is_broken_off_and_a_start_does_not() -> None:
    async def scenario(rig: Rig) -> None:
        rig.get(rig.write("Command/Start", "Command/Stop") + BROKEN_TAIL)

        assert rig.verbs == {"stop": 1}
        ((code, text, data),) = rig.events
        assert (code, data) == ("dcmd_refused", {"starter": "pump", "code": "bad_payload", "count": 1})
        assert text == (
            "pump: a DCMD refused: it cannot be read as a whole: its stop is taken, nothing else of it acts"
        )
        assert rig.codes == {"bad_payload": 1}

    run(scenario)


def test_a_retained_stop_is_judged_as_retained_also_in_a_broken_payload() -> None:
    async def scenario(rig: Rig) -> None:
        rig.get(rig.write("Command/Stop"), is_retained=True)
        rig.get(rig.write("Command/Stop") + BROKEN_TAIL, is_retained=True)

        assert [each.is_retained for each in rig.taken] == [True, True]

    run(scenario)


def test_what_is_garbage_or_broken_within_the_stop_stops_nothing_and_is_said_once_a_second() -> None:
    async def scenario(rig: Rig) -> None:
        chance = random.Random(1)
        stop = rig.write("Command/Stop")
        for _ in range(3000):
            cut = chance.randrange(1, len(stop) - 9)  # the time stands before the metric
            rig.get(chance.choice([stop[:-cut], chance.randbytes(chance.randrange(1, 300)), b"\x12\x00" * 9]))
            await asyncio.sleep(0.001)
        await asyncio.sleep(2.0)

        assert rig.taken == []
        assert len(rig.events) <= 2 * (3.0 / REFUSED_EVERY_S + 2)

    run(scenario)


def test_every_metric_of_a_dcmd_is_answered_whatever_stands_in_it() -> None:
    async def scenario(rig: Rig) -> None:
        chance = random.Random(2)
        names = [b"Command/Start", b"Command/Reset", b"\xff\xfe", b"", b"current", "\u202e".encode(), b"a\nb"]
        for _ in range(300):
            rig.taken.clear()
            rig.rejected.clear()
            asked = chance.randrange(1, 15)
            payload = b"\x08" + b"\x80\x01" + b"".join(_metric(chance, names) for _ in range(asked))
            rig.get(payload)
            await asyncio.sleep(0.1)  # within what is decoded

            answers = len(rig.taken) + len(rig.rejected)
            assert answers == asked or rig.codes["bad_payload"] >= 1

    run(scenario)


def _metric(chance: random.Random, names: list[bytes]) -> bytes:
    name = chance.choice(names)
    body = b"\x0a" + bytes([len(name)]) + name
    for _ in range(chance.randrange(4)):
        body += chance.choice(
            [b"\x70\x01", b"\x70\x00", b"\x38\x01", b"\x20\x0c", b"\x7a\x01\xff", b"\x28\x01"]
        )
    return b"\x12" + bytes([len(body)]) + body


@pytest.mark.parametrize("stop", [b"", b"Command/Stop"])
def test_the_most_expensive_dcmd_takes_the_loop_a_few_milliseconds(stop: bytes) -> None:
    async def scenario(rig: Rig) -> None:
        filler = b"\x12\x00" * 2000
        payloads = [filler, filler + b"\x12", dcmd(write("Command/Stop", value=False)) + filler + b"\x12"]
        for payload in payloads:
            began_s = time.process_time()
            for _ in range(10):
                rig.get(payload[: MOST_BYTES - len(stop)] + stop)
            assert (time.process_time() - began_s) / 10 < 0.05  # 60 KB took 0.075

    run(scenario)
