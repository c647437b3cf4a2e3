"""Queued, waiting and stalled commands through a real broker and a real socket: no start that comes late."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import AsyncExitStack

from gateway.contract import rfc3339
from gateway.contract.request import DEFAULT_TTL_S
from gateway.system.stalls import SUSPEND_LIMIT_S
from tests.lab.torture.command_site import PACE_S, STARTERS, USERS, CommandSite, Pipe
from tests.lab.torture.recorder import BASE, is_final
from tests.lab.torture.waiting import until

VERSIONS = ("mqttv311", "mqttv5")
LATE_S = 6.0  # in which four starts, one after another on their line, would be carried out
TTL_S = 60  # the longest that is allowed
STALLS_S = (1, 6, 8, 12, 30, 60)
KEEPALIVE_S = 20.0  # longer than this, and the gateway may have given the connection up
AGAIN_S = 5.0  # until client and gateway are connected again, at the latest
AT_ONCE = 40  # commands that wait for a gateway that stands still; more would be too many


async def stale(site: CommandSite, count: int, seed: int) -> None:
    """Try every kind, sent with both versions of MQTT, on a gateway that speaks 5."""
    for version in VERSIONS:
        for kind in (_queued, _waiting):
            await kind(site, version, count)
            name = f"{kind.__name__.strip('_')} {version}"
            site.check(site.starts() == 0, f"{name}: {site.starts()} start frames")
    site.measurements |= {"commands": 2 * count * len(VERSIONS), "start frames": site.starts()}
    await asyncio.sleep(LATE_S)
    site.check(site.starts() == 0, f"{site.starts()} start frames came late")


async def stalled(site: CommandSite, longest_s: int, seed: int) -> None:
    """Starts that a broker that stands still holds for 1 s up to so long, sent with both versions of MQTT.

    Within `ttl_s` they may act, later never; one that outlives the keep-alive comes over another connection.
    """
    late = early = 0
    for seconds in (each for each in STALLS_S if each <= longest_s):
        starts, since = site.starts(), len(site.listener.results)
        boot = site.listener.boot
        await site.listener.until("gateway/fresh", since_s=time.monotonic())  # the commands' proof is new
        site.broker.stand_still()
        sending = asyncio.gather(
            *(
                asyncio.to_thread(
                    site.broker.publish,
                    f"{BASE}/command/{starter}/alice/start",
                    payload,
                    "-V",
                    version,
                    patience_s=2.0 * STALLS_S[-1],
                )
                for starter, payload, version in [
                    (each, site.payload(f"stalled-{seconds}-{each}", boot=boot), VERSIONS[number % 2])
                    for number, each in enumerate(STARTERS)
                ]
            ),
            return_exceptions=True,  # a client may give up meanwhile
        )
        await asyncio.sleep(seconds)
        site.broker.go_on()
        await sending
        if seconds > KEEPALIVE_S:
            await asyncio.sleep(AGAIN_S)
        await site.settled()
        acted = site.starts() - starts
        if seconds > DEFAULT_TTL_S:
            late += len(STARTERS)
            site.check(acted == 0, f"{acted} start frames after {seconds} s")
            codes = {each["code"] for each in site.results(since=since) if is_final(each)}
            site.check(codes <= {"expired", "not_fresh", "wrong_boot"}, f"after {seconds} s: {codes}")
        else:
            early += len(STARTERS)
            ends = [each["code"] for each in site.results(since=since) if is_final(each)]
            site.check(acted == len(STARTERS), f"{acted} start frames after {seconds} s: {ends}")
        for starter in STARTERS:
            await site.stop(starter)
        await site.ready()
    site.check(site.starts() == early, f"{site.starts()} start frames, {early} starts were in time")
    site.measurements |= {"late": late, "in time": early, "start frames": site.starts()}


async def _queued(site: CommandSite, version: str, count: int) -> None:
    """Sent while the gateway was away, to a broker that has a session to keep them in; half retained."""
    boot, token = site.listener.boot, site.listener.token
    await site.gateway.stop()
    _leave_session(site, version)
    issued_at = rfc3339(time.time())

    def payload(id_: str) -> str:
        return json.dumps({"id": id_, "boot": boot, "token": token, "issued_at": issued_at, "ttl_s": TTL_S})

    half = (count + 1) // 2
    since = len(site.listener.results)
    await _publish(site, version, half, payload, pace_s=0.0)
    await _publish(site, version, count - half, payload, "-r", pace_s=0.0)
    await site.begin()
    await site.settled()
    answered = [each["code"] for each in site.results(since=since)]
    site.check(set(answered) <= {"retained"}, f"commands of before were judged: {answered[:3]}")
    _forget_retained(site)


async def _waiting(site: CommandSite, version: str, count: int) -> None:
    """Sent to a gateway that stands still, so that they wait in its socket, with the best of proofs."""
    left = count
    while left:
        now, boot, token = min(left, AT_ONCE), site.listener.boot, site.listener.token
        left -= now
        site.gateway.signal(signal.SIGSTOP)

        def payload(id_: str, boot: str = boot, token: str = token) -> str:
            issued_at = {"issued_at": rfc3339(time.time())} if id_.endswith("1") else {}
            return json.dumps({"id": id_, "boot": boot, "token": token, "ttl_s": TTL_S, **issued_at})

        ids = await _publish(site, version, now, payload, pace_s=0.0)
        await asyncio.sleep(SUSPEND_LIMIT_S + 0.5)
        site.gateway.signal(signal.SIGCONT)
        await _refused(site, ids, ("wrong_boot", "before_connection"))
        await until(lambda boot=boot: site.listener.boot != boot, "a new boot", within_s=5.0)  # type: ignore[misc] # a default
        await site.settled()


def _leave_session(site: CommandSite, version: str) -> None:
    """Be the gateway for a moment, with a session that the broker keeps [MQTT 3.1.2.4]."""
    where = ("-h", site.broker.host, "-p", str(site.broker.port), "-V", version)
    subprocess.run(
        ["mosquitto_sub", *where, "-i", "plant", "-c", "-q", "1", "-t", f"{BASE}/command/+/+/+", "-E"],
        check=True,
        timeout=10.0,
    )


def _forget_retained(site: CommandSite) -> None:
    for starter in STARTERS:
        for user in USERS:
            site.broker.publish(f"{BASE}/command/{starter}/{user}/start", "", "-r")


async def _publish(
    site: CommandSite,
    version: str,
    count: int,
    payload: Callable[[str], str],
    *options: str,
    pace_s: float = PACE_S,
) -> list[str]:
    """Publish starts, slowly enough for each to get an answer; return their ids."""
    ids = [f"{version}-{time.monotonic_ns()}-{number}" for number in range(count)]
    async with AsyncExitStack() as stack:
        pipes = [
            await stack.enter_async_context(
                Pipe(site.broker, f"command/{starter}/alice/start", version, *options)
            )
            for starter in STARTERS
        ]
        for number, id_ in enumerate(ids):
            pipes[number % len(pipes)].say(payload(id_))
            if number % len(pipes) == len(pipes) - 1:
                await asyncio.sleep(pace_s)
    return ids


async def _refused(
    site: CommandSite, ids: list[str], codes: tuple[str, ...], *, within_s: float = 5.0
) -> None:
    """Check that each of these was refused, once, with one of these codes."""
    for id_ in ids:
        result = await site.listener.final(id_, within_s=within_s)
        is_right = result["phase"] == "rejected" and result["code"] in codes
        site.check(is_right, f"{id_} ended as {result['phase']} {result['code']}")
