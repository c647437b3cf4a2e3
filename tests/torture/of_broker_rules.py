"""A broker that refuses us, takes one message at a time, or has other clients who make trouble."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion

from gateway.config.load import load
from tests.torture.of_broker import AGAIN_S, SLOWEST_S, back, told, tolerance_of
from tests.torture.scenario import Place, Scenario
from tests.torture.world import World

RIVAL_PAUSE_S = 1
FASTEST_RETRY_S = 0.5  # gateway.mqtt.connection.settings
ANONYMOUS = "allow_anonymous true"
DEAF_SUBSCRIBE = bytes.fromhex("10 10 00 04 4d 51 54 54 04 02 00 3c 00 04") + b"deaf"
DEAF_SUBSCRIBE += bytes.fromhex("82 06 00 01 00 01 23 01")  # to everything, QoS 1


async def taken_over(w: World, seconds: int) -> None:
    """Another client has our client id, and comes back whenever we have thrown it out."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    name = load(w.folder / "site.toml").client_id
    fights = w.broker.log().count(f"{name} already connected")
    rival = paho.Client(CallbackAPIVersion.VERSION2, client_id=name)
    rival.reconnect_delay_set(RIVAL_PAUSE_S, RIVAL_PAUSE_S)
    rival.connect(w.broker.host, w.broker.port)
    rival.loop_start()
    during = await w.rate(max(seconds, SLOWEST_S))
    back_s = time.monotonic()
    rival.disconnect()
    rival.loop_stop()
    fights = w.broker.log().count(f"{name} already connected") - fights
    await w.right(since_s=back_s, within_s=AGAIN_S)
    w.figures |= {"taken over": fights, "right again s": round(time.monotonic() - back_s, 2)}
    w.check(0 < fights <= 2 * max(seconds, SLOWEST_S) / FASTEST_RETRY_S, f"{fights} take-overs")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


async def refused(w: World, seconds: int) -> None:
    """The broker lets nobody in, until somebody mends its configuration."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    await asyncio.to_thread(w.broker.stop)
    with _other_rules(w, ANONYMOUS, "allow_anonymous false"):
        await asyncio.to_thread(w.broker.start)
        during = await w.rate(max(seconds, SLOWEST_S))
        await asyncio.to_thread(w.broker.stop)
    back_s = await back(w, w.broker.start)
    logged = w.gateway.log.count("refuses the connection: Not authorized")
    w.figures |= {"logged": logged, "right again s": round(back_s, 2)}
    w.check(logged == 1, f"a refusal was logged {logged} times")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


async def one_at_a_time(w: World, count: int) -> None:
    """The broker takes one message at a time (Receive Maximum 1), and there is much to tell."""
    slowest_s = 0.0
    with _other_rules(w, ANONYMOUS, f"{ANONYMOUS}\nmax_inflight_messages 1"):
        for _ in range(count):
            known = w.recorder.books.count("fault", starter="mill")
            await asyncio.to_thread(w.broker.stop)
            is_seen = await w.fault("mill")
            slowest_s = max(slowest_s, await back(w, w.broker.start))

            def is_told(known: int = known + is_seen) -> bool:
                return w.recorder.books.count("fault", starter="mill") >= known

            await told(w, is_told, "the fault of the outage is told")
    await asyncio.to_thread(w.broker.restart)
    await w.right(since_s=time.monotonic() - AGAIN_S, within_s=AGAIN_S)
    w.figures["right again s"] = round(slowest_s, 2)


async def slow_consumer(w: World, seconds: int) -> None:
    """A subscriber to everything that reads nothing."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    with socket.create_connection((w.broker.host, w.broker.port)) as deaf:
        deaf.sendall(DEAF_SUBSCRIBE)
        during = await w.rate(max(seconds, SLOWEST_S))
        await w.right_still()
    w.check("SUBSCRIBE from deaf" in w.broker.log(), "nobody subscribed")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


@contextmanager
def _other_rules(w: World, old: str, new: str) -> Iterator[None]:
    """Let the broker be configured otherwise whenever it is started meanwhile."""
    config = w.folder / "broker" / "mosquitto.conf"
    text = config.read_text("utf-8")
    config.write_text(text.replace(old, new), "utf-8")
    try:
        yield
    finally:
        config.write_text(text, "utf-8")


SCENARIOS = (
    Scenario("client id used twice", Place.BROKER, taken_over, 60, 10, "s"),
    Scenario("refused login", Place.BROKER, refused, 60, 10, "s"),
    Scenario("Receive Maximum 1", Place.BROKER, one_at_a_time, 20, 1, "times"),
    Scenario("slow consumer", Place.BROKER, slow_consumer, 60, 10, "s"),
)
