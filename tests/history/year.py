"""A year of a motor that ages, as a gateway records it; `write` puts it into a state directory.

A fan whose bearing wears from the eighth month on: it takes ever longer to full speed.
"""

from __future__ import annotations

import json
import random
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gateway.app.record_log import log_failure
from gateway.cli.command import place_of
from gateway.cli.report.document import ReportDocument, document_of
from gateway.cli.report.facts import PublishedFacts, facts_of
from gateway.config.reading import load
from gateway.contract import RecordWriter, rfc3339, stored
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.timing import Framing, LineTiming
from gateway.plugins.history.delivery import Delivery, Past
from gateway.plugins.history.starts import MotorStarts
from gateway.plugins.history.trips import NOTHING
from gateway.starters import FINGERPRINTS, KNOWN, StarterSetup
from gateway.starters.identity.registry import Fingerprint, Known
from gateway.store import HISTORY_FILE, STATE_FILE, HistoryRow, HistoryStore, write_document
from tests.contract.examples import TRIP
from tests.history.support import NO_OUTBOX, UTC_S, AnalyticStart, ReadMotor
from tests.rig.sites import line, starter, table
from tests.virtual_time import HandClock

STARTER = "cooling-fan-2"
DAY_S = 86400.0
BEGAN_S = datetime(2025, 11, 1, tzinfo=UTC).timestamp()
DAYS = 380

CONFIG = (
    table("gateway", name="cement-mill", state_dir="state")
    + table("mqtt", url="mqtt://127.0.0.1:{port}")
    + line("cooling", port="/dev/ttyRS485-1", baud=19200, framing="8E1")
    + starter(STARTER, 7, "ssw07", model="SSW-07 200A")
)


STATISTICS = {  # of its line, at the end
    "units": {
        "7": {
            "asked": 1_904_322,
            "answered": 1_898_006,
            "silent": 1407,
            "corrupted": 4909,
            "late": 0,
            "response_time_s": {"p50": 0.0121, "p99": 0.0184},
        }
    },
    "cable": {
        "texts": [
            "errors from cooling-fan-2 (address 7) on: check the cable after cooling-fan-1 "
            "(address 6) (2.4 % of 1180 replies in 10 min: 22 corrupted, 6 lost)"
        ],
        "starters": {STARTER: {"error_rate": 0.0187, "silent_rate": 0.0051, "late_rate": 0.0}},
    },
}
PUBLISHED = PublishedFacts(STATISTICS, {"hours_total": 6012.0})


class MemoryHistory:
    """Stands for the history's file: `stored` is what was put, by kind and id."""

    def __init__(self) -> None:
        self.stored: dict[tuple[str, str], HistoryRow] = {}

    def put(self, row: HistoryRow, *, is_urgent: bool = False) -> None:
        self.stored[row.kind, row.id] = row
        for key in [key for key in self.stored if key[0] == row.kind][: -row.limit]:
            del self.stored[key]

    def copy(self, starter: str, kind: str, id_: str, to_kind: str) -> None:
        if (kind, id_) in self.stored:
            self.put(HistoryRow(starter, to_kind, id_, self.stored[kind, id_].data))


async def lived(*, days: int = DAYS, per_day: int = 3, seed: int = 7) -> list[HistoryRow]:
    """Let the motor live its year and return what the gateway would have stored."""
    chance, clock, memory = random.Random(seed), HandClock(epoch_s=UTC_S), MemoryHistory()
    store: Any = memory
    delivery = Delivery(RecordWriter(clock, log_failure, boot="8c41d07e"), store, NO_OUTBOX)
    profile, timing = load_profile("ssw07"), LineTiming(19200, Framing.parse("8E1"))
    setup = StarterSetup(STARTER, "cooling", 7, profile, Variant(rated_current_a=200.0), timing)
    history = MotorStarts(setup, delivery, lambda _: None)
    history.restore(Past((), (), ()))
    starts, hours = 0, 0.0
    for day in range(days):
        for number in range(per_day):
            begin_s = BEGAN_S - UTC_S + day * DAY_S + 5 * 3600 + number * 5.5 * 3600 + chance.uniform(0, 1800)
            for readings in _start(begin_s, day, chance).replies(begin_s - 3.0, begin_s + 32.0):
                clock.s = readings.at_s
                history.take_readings(readings)
            starts, hours = starts + 1, hours + chance.uniform(4.0, 5.0)
            delivery.release()
    history.close()
    delivery.release()
    return [*memory.stored.values(), *_trips(), _counters(starts, hours)]


def _start(begin_s: float, day: int, chance: random.Random) -> ReadMotor:
    """Return a start of this day: warmer days start easier, and wear grows from day 240 on."""
    wear = max(0.0, (day - 240) / 140) ** 1.3
    season = 0.3 * (1 if 120 < day < 300 else 0)
    ramp_s = 9.0 - season + 2.4 * wear + chance.gauss(0, 0.15)
    peak_a = 640.0 + 45.0 * wear + chance.gauss(0, 6.0)
    load_a = 168.0 + 6.0 * wear + chance.gauss(0, 2.0)
    start = AnalyticStart(begin_s, ramp_s, peak_a, load_a)
    return ReadMotor(start, seed=chance.randrange(1 << 30), noise=0.012, fast_s=0.2, is_ours=True)


def _trips() -> list[HistoryRow]:
    found = []
    for number, (day, code, text) in enumerate(
        ((96, "e03", "Phase loss"), (331, "e05", "Motor overload"), (362, "e05", "Motor overload"))
    ):
        time_s, id_ = BEGAN_S + day * DAY_S + 47_000.0 + 911 * number, f"8c41d07e-t{number}"
        nothing = {"readings": NOTHING, "at_fault": {}, "fault_history": (), "state_before": "running"}
        trip = replace(TRIP, starter=STARTER, id=id_, time_s=time_s, code=code, text=text, **nothing)
        found.append(HistoryRow(STARTER, "trip", id_, stored(trip), 100))
    return found


def _counters(starts: int, hours: float) -> HistoryRow:
    bands = {"low": 0.02, "normal": 0.81, "high": 0.16, "over": 0.01}
    totals = {
        "operating_s": hours * 3600,
        "bands_s": {name: share * hours * 3600 for name, share in bands.items()},
        "energy_kwh": hours * 96.0,
        "starts": starts,
        "trips": {"e05": 2, "e03": 1},
    }
    return HistoryRow(STARTER, "counters", "8c41d07e", {"totals": totals, "thermal": {}})


async def write(folder: Path, rows: Sequence[HistoryRow], *, port: int = 1) -> Path:
    """Write configuration, history, audit and identity, and return the configuration's path."""
    state_dir = folder / "state"
    store = HistoryStore(state_dir / HISTORY_FILE)
    store.start(lambda *_: None, lambda _: None)
    for row in rows:
        store.put(row)
    assert await store.close(within_s=10.0)
    state = state_dir / STATE_FILE
    known = {STARTER: Known(Fingerprint(model="SSW-07", firmware="1.60"))}
    write_document(state, FINGERPRINTS, KNOWN, known)
    entries = (
        _set(40, "maintenance", "P314", 10, {"P314": 0}),
        _set(342, "maintenance", "P314", 5, {"P314": 10}),
        _set(342, "maintenance", "P313", 2, {"P313": 0}),
    )
    with closing(sqlite3.connect(state)) as connection, connection:
        lines = [(json.dumps(entry),) for entry in entries]
        connection.executemany("INSERT INTO audit (line, upto) VALUES (?, 0)", lines)
    path = folder / "site.toml"
    path.write_text(CONFIG.format(port=port))
    return path


def report_of(path: Path, language: str = "en", published: PublishedFacts = PUBLISHED) -> ReportDocument:
    """Return the report of a year that was written."""
    on, motor = place_of(load(path), STARTER)
    profile, state_dir = load_profile(motor.family, language), path.parent / "state"
    facts = facts_of(on, motor, profile=profile, state_dir=state_dir, published=published)
    return document_of(facts, gateway="cement-mill", made_s=BEGAN_S + DAYS * DAY_S, language=language)


def _set(day: int, client: str, code: str, value: int, before: dict[str, int]) -> dict[str, Any]:
    return {
        "kind": "command",
        "time": rfc3339(BEGAN_S + day * DAY_S + 33_000),
        "starter": STARTER,
        "client": client,
        "verb": "set",
        "args": {"parameter": code, "value": value},
        "decision": "confirmed",
        "code": "ok",
        "before": before,
        "after": {},
    }
