"""The row about motors that ignore a stop, on a full line in its first second.

Each time the gateway starts on a line of 247 starters, and the stop is sent as soon as it is online. The
starter acknowledges the stop's frames and lets its motor run: for good, or for IGNORED_S.
"""

from __future__ import annotations

import json
import queue
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from gateway.records import Phase
from tests.lab.bench.account import SeenRequest
from tests.lab.bench.judge import STANDS_S, Spec
from tests.lab.bench.plant import BASE, OPERATOR, bench_broker, name, site
from tests.lab.bench.report import Goal, table
from tests.lab.bench.rows import BenchRow
from tests.lab.bench.runs import Watched, gateway
from tests.lab.bench.subjects import Span

MANY = 247
UNIT = 124  # in the middle of the first round
MEASURED_S = 10.0  # as long as a stop is repeated
IGNORED_S = 8.0
FEWEST_FRAMES = 15
CONFIRMED_WITHIN_S = 1.0  # of the motor's standstill
GRACE_S = 2.0
WAY_S = 1.0  # for broker and gateway, beside the line's bound, as docs/reliability.md promises
ONLINE_WITHIN_S = 20.0
WRITE_COIL = 5
ID = "stubborn"


@dataclass(frozen=True)
class Tried:
    """One stop; times in seconds after it was sent."""

    since_first_s: float  # from the line's first request until it was sent
    frames_s: list[float]
    bound_s: float  # of the line for its first frame, as the gateway computes it
    results: list[tuple[float, str]]  # phases as they came

    @property
    def frames(self) -> int:
        return sum(each < MEASURED_S for each in self.frames_s)

    @property
    def final(self) -> str:
        """The one final phase; how many there are when it is not one."""
        finals = [phase for _, phase in self.results if Phase(phase).is_final]
        return finals[0] if len(finals) == 1 else f"{len(finals)} finals"

    @property
    def confirmed_s(self) -> float:
        """After what time it was confirmed, from the frame that the motor obeyed; infinite if never."""
        obeyed_s = next((each for each in self.frames_s if each - self.frames_s[0] >= IGNORED_S), None)
        at_s = next((at_s for at_s, phase in self.results if phase == Phase.CONFIRMED), None)
        return float("inf") if obeyed_s is None or at_s is None else at_s - obeyed_s


def stubborn() -> BenchRow:
    """A stop in the first second of a full line, of a motor that ignores it."""
    rows, goals = [], []
    for every_s in (0.0, 1.0):
        for ignores_s in (MEASURED_S + GRACE_S, IGNORED_S):
            tried = _try(ignores_s, every_s)
            is_for_good = ignores_s > MEASURED_S
            what = f"every_s {every_s:g}, {'for good' if is_for_good else f'for {IGNORED_S:g} s'}"
            first_s, confirmed_s = tried.frames_s[0], tried.confirmed_s
            longest_s = max(later_s - sooner_s for sooner_s, later_s in pairwise(tried.frames_s))
            rows.append([what, f"{tried.since_first_s:.2f}", f"{first_s * 1e3:.0f}", str(tried.frames)])
            rows[-1] += [f"{longest_s:.2f}", tried.final, "-" if is_for_good else f"{confirmed_s:.2f}"]
            bound_s = WAY_S + tried.bound_s
            goals.append(Goal(f"first frame: {what}", first_s, bound_s, is_most=True, unit=" s"))
            if is_for_good:
                goals.append(Goal(f"frames in {MEASURED_S:g} s: {what}", tried.frames, FEWEST_FRAMES))
                goals.append(Goal(f"unconfirmed: {what}", float(tried.final == Phase.UNCONFIRMED), 1))
            else:
                limit_s = STANDS_S + CONFIRMED_WITHIN_S
                goals.append(Goal(f"confirmed after: {what}", confirmed_s, limit_s, is_most=True, unit=" s"))
    note = (
        "247 SSW-07. Sent: after the line's first request. First frame: after the stop was sent, ms."
        f"\nFrames: of {MEASURED_S:g} s. Longest: between two frames, seconds. Confirmed: seconds after"
        f"\nthe frame that the motor obeys; it stands {STANDS_S:g} s after that."
    )
    head = ["motor ignores stops", "sent s", "first frame", "frames", "longest", "end", "confirmed"]
    return BenchRow(
        table("Stop of a motor that ignores it, in the first second, 19200", head, rows, note=note), goals
    )


def _try(ignores_s: float, every_s: float) -> Tried:
    spec = Spec(units=MANY, family="ssw07", is_calm=True, stubborn=UNIT, ignores_s=ignores_s)
    with (
        tempfile.TemporaryDirectory() as folder,
        bench_broker(Path(folder)) as broker,
        Watched(spec) as judge,
    ):
        config = Path(folder) / "site.toml"
        text = site(spec, judge.ports, broker.url)
        config.write_text(text.replace("every_s = 0.0", f"every_s = {every_s}"), "utf-8")
        operator = _Operator(broker.port)
        with gateway(config):
            operator.wait_until_online()
            sent_s = time.monotonic()
            operator.stop()
            time.sleep(MEASURED_S + GRACE_S)
        operator.close()
        seen = judge.run(Span(0.0, float("inf"), 0.0, 0)).seen
    frames_s = [each.start_s - sent_s for each in _stop_frames(seen) if each.start_s > sent_s]
    results = [(at_s - sent_s, str(each["phase"])) for at_s, each in operator.results]
    return Tried(sent_s - seen[0].start_s, frames_s, operator.bound_s, results)


def _stop_frames(seen: Sequence[SeenRequest]) -> list[SeenRequest]:
    return [each for each in seen if each.unit == UNIT and each.function == WRITE_COIL]


class _Operator:
    """Watches the gateway, stops one starter, and notes what comes of it."""

    def __init__(self, port: int) -> None:
        self.results: list[tuple[float, dict[str, Any]]] = []
        self.bound_s = float("nan")
        self._online: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = self._note
        self._client.connect("127.0.0.1", port)
        self._client.subscribe([(f"{BASE}/{each}", 1) for each in ("gateway/#", "result/#")])
        self._client.loop_start()

    def wait_until_online(self) -> None:
        """TimeoutError when the gateway never is."""
        try:
            self._online.get(timeout=ONLINE_WITHIN_S)
        except queue.Empty:
            raise TimeoutError("the gateway is not online") from None

    def stop(self) -> None:
        payload = json.dumps({"id": ID})
        self._client.publish(f"{BASE}/command/{name(0, UNIT)}/{OPERATOR}/stop", payload, qos=1)

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def _note(self, _client: Any, _userdata: Any, message: paho.MQTTMessage) -> None:
        at_s, payload = time.monotonic(), json.loads(message.payload or b"{}")
        if message.topic == f"{BASE}/gateway/status" and payload.get("state") != "offline":
            self._online.put(None)
        elif message.topic.startswith(f"{BASE}/gateway/line/"):
            self.bound_s = float(payload["stop_latency_s"]["computed"])
        elif message.topic.startswith(f"{BASE}/result/") and payload["id"] == ID:
            self.results.append((at_s, payload))
