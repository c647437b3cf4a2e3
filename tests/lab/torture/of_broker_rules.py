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
from tests.lab.torture.of_broker import AGAIN_S, SLOWEST_S, back, tolerance_of, wait_for
from tests.lab.torture.scenario import Place, Scenario
from tests.lab.torture.world import World

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
    await wait_for(w, lambda: _status(w) == "offline", "the rival has the client id")
    lost_s, back_s = w.recorder.received_s["gateway/status"], time.monotonic()
    rival.disconnect()
    rival.loop_stop()
    fights = w.broker.log().count(f"{name} already connected") - fights
    await w.right(since_s=lost_s, within_s=AGAIN_S)  # had it held the connection, it had no news to publish
    w.measurements |= {"sessions lost": fights, "right again s": round(time.monotonic() - back_s, 2)}
    w.check(0 < fights <= 2 * max(seconds, SLOWEST_S) / FASTEST_RETRY_S, f"{fights} take-overs")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


async def refused(w: World, seconds: int) -> None:
    """The broker refuses every client until its configuration is corrected."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    await asyncio.to_thread(w.broker.stop)
    with _other_rules(w, ANONYMOUS, "allow_anonymous false"):
        await asyncio.to_thread(w.broker.start)
        during = await w.rate(max(seconds, SLOWEST_S))
        await asyncio.to_thread(w.broker.stop)
    back_s = await back(w, w.broker.start)
    logged = w.gateway.log.count("refuses the connection: Not authorized")
    w.measurements |= {"logged": logged, "right again s": round(back_s, 2)}
    w.check(logged == 1, f"a refusal was logged {logged} times")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


async def one_at_a_time(w: World, count: int) -> None:
    """The broker takes one message at a time (Receive Maximum 1), and there is much to publish."""
    slowest_s = 0.0
    with _other_rules(w, ANONYMOUS, f"{ANONYMOUS}\nmax_inflight_messages 1"):
        for _ in range(count):
            known = w.recorder.books.count("fault", starter="mill")
            await asyncio.to_thread(w.broker.stop)
            is_seen = await w.fault("mill")
            slowest_s = max(slowest_s, await back(w, w.broker.start))

            def is_published(known: int = known + is_seen) -> bool:
                return w.recorder.books.count("fault", starter="mill") >= known

            await wait_for(w, is_published, "the fault of the outage is published")
    await asyncio.to_thread(w.broker.restart)
    await w.right(since_s=time.monotonic() - AGAIN_S, within_s=AGAIN_S)
    w.measurements["right again s"] = round(slowest_s, 2)


async def slow_consumer(w: World, seconds: int) -> None:
    """A subscriber to everything that reads nothing."""
    await w.calm()
    before = await w.rate(max(seconds, SLOWEST_S))
    with socket.create_connection((w.broker.host, w.broker.port)) as deaf:
        deaf.sendall(DEAF_SUBSCRIBE)
        during = await w.rate(max(seconds, SLOWEST_S))
        await w.right_still()
    w.check("SUBSCRIBE from deaf" in w.broker.log(), "no client subscribed")
    w.check_rates(before, during, tolerance=tolerance_of(seconds))


def _status(w: World) -> str:
    return str(w.recorder.latest["gateway/status"]["state"])


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
