"""What all integrations together cost the line: pairs of spans with and without them.

`python -m tests.bench.integrations`. In one run reloads switch Home Assistant, Sparkplug and the metrics on
and off. While they are on, sixteen pages are open, their doors are tried, and a client scrapes, receives all
that is published, and asks for births. The gateway polls 32 starters without a pause.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.request import urlopen

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from gateway.sparkplug.payload import DataType, Metric, encoded
from tests.bench.page import HEAD, PAIRS, SPAN_S, UNITS, PagedSite, compared, listed, visited
from tests.bench.report import Goal, table
from tests.bench.rows import BenchRow

ON = """
[homeassistant]
operator = "bench"
[metrics]
all_points = true
[sparkplug]
group = "plant"
"""
SCRAPE_EVERY_S = 1.0
REBIRTH = "spBv1.0/plant/NCMD/bench"
PATIENCE_S = 20.0


def integrations() -> BenchRow:
    """Efficiency, silences and stops with and without them; memory."""
    seen: dict[str, int] = {"sparkplug": 0, "discovery": 0, "scrapes": 0}
    rows, goals, ratios, mib = compared("all", lambda site: _loaded(site, seen))
    goals.append(Goal(f"memory: {UNITS} starters and all integrations", mib, 120, is_most=True, unit=" MiB"))
    note = (
        f"{PAIRS} pairs of {SPAN_S:g} s, {UNITS} SSW-07s, 19200. All: Home Assistant, Sparkplug, metrics"
        f"\nof all points, 16 pages; switched by reloads. With / alone: {listed(ratios)}."
        f"\nMeanwhile {seen['sparkplug']} Sparkplug messages, {seen['discovery']} discovery messages and"
        f" {seen['scrapes']} scrapes. {mib:.1f} MiB at most."
    )
    return BenchRow(table("What the integrations cost", HEAD, rows, note=note), goals)


@contextmanager
def _loaded(site: PagedSite, seen: dict[str, int]) -> Iterator[None]:
    """Switch all on, use them, and switch them off."""
    text = site.config.read_text("utf-8")
    born, ended = threading.Event(), threading.Event()

    def note(_: object, __: object, message: paho.MQTTMessage) -> None:
        if message.topic.startswith("spBv1.0/"):
            seen["sparkplug"] += 1
            if "/NBIRTH/" in message.topic:
                born.set()
        elif message.payload:
            seen["discovery"] += 1

    client = paho.Client(CallbackAPIVersion.VERSION2)
    client.on_message = note
    client.connect("127.0.0.1", site.broker_port)
    client.subscribe([("spBv1.0/#", 0), ("homeassistant/#", 0)])
    client.loop_start()
    try:
        _apply(site, text + ON)
        if not born.wait(PATIENCE_S):
            raise RuntimeError("no Sparkplug node was born")
        with visited(site.page_port):
            use = threading.Thread(target=_use, args=(site, client, seen, ended), daemon=True)
            use.start()
            yield
            ended.set()
            use.join(PATIENCE_S)
    finally:
        ended.set()
        _apply(site, text)
        client.disconnect()
        client.loop_stop()
        time.sleep(1.0)  # they end


def _apply(site: PagedSite, text: str) -> None:
    site.config.write_text(text, "utf-8")
    site.process.send(signal.SIGHUP)


def _use(site: PagedSite, client: paho.Client, seen: dict[str, int], ended: threading.Event) -> None:
    """Scrape each second, and ask for births now and then."""
    wish = Metric("Node Control/Rebirth", DataType.BOOLEAN, value=True)
    while not ended.wait(SCRAPE_EVERY_S):
        with urlopen(f"http://127.0.0.1:{site.page_port}/metrics", timeout=PATIENCE_S) as reply:
            seen["scrapes"] += bool(reply.read())
        client.publish(REBIRTH, encoded((wish,), time_s=time.time(), seq=None))


def main() -> int:
    """Measure; return 1 when a goal is missed."""
    row = integrations()
    print(row.text)
    print(table("Reached", ["what", "got", "limit", ""], [goal.cells() for goal in row.goals]))
    return 0 if all(goal.is_met for goal in row.goals) else 1


if __name__ == "__main__":
    raise SystemExit(main())
