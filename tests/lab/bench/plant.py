"""The whole gateway under test: its configuration, a Mosquitto, and what it costs meanwhile."""

from __future__ import annotations

import queue
import random
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from tests.lab.bench.account import Submitted
from tests.lab.bench.judge import Spec
from tests.lab.bench.runs import Process, Run, Watched, gateway
from tests.lab.bench.subjects import Span
from tests.mosquitto import MosquittoBroker

BASE = "starters/bench"
OPERATOR = "bench"
PATIENCE_S = 5.0


def run_gateway(
    spec: Spec,
    *,
    warm_s: float = 4.0,
    seconds: float = 5.0,
    stops: int = 0,
    log: Path | None = None,
    module: str = "gateway",
    without: str = "",
) -> Run:
    """Run the gateway on the judge's lines, publishing to a Mosquitto; stops are sent over MQTT."""
    with (
        tempfile.TemporaryDirectory() as folder,
        bench_broker(Path(folder)) as broker,
        Watched(spec) as judge,
    ):
        config = Path(folder) / "site.toml"
        config.write_text(site(spec, judge.ports, broker.url), "utf-8")
        with gateway(config, module=module, without=without) as process:
            span = _measure(process, warm_s, lambda: operate(broker.port, spec, seconds=seconds, stops=stops))
            begun_s = process.begun_s
        if log is not None:
            log.write_text((config.parent / "gateway.log").read_text())
        run = judge.run(span)
        return replace(run, first_s=run.first_s - begun_s)


def site(spec: Spec, ports: tuple[str, ...], broker: str) -> str:
    """Return the configuration of the judge's starters, each asked as often as its line allows."""
    parts = [
        f'[gateway]\nname = "bench"\nstate_dir = "state"\n[mqtt]\nurl = "{broker}"\n'
        f'[[operator]]\nclient = "{OPERATOR}"\nmay = ["*"]\nstarters = ["*"]\n'
    ]
    for number, port in enumerate(ports):
        parts.append(
            f'[[line]]\nname = "line-{number}"\nport = "{port}"\n'
            f'baud = {spec.baud}\nframing = "{spec.framing}"\n'
        )
        parts += [
            f'[[line.starter]]\nname = "{name(number, unit)}"\naddress = {unit}\nfamily = "{spec.family}"\n'
            f"every_s = 0.0\nwatchdog_s = 0.0\n"
            for unit in range(1, spec.units + 1)
        ]
    return "".join(parts)


def name(line: int, unit: int) -> str:
    """Return a starter's name."""
    return f"s{line}-{unit}"


def _measure(process: Process, warm_s: float, operate: Callable[[], list[Submitted]]) -> Span:
    time.sleep(warm_s)
    process.rss_kib()
    from_s, cpu_s = time.monotonic(), process.cpu_s()
    stops = operate()
    return Span(from_s, time.monotonic(), process.cpu_s() - cpu_s, process.rss_kib(), stops)


def operate(port: int, spec: Spec, *, seconds: float, stops: int) -> list[Submitted]:
    """Let the time pass, with stops at random moments; they reach the gateway when they reach us again."""
    if not stops:
        time.sleep(seconds)
        return []
    arrived: queue.SimpleQueue[float] = queue.SimpleQueue()
    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.on_message = lambda *_: arrived.put(time.monotonic())
    client.connect("127.0.0.1", port)
    client.loop_start()
    client.subscribe(f"{BASE}/command/#")
    chance = random.Random(1)
    submitted: list[Submitted] = []
    for _ in range(stops):
        time.sleep(chance.uniform(0.5, 1.5) * seconds / stops * 0.9)
        unit = chance.randint(1, spec.units)
        sent_s = time.monotonic()
        client.publish(f"{BASE}/command/{name(0, unit)}/{OPERATOR}/stop", "")
        submitted.append(Submitted(sent_s, arrived.get(timeout=PATIENCE_S), unit))
    time.sleep(seconds / stops)
    client.disconnect()
    client.loop_stop()
    return submitted


@contextmanager
def bench_broker(folder: Path) -> Iterator[MosquittoBroker]:
    broker = MosquittoBroker(folder / "mosquitto", options=["log_type none"])
    broker.start()
    try:
        yield broker
    finally:
        broker.stop()
