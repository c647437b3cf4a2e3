"""Malformed payloads, in process by the hundred thousand, and some through a real broker."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from itertools import pairwise

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion

from gateway.errors import GatewayError
from gateway.mqtt.contract.commands import CommandParser, Incoming, Rejection
from gateway.mqtt.contract.freshness import Moment, RunToken, Tokens
from gateway.mqtt.contract.topics import Topics
from gateway.records import Phase, ResultRecord
from gateway.starters.policy.start_rules import PolicySettings, RateLimits
from gateway.system.rate_limits import Rate
from tests.lab.torture.command_site import PACE_S, STARTERS, CommandSite
from tests.lab.torture.malformed import BIG_BYTES, Mutator
from tests.lab.torture.recorder import BASE, is_final
from tests.starters.plant import Plant
from tests.virtual_time import run_virtually

NO_LIMIT = Rate(1e9, 10**9)
ROOM = PolicySettings(limits=RateLimits(client=NO_LIMIT, starter=NO_LIMIT, everyone=NO_LIMIT))
BATCH = 500
BIG_ONES = 2
LONGEST_GAP_S = 1.5  # of any starter's requests, which are read every 0.2 s


def malformed_in_process(count: int, seed: int) -> tuple[list[str], dict[str, int]]:
    """Judge and submit that many, as the application does, in virtual time."""
    return run_virtually(_judge_all(count, seed))


async def _judge_all(count: int, seed: int) -> tuple[list[str], dict[str, int]]:
    plant = await Plant(policy=ROOM).online()
    tokens = Tokens(RunToken("boot-1"))
    intake = CommandParser(Topics("b"), tokens)
    failures: list[str] = []
    codes: Counter[str] = Counter()
    batch: list[tuple[str, bytes]] = []
    for verb, payload in Mutator(seed, lambda: tokens.issue(plant.clock.now_s())).payloads(count):
        batch.append((verb, payload))
        try:
            _take(plant, intake, Incoming(f"b/command/pump-1/alice/{verb}", payload))
        except (GatewayError, ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
            failures.append(f"{verb} {payload[:120]!r} raised {error!r}")
        if len(batch) == BATCH:
            await _settle(plant, batch, codes, failures)
    await _settle(plant, batch, codes, failures)
    return failures[:10], dict(codes.most_common())


def _take(plant: Plant, intake: CommandParser, incoming: Incoming) -> None:
    """Do as `App._take` does."""
    now_s = plant.clock.now_s()
    verdict = intake.judge(incoming, Moment(now_s, 1.8e9))
    if isinstance(verdict, Rejection):
        plant.dispatcher.reject(verdict.request, verdict.error)
    elif verdict is not None:
        plant.dispatcher.submit(verdict)


async def _settle(
    plant: Plant, batch: list[tuple[str, bytes]], codes: Counter[str], failures: list[str]
) -> None:
    """Let what was accepted end; each payload has exactly one final result, a refusal with its reason."""
    await plant.wait(5.0)
    finals = [each for each in plant.sink.of(ResultRecord) if each.phase.is_final]
    if len(finals) != len(batch):
        failures.append(f"{len(finals)} final results for {len(batch)} payloads")
    for each in finals:
        codes[each.code] += 1
        if each.phase is not Phase.REJECTED or not each.code or not each.text:
            failures.append(f"{each.verb} {each.id} ended as {each}")
    writes = [request for machine in plant.machines.values() for request in machine.line.writes]
    if writes:
        failures.append(f"the line was written to: {writes[:3]}")
    for machine in plant.machines.values():
        machine.line.sent.clear()
    plant.sink.clear()
    batch.clear()


async def malformed_through_broker(site: CommandSite, count: int, seed: int) -> None:
    """Publish that many, slowly enough for each to get an answer, and some of 10 MB that never arrive."""
    client = paho.Client(CallbackAPIVersion.VERSION2, client_id="alice")
    client.connect(site.broker.host, site.broker.port)
    client.loop_start()
    marks = {name: site.mark(name) for name in STARTERS}
    since, writes, begun_s = len(site.listener.results), site.writes(), time.monotonic()
    try:
        for number, (verb, payload) in enumerate(
            Mutator(seed, lambda: site.listener.token).payloads(count, with_big=False), 1
        ):
            starter = STARTERS[number % len(STARTERS)]
            client.publish(f"{BASE}/command/{starter}/alice/{verb}", payload, qos=1)
            if number % len(STARTERS) == 0:
                await asyncio.sleep(PACE_S)
        for _ in range(BIG_ONES):
            client.publish(f"{BASE}/command/pump/alice/start", b"x" * BIG_BYTES, qos=1)
        await asyncio.sleep(2.0)
    finally:
        client.disconnect()
        client.loop_stop()
    finals = [each for each in site.listener.results[since:] if is_final(each)]
    site.check(len(finals) == count, f"{len(finals)} final results for {count} payloads")
    wrong = [each for each in finals if each["phase"] != "rejected" or not each["code"] or not each["text"]]
    site.check(not wrong, f"not refused: {wrong[:3]}")
    site.check(site.writes() == writes, "a starter was written to")
    gaps_s = {name: _longest_gap_s(site, name, marks[name]) for name in STARTERS}
    site.check(max(gaps_s.values()) <= LONGEST_GAP_S, f"the line was disturbed: {gaps_s}")
    site.check(len(site.gateway.lives) == 1, "the gateway died")
    codes = Counter(each["code"] for each in finals)
    site.check("too_many" not in codes, f"{codes['too_many']} got no reason of their own")
    site.measurements |= dict(codes.most_common())
    site.measurements |= {
        "longest gap s": round(max(gaps_s.values()), 2),
        "took s": round(time.monotonic() - begun_s),
    }


def _longest_gap_s(site: CommandSite, starter: str, since: int) -> float:
    times_s = [at_s for at_s, _ in site.ears[starter].received[since:]]
    return max(later - earlier for earlier, later in pairwise(times_s))
