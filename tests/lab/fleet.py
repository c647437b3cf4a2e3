"""`python -m tests.lab.fleet [--gateways N] [--starters M]`: what N gateways ask of one broker, measured.

Each gateway has M simulated starters of all families on one line that is always full. Counted are the
messages of the start-up, of a span in which all motors stand, and of one in which all run; then what the
broker retains. With --fill the retained topics of one gateway are published under that many gateways' names
to a broker of its own.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from tests.end_to_end.site import Program
from tests.lab.usage import Usage, usage
from tests.listener import BrokerListener
from tests.mosquitto import MosquittoBroker, missing_programs
from tests.rig.sites import line, operator, starter, table
from tests.waiting import until

FAMILIES = ("ssw07", "ssw06", "ssw900", "sst")
BASE, OPERATOR = "starters/", "fleet"
PACKET_BYTES = 7  # of a PUBLISH of QoS 1 besides topic and payload, usually [MQTT 5 3.3]
STARTS_PER_S = 4.0  # of each gateway: more would wait for the line
PATIENCE_S = 180.0  # until all starters are ready
MOST_WAITING = 2000  # messages of --fill that were not acknowledged yet
QUIET = ("log_type none", "set_tcp_nodelay true", "max_queued_messages 0")


class FleetListener(BrokerListener):
    """One client that keeps all that is published, and commands."""

    def __init__(self, port: int) -> None:
        super().__init__(port, f"{BASE}#")
        self.taken: list[tuple[float, str, int]] = []  # when, topic, bytes of the packet
        self.retained: dict[str, bytes] = {}  # the newest of each topic
        self.confirmed = 0  # starts
        self.start()

    def body(self, topic: str) -> dict[str, Any]:
        """Return the newest message of a topic below the base."""
        body: dict[str, Any] = json.loads(self.retained.get(f"{BASE}{topic}") or b"{}")
        return body

    def start_motor(self, gateway: str, name: str) -> None:
        """Command a start."""
        payload = {"id": uuid.uuid4().hex, "token": self.body(f"{gateway}/gateway/fresh")["token"]}
        self.publish(f"{BASE}{gateway}/command/{name}/{OPERATOR}/start", payload)

    def is_ready(self, gateway: str, name: str) -> bool:
        """Return whether a starter is ready, and known to be what is configured."""
        state, info = (self.body(f"{gateway}/starter/{name}/{kind}") for kind in ("state", "info"))
        return state.get("state") == "ready" and bool(info.get("firmware"))

    def take(self, message: paho.MQTTMessage) -> None:
        topic = message.topic
        if "/command/" in topic:
            return
        self.taken.append((time.monotonic(), topic, PACKET_BYTES + len(topic) + len(message.payload)))
        if "/result/" in topic:
            self.confirmed += json.loads(message.payload)["phase"] == "confirmed"
        elif not topic.endswith(("/event", "/audit", "/history")):
            self.retained[topic] = message.payload


def main() -> int:
    """Run a fleet and print what was measured; 1 when a start was not confirmed."""
    parser = argparse.ArgumentParser(prog="python -m tests.lab.fleet", description=__doc__)
    parser.add_argument("--gateways", type=int, default=2, metavar="N")
    parser.add_argument("--starters", type=int, default=4, metavar="M", help="of each gateway, on one line")
    parser.add_argument("--seconds", type=float, default=20.0, metavar="S", help="of each span")
    parser.add_argument("--fill", type=int, default=0, metavar="GATEWAYS")
    args = parser.parse_args()
    if absent := missing_programs():
        print(f"not installed: {', '.join(absent)} (apt-get install mosquitto mosquitto-clients)")
        return 2
    print(f"{os.cpu_count()} processors, load before {os.getloadavg()[0]:.2f}", flush=True)
    with tempfile.TemporaryDirectory(prefix="fleet-") as folder, running_broker(Path(folder) / "b") as broker:
        confirmed = asyncio.run(run(args, Path(folder), broker))
    return 0 if confirmed == args.gateways * args.starters else 1


@contextmanager
def running_broker(folder: Path) -> Iterator[MosquittoBroker]:
    broker = MosquittoBroker(folder, options=QUIET)
    broker.start()
    try:
        yield broker
    finally:
        broker.kill()


async def run(args: argparse.Namespace, folder: Path, broker: MosquittoBroker) -> int:
    """Run all of it, printing as it goes; return how many starts were confirmed."""
    fleet = {f"g{number}": folder / f"g{number}.toml" for number in range(args.gateways)}
    names = [f"s{address}-{FAMILIES[address % len(FAMILIES)]}" for address in range(1, args.starters + 1)]
    seen = FleetListener(broker.port)
    async with AsyncExitStack() as stack:
        for gateway, config in fleet.items():
            config.write_text(site_text(folder, gateway, names, broker.url), "utf-8")
            simulator = await stack.enter_async_context(Program("gateway", "simulate", str(config)))
            await simulator.says("line hall")
        begun_s = time.monotonic()
        programs = [
            await stack.enter_async_context(Program("gateway", "run", str(config)))
            for config in fleet.values()
        ]
        everything = [(gateway, name) for name in names for gateway in fleet]
        await until(
            lambda: all(seen.is_ready(*each) for each in everything), "all starters are ready", PATIENCE_S
        )
        print_start_up(seen, begun_s, tuple(fleet))
        pids = {"broker": [broker.pid], "gateways": [each.pid for each in programs]}
        await span(seen, "standing", args, pids)
        for name in names:
            for gateway in fleet:
                seen.start_motor(gateway, name)
            await asyncio.sleep(1 / STARTS_PER_S)
        await until(lambda: seen.confirmed >= len(everything), "every start is confirmed", PATIENCE_S)
        await span(seen, "running", args, pids)
    print(f"starts: {seen.confirmed} of {len(everything)} confirmed")
    own = {topic: payload for topic, payload in seen.retained.items() if topic.startswith(f"{BASE}g0/")}
    print_retained(own)
    if args.fill:
        fill(folder / "filled", own, args.fill)
    return seen.confirmed


def site_text(folder: Path, gateway: str, names: list[str], url: str) -> str:
    """Return the configuration of a gateway: one line at 19200 bit/s, all families, the rest default."""
    starters = (starter(name, at, name.partition("-")[2]) for at, name in enumerate(names, 1))
    return (
        table("gateway", name=gateway, state_dir=f"{folder}/state-{gateway}")
        + table("mqtt", url=url)
        + line("hall", port=f"{folder}/tty-{gateway}", adapter_allowance_s=1.0)  # all share this machine
        + "".join(starters)
        + operator(OPERATOR, ("start",))
    )


async def span(
    seen: FleetListener, name: str, args: argparse.Namespace, pids: Mapping[str, list[int]]
) -> None:
    """Let the time of a span pass, and print what was published and used in it."""

    def used() -> dict[str, Usage]:
        return {kind: sum(map(usage, each), Usage(0.0, 0)) for kind, each in pids.items()}

    before, first = used(), len(seen.taken)
    await asyncio.sleep(args.seconds)
    found, after = seen.taken[first:], used()
    per_s = 1 / args.seconds / args.gateways
    size = sum(size for *_, size in found) * per_s / 1000
    rate = f"{len(found) * per_s:.1f} messages/s and {size:.1f} kB/s a gateway"
    print(f"{name}: {rate}; load {os.getloadavg()[0]:.1f}")
    kinds = Counter(kind_of(topic) for _, topic, _ in found).most_common()
    print(f"    messages/s: {', '.join(f'{kind} {count * per_s:.2f}' for kind, count in kinds)}")
    for kind, now in after.items():
        share = (now.cpu_s - before[kind].cpu_s) / args.seconds
        print(f"    {kind:10} {share:6.1%} of a processor, {now.rss_kib / 1024:7.1f} MiB", flush=True)


def kind_of(topic: str) -> str:
    """Return what a topic is: gateway/fresh, state, value, result .."""
    _, _, branch, *rest = topic.split("/")
    return f"{branch}/{rest[0]}" if branch == "gateway" else rest[1] if branch == "starter" else branch


def print_start_up(seen: FleetListener, begun_s: float, gateways: tuple[str, ...]) -> None:
    """Print how much the start-up was, and its worst second."""
    for gateway in gateways:
        times = [at_s for at_s, topic, _ in seen.taken if topic.startswith(f"{BASE}{gateway}/")]
        worst = Counter(map(int, times)).most_common(1)[0][1]
        took_s = times[-1] - begun_s
        print(f"start-up of {gateway}: {len(times)} messages in {took_s:.0f} s, {worst} in its worst second")


def print_retained(own: Mapping[str, bytes]) -> None:
    """Print what is retained of one gateway: of itself, and of a starter of each family."""
    count, size = Counter[str](), Counter[str]()
    for topic, payload in own.items():
        _, _, branch, name, *_ = topic.split("/")
        kind = name if branch == "starter" else branch
        count[kind] += 1
        size[kind] += len(topic) + len(payload)
    print(f"retained of a gateway: {count.total()} topics, {size.total()} bytes")
    for kind, topics in sorted(count.items()):
        print(f"    {kind:10} {topics:4} topics, {size[kind]:6} bytes")


def fill(folder: Path, own: Mapping[str, bytes], gateways: int) -> None:
    """Publish one gateway's retained messages for so many, and print what they cost a broker."""
    with running_broker(folder) as broker:
        before, begun_s = usage(broker.pid), time.monotonic()
        client = paho.Client(CallbackAPIVersion.VERSION2)
        client.max_inflight_messages_set(MOST_WAITING)
        client.connect("127.0.0.1", broker.port)
        client.loop_start()
        for number in range(gateways):
            for topic, payload in own.items():
                other = topic.replace("/g0/", f"/g0-{number:04}/", 1)
                last = client.publish(other, payload, qos=1, retain=True)
            last.wait_for_publish(60.0)
        seconds, after, topics = time.monotonic() - begun_s, usage(broker.pid), gateways * len(own)
        client.disconnect()
        client.loop_stop()
    us, kib = (after.cpu_s - before.cpu_s) / topics * 1e6, (after.rss_kib - before.rss_kib) / topics
    print(f"{topics} retained topics in {seconds:.1f} s: {us:.0f} us of the broker, {kib:.2f} KiB each")


if __name__ == "__main__":
    sys.exit(main())
