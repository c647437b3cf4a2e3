"""The facts of one motor: its history and the audit on this disk, and the newest records of its gateway.

Everything here is as it was stored; `document` makes sentences, tables and plots of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from gateway.cli.audit import entry_in
from gateway.config import LineTable, StarterTable
from gateway.contract import CommandError, StartRecord, StartSamples, read_stored
from gateway.errors import StoreError
from gateway.families import Profile, parameters
from gateway.plugins.history.baseline import Baseline, Month
from gateway.plugins.history.counters import Totals, counted
from gateway.starters import FINGERPRINTS, KNOWN
from gateway.store import STATE_FILE, HistoryRow, read_audit, read_document, read_history, with_curves

SETTING_VERBS = frozenset({"set", "configure", "output"})

Json = Mapping[str, Any]


class ChangedSetting(NamedTuple):
    """A parameter that a command has changed, or somebody else: then the client is empty."""

    time: str
    client: str
    code: str
    name: str  # the manual's; empty: not known
    before: str  # empty: not known
    after: str


class PublishedFacts(NamedTuple):
    """The newest records of a gateway; empty where they could not be had."""

    statistics: Json  # of the line
    values: Mapping[str, float]  # by point


@dataclass
class MotorFacts:
    """One motor; lists begin with the oldest."""

    line: LineTable
    starter: StarterTable
    published: PublishedFacts
    starts: list[StartRecord] = field(default_factory=list)
    trips: list[Json] = field(default_factory=list)
    months: list[Month] = field(default_factory=list)
    baseline: Baseline | None = None
    baseline_curve: StartSamples | None = None
    totals: Totals = field(default_factory=Totals)
    settings: list[ChangedSetting] = field(default_factory=list)
    identity: Json = field(default_factory=dict)  # as the starter has said
    notes: list[str] = field(default_factory=list)  # what is missing, and why

    @property
    def cable(self) -> Json:
        """The cable, by the statistics of the line."""
        return self.published.statistics.get("cable") or {}


def facts_of(
    line: LineTable, starter: StarterTable, *, profile: Profile, state_dir: Path, published: PublishedFacts
) -> MotorFacts:
    """Return what is known of a motor; what is damaged is left out, and a note says so. StoreError."""
    facts = MotorFacts(line, starter, published)
    rows, state = read_history(state_dir, starter.name), state_dir / STATE_FILE
    damaged = 0
    for row in with_curves(rows):
        try:
            _add(facts, row)
        except ValueError:
            damaged += 1
    if damaged:
        facts.notes.append(f"{damaged} damaged records are left out")
    facts.months.sort(key=lambda month: month.month)
    facts.totals = counted(row.data for row in rows if row.kind == "counters").totals
    changes = list(_seen(rows, profile))
    try:
        if state.exists():
            changes += read_audit(state, lambda _, lines: list(_commanded(lines, starter.name, profile)))
    except StoreError as error:
        facts.notes.append(f"parameters changed by commands are left out: the audit cannot be read ({error})")
    facts.settings = sorted(changes, key=lambda change: change.time)
    with suppress(StoreError):
        known = (read_document(state, FINGERPRINTS, KNOWN) or {}).get(starter.name)
        facts.identity = {} if known is None else known.fingerprint.as_data()
    return facts


def _add(facts: MotorFacts, row: HistoryRow) -> None:
    match row.kind:
        case "start":
            facts.starts.append(read_stored(StartRecord, row.data, starter=row.starter))
        case "trip":
            facts.trips.append(row.data)
        case "month":
            facts.months.append(read_stored(Month, row.data))
        case "baseline":
            facts.baseline = read_stored(Baseline, row.data)
        case "baseline_curve":
            facts.baseline_curve = read_stored(StartSamples, row.data)


def _commanded(lines: Iterator[tuple[str, str]], starter: str, profile: Profile) -> Iterator[ChangedSetting]:
    """Yield the parameters that commands have changed, by the lines of the audit."""
    for _place, line in lines:
        entry = entry_in(line)
        is_setting = entry.get("starter") == starter and entry.get("verb") in SETTING_VERBS
        if not is_setting or entry.get("decision") != "confirmed" or entry.get("code") == "unchanged":
            continue
        args, before = entry.get("args") or {}, entry.get("before") or {}
        values = args.get("values")
        if not isinstance(values, Mapping):
            values = {args["parameter"]: args.get("value")} if args.get("parameter") else {}
        for code, value in values.items():
            name, unit = _row_of(profile, code)
            old = f"{before[code]} {unit}".strip() if code in before else ""
            new = f"{value} {unit}".strip()
            yield ChangedSetting(str(entry.get("time")), str(entry.get("client")), code, name, old, new)


def _seen(rows: Iterable[HistoryRow], profile: Profile) -> Iterator[ChangedSetting]:
    """Yield the parameters that the gateway has found changed, and not by itself."""
    for data in (row.data for row in rows if row.kind == "setting"):
        code, time = str(data.get("parameter") or ""), str(data.get("time") or "")
        name = _row_of(profile, code)[0] or str(data.get("name") or "")
        before, after = (_in_words(data.get(key)) for key in ("before", "after"))
        yield ChangedSetting(time, "", code, name, before, after)


def _in_words(value: object) -> str:
    """Return the value of a setting with its label or its unit."""
    if not isinstance(value, Mapping) or value.get("value") is None:
        return ""
    return f"{value['value']} {value.get('label') or value.get('unit') or ''}".strip()


def _row_of(profile: Profile, code: str) -> tuple[str, str]:
    """Return name and unit of a parameter; empty ones where the manual describes none."""
    with suppress(CommandError):
        row = profile.parameters.get(parameters.find(profile, code).code)
        if row is not None:
            return row.name, row.unit
    return "", ""
