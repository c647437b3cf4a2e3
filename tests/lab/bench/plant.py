"""The whole gateway under test: its configuration, a Mosquitto, and what it costs meanwhile."""

from __future__ import annotations

import queue
import random
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from tests.lab.bench.account import Submitted
from tests.lab.bench.judge import Spec
from tests.lab.bench.runs import Process, Run, Watched, gateway
from tests.lab.bench.subjects import Span
from tests.mosquitto import MosquittoBroker, free_port
from tests.rig.sites import line, operator, starter, table

BASE = "starters/bench"
OPERATOR = "bench"
PATIENCE_S = 5.0
PASSWORD = "$scrypt$ln=14,r=8,p=5$AAAAAAAAAAAAAAAAAAAAAA$AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"


@dataclass(frozen=True)
class BenchSite:
    """A gateway on the judge's lines, publishing to a Mosquitto."""

    process: Process
    judge: Watched
    broker: MosquittoBroker
    page_port: int
    folder: Path

    @property
    def broker_port(self) -> int:
        """Return where the broker listens."""
        return self.broker.port

    def measured(self, spec: Spec, *, warm_s: float, seconds: float, stops: int) -> Span:
        """Return what it cost while that time passed, with stops over MQTT."""
        time.sleep(warm_s)
        before, from_s = self.process.used(), time.monotonic()
        submitted = operate(self.broker_port, spec, seconds=seconds, stops=stops)
        after = self.process.used()
        return Span(from_s, time.monotonic(), after.cpu_s - before.cpu_s, after.most_kib, submitted)


@contextmanager
def bench_site(
    spec: Spec,
    *,
    has_page: bool = False,
    prefix: Sequence[str] = (),
    is_persistent: bool = False,
) -> Iterator[BenchSite]:
    """Run it, `prefix` before its command; sessions outlive a restart of a persistent broker."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        options = ["log_type none", "max_queued_messages 0"] if is_persistent else ["log_type none"]
        broker = MosquittoBroker(folder / "mosquitto", is_persistent=is_persistent, options=options)
        broker.start()
        stack.callback(broker.stop)
        judge = stack.enter_context(Watched(spec))
        text, port = site(spec, judge.ports, broker.url), free_port()
        if has_page:
            text += table("web", listen=f"127.0.0.1:{port}")
            text += table("[web.user]", name="anna", password=PASSWORD, operator=OPERATOR)
        (folder / "site.toml").write_text(text, "utf-8")
        process = stack.enter_context(gateway(folder / "site.toml", prefix))
        yield BenchSite(process, judge, broker, port, folder)


def run_gateway(spec: Spec, *, warm_s: float = 4.0, seconds: float = 5.0, stops: int = 0) -> Run:
    """Run the gateway for a while, and return what the judge saw of it."""
    with bench_site(spec) as here:
        run = here.judge.run(here.measured(spec, warm_s=warm_s, seconds=seconds, stops=stops))
    return replace(run, first_s=run.first_s - here.process.begun_s)


def site(spec: Spec, ports: tuple[str, ...], broker: str) -> str:
    """Return the configuration of the judge's starters, each asked as often as its line allows."""
    parts = [table("gateway", name="bench", state_dir="state"), table("mqtt", url=broker), operator(OPERATOR)]
    for number, port in enumerate(ports):
        parts.append(line(f"line-{number}", port=port, baud=spec.baud, framing=spec.framing))
        parts += [
            starter(name(number, unit), unit, spec.family, every_s=0.0, watchdog_s=0.0)
            for unit in range(1, spec.units + 1)
        ]
    return "".join(parts)


def name(line: int, unit: int) -> str:
    """Return a starter's name."""
    return f"s{line}-{unit}"


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
