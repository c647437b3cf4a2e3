"""Queued, waiting and stalled commands through a real broker and a real socket: no start that comes late."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import time
from collections.abc import Callable

from gateway.contract import DEFAULT_TTL_S, rfc3339
from gateway.system.stalls import SUSPEND_LIMIT_S
from tests.lab.torture.machine import until
from tests.lab.torture.recorder import BASE, is_final
from tests.lab.torture.scenario import COMMANDS, OLD_MQTT, Scenario
from tests.lab.torture.world import KEEPALIVE_S, SETTLING, STARTERS, World

VERSIONS = ("mqttv311", "mqttv5")
LATE_S = 6.0  # in which four starts, one after another on their line, would be carried out
TTL_S = 60  # the longest that is allowed
STALLS_S = (1, 6, 8, 12, 30, 60)
AGAIN_S = 5.0  # until client and gateway are connected again, at the latest
AT_ONCE = 40  # commands that wait for a gateway that stands still; more would be too many


async def stale(w: World, count: int) -> None:
    """Try every kind; no start is counted as commanded, so none may be written."""
    await w.ready()
    for version in VERSIONS:
        await _queued(w, version, count)
        await _waiting(w, count)
    await asyncio.sleep(LATE_S)
    w.row.measurements["commands"] = 2 * count * len(VERSIONS)


async def stalled(w: World, longest_s: int) -> None:
    """Starts that a broker that stands still holds for 1 s up to so long, sent with both versions of MQTT.

    Within `ttl_s` they may act, later never; one that outlives the keep-alive comes over another connection.
    """
    begun = sum((await w.starts()).values())
    late = early = 0
    for seconds in (each for each in STALLS_S if each <= longest_s):
        await w.ready()
        starts, since = sum((await w.starts()).values()), len(w.recorder.results)
        await w.recorder.until("gateway/fresh", since_s=time.monotonic())  # the commands' proof is new
        proof = {"token": w.recorder.token, "boot": w.recorder.boot}
        w.broker.stand_still()
        sending = asyncio.gather(
            *(
                asyncio.to_thread(
                    w.broker.publish,
                    f"{BASE}/command/{starter}/alice/start",
                    json.dumps({"id": f"stalled-{time.monotonic_ns()}", **proof}),
                    *("-V", VERSIONS[number % 2]),
                    patience_s=2.0 * STALLS_S[-1],
                )
                for number, starter in enumerate(STARTERS)
            ),
            return_exceptions=True,  # a client may give up meanwhile
        )
        await asyncio.sleep(seconds)
        w.broker.go_on()
        await sending
        if seconds > KEEPALIVE_S:
            await asyncio.sleep(AGAIN_S)
        await w.settled()
        acted = sum((await w.starts()).values()) - starts
        codes = _finals(w, since)
        if seconds > DEFAULT_TTL_S:
            late += len(STARTERS)
            w.check(set(codes) <= {"expired", "not_fresh", "wrong_boot"}, f"after {seconds} s: {codes}")
            w.check(acted == 0, f"{acted} start frames after {seconds} s")
        else:
            early += len(STARTERS)
            w.check(acted == len(STARTERS), f"{acted} start frames after {seconds} s: {codes}")
            for starter in STARTERS:
                w.commanded[starter] += 1
        for starter in STARTERS:
            await w.stand(starter)
    acted = sum((await w.starts()).values()) - begun
    w.check(acted == early, f"{acted} start frames, {early} starts were in time")
    w.row.measurements |= {"late": late, "in time": early, "start frames": acted}


async def _queued(w: World, version: str, count: int) -> None:
    """Sent while the gateway was away, to a broker that has a session to keep them in; half retained."""
    boot, token, lives = w.recorder.boot, w.recorder.token, len(w.gateway.lives)
    await w.gateway.stop()
    _leave_session(w, version)
    issued_at, since = rfc3339(time.time()), len(w.recorder.results)

    def payload(id_: str) -> str:
        return json.dumps({"id": id_, "boot": boot, "token": token, "issued_at": issued_at, "ttl_s": TTL_S})

    half = (count + 1) // 2
    _publish(w, half, payload)
    _publish(w, count - half, payload, retain=True)
    w.gateway.start()
    await w.gateway.until_up(lives=lives + 1)
    await w.ready()
    await w.settled()
    answered = _finals(w, since)
    w.check(set(answered) <= {"retained"}, f"commands of before were judged: {answered[:3]}")
    for starter in STARTERS:
        w.recorder.publish(f"command/{starter}/alice/start", "", retain=True)  # retained no more


async def _waiting(w: World, count: int) -> None:
    """Sent to a gateway that stands still, so that they wait in its socket, with the best of proofs."""
    left = count
    while left:
        now, boot, token = min(left, AT_ONCE), w.recorder.boot, w.recorder.token
        left -= now
        w.gateway.signal(signal.SIGSTOP)

        def payload(id_: str, boot: str = boot, token: str = token) -> str:
            issued_at = {"issued_at": rfc3339(time.time())} if id_.endswith("1") else {}
            return json.dumps({"id": id_, "boot": boot, "token": token, "ttl_s": TTL_S, **issued_at})

        ids = _publish(w, now, payload)
        await asyncio.sleep(SUSPEND_LIMIT_S + 0.5)
        w.gateway.signal(signal.SIGCONT)
        for id_ in ids:
            end = await w.recorder.final(id_, within_s=5.0)
            is_right = end["phase"] == "rejected" and end["code"] in ("wrong_boot", "before_connection")
            w.check(is_right, f"{id_} ended as {end['phase']} {end['code']}")
        await until(lambda boot=boot: w.recorder.boot != boot, "a new boot", within_s=5.0)
        await w.settled()


def _leave_session(w: World, version: str) -> None:
    """Be the gateway for a moment, with a session that the broker keeps [MQTT 3.1.2.4]."""
    where = ("-h", w.broker.host, "-p", str(w.broker.port), "-V", version)
    subprocess.run(
        ["mosquitto_sub", *where, "-i", "plant", "-c", "-q", "1", "-t", f"{BASE}/command/+/+/+", "-E"],
        check=True,
        timeout=10.0,
    )


def _publish(w: World, count: int, payload: Callable[[str], str], *, retain: bool = False) -> list[str]:
    """Publish starts and return their ids."""
    ids = [f"{time.monotonic_ns()}-{number}" for number in range(count)]
    for number, id_ in enumerate(ids):
        topic = f"command/{tuple(STARTERS)[number % len(STARTERS)]}/alice/start"
        w.recorder.publish(topic, payload(id_), retain=retain)
    return ids


def _finals(w: World, since: int) -> list[str]:
    """Return the codes of the final results from that one on, but for those of the reads of `settled`."""
    found = [each for each in w.recorder.results[since:] if is_final(each)]
    return [each["code"] for each in found if not str(each["id"]).startswith(SETTLING)]


SCENARIOS = (
    Scenario("stale commands", COMMANDS, stale, 100, 5, "each"),
    Scenario("stalled ways", COMMANDS, stalled, 60, 6, "s at most"),
    Scenario("stalled, MQTT 3.1.1", OLD_MQTT, stalled, 60, 6, "s at most"),
)
