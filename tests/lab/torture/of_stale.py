"""Retained, expired, replayed, queued and long-waiting commands through a real broker: no start, ever."""

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
EXPIRY = ("-D", "publish", "message-expiry-interval", "1")
TTL_S = 60  # the longest that is allowed
STALLS_S = (1, 6, 8, 12, 30, 60)
KEEPALIVE_S = 20.0  # longer than this, and the gateway may have given the connection up
AGAIN_S = 5.0  # until client and gateway are connected again, at the latest
AT_ONCE = 40  # commands that wait for a gateway that stands still; more would be too many


async def stale(site: CommandSite, count: int, seed: int) -> None:
    """Try every kind, sent with both versions of MQTT, on a gateway that speaks 5."""
    answered = wanted = 0
    for version in VERSIONS:
        for kind in (_retained, _expired, _replayed, _queued, _waiting):
            starts = site.starts()
            expected = await kind(site, version, count)
            answered, wanted = answered + count, wanted + expected
            name = f"{kind.__name__.strip('_')} {version}"
            site.check(site.starts() == starts + expected, f"{name}: {site.starts() - starts} start frames")
    site.measurements |= {"commands": answered, "start frames": site.starts(), "wanted starts": wanted}
    starts = site.starts()
    await asyncio.sleep(LATE_S)
    site.check(site.starts() == starts, f"{site.starts() - starts} start frames came late")


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


async def _retained(site: CommandSite, version: str, count: int) -> int:
    """Published with the retained flag, half of them received live, the last of each found at a restart."""
    ids = await _publish(site, version, count, lambda id_: site.payload(id_), "-r")
    await _refused(site, ids, ("retained",))
    await site.restart()
    await site.settled()
    _forget_retained(site)
    return 0


async def _expired(site: CommandSite, version: str, count: int) -> int:
    """Issued too long ago, with the right boot all the same; in MQTT 5 with an expiry beside."""

    def payload(id_: str) -> str:
        age_s = 6.0 + 97.0 * int(id_.rsplit("-", 1)[1])
        return site.payload(id_, issued_at=rfc3339(time.time() - age_s), ttl_s=5)

    ids = await _publish(site, version, count, payload, *(EXPIRY if version == "mqttv5" else ()))
    await _refused(site, ids, ("expired",))
    return 0


async def _replayed(site: CommandSite, version: str, count: int) -> int:
    """A command that was carried out, again and again; after a restart with the boot of before."""
    id_ = f"original-{version}"
    original = site.payload(id_)
    site.listener.publish("command/pump/alice/start", original)
    done = await site.listener.final(id_)
    site.check(done["phase"] == "confirmed", f"the original ended as {done}")
    await site.stop("pump")
    since = len(site.listener.results)
    half = (count + 1) // 2
    async with Pipe(site.broker, "command/pump/alice/start", version) as pipe:
        for _ in range(half):
            pipe.say(original)
            await asyncio.sleep(PACE_S)
    await site.settled()
    repeated = site.listener.of(id_, since=since)
    site.check(len(repeated) == half, f"{len(repeated)} answers to {half} repetitions")
    site.check(all(each["duplicate"] for each in repeated), "a repetition was not marked as one")
    old_boot, old_token = site.listener.boot, site.listener.token
    await site.restart()
    site.check(site.listener.boot != old_boot, "the boot token is the same after a restart")
    old = lambda new_id: json.dumps({"id": new_id, "boot": old_boot, "token": old_token})  # noqa: E731 - as the others
    await _refused(site, await _publish(site, version, count - half, old), ("wrong_boot",))
    return 1


async def _queued(site: CommandSite, version: str, count: int) -> int:
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
    return 0


async def _waiting(site: CommandSite, version: str, count: int) -> int:
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
    return 0


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
