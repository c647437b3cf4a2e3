"""What a health report says, from what a gateway has stored; nothing is printed or read here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gateway.contract import CommandError, StartRecord, StartSamples, read_stored
from gateway.families import Parameter, Profile, parameters
from gateway.plugins.history.baseline import Baseline, Month
from gateway.plugins.history.counters import Totals, counted
from gateway.store import HistoryRow

SETTING_VERBS = frozenset({"set", "configure", "output"})
TRENDS = ("acceleration_s", "peak_a", "i2t_a2s")
_OWN_POINTS = ("hours_total", "energy_kwh", "starts_left", "pause_left_s", "standstill_s", "restart_in_s")


@dataclass(frozen=True, slots=True)
class Setting:
    """A parameter that a command has changed, or somebody else: then the client is empty."""

    time: str
    client: str
    code: str
    name: str  # the manual's, empty when it is not known
    before: str  # empty when it is not known
    after: str


@dataclass(frozen=True, slots=True)
class LineQuality:
    """What the line has last published; empty texts say that nothing is wrong with its cable."""

    line: str
    numbers: Mapping[str, Any]  # of this starter: asked, answered, silent, garbled, response_time_s ...
    rates: Mapping[str, float]
    texts: tuple[str, ...]


@dataclass
class HealthReport:
    """All facts of a report."""

    starter: str
    gateway: str
    made: str  # RFC 3339
    identity: dict[str, str] = field(default_factory=dict)  # by label, in order
    totals: Totals = field(default_factory=Totals)
    live: dict[str, float | int | str] = field(default_factory=dict)  # own points, as last published
    starts: list[StartRecord] = field(default_factory=list)  # the oldest first
    curves: list[StartSamples] = field(default_factory=list)  # the oldest first
    baseline: Baseline | None = None
    baseline_curve: StartSamples | None = None
    drift: str = ""  # in words, while it is raised
    months: list[Month] = field(default_factory=list)
    trips: list[Mapping[str, Any]] = field(default_factory=list)  # as stored, the newest first
    settings: list[Setting] = field(default_factory=list)  # the newest first
    line: LineQuality | None = None
    notes: list[str] = field(default_factory=list)  # what could not be had, and why

    @property
    def rated_a(self) -> float | None:
        """The rated current, as the last start knew it."""
        return next((each.rated_a for each in reversed(self.starts) if each.rated_a), None)

    @property
    def last(self) -> StartRecord | None:
        """The latest start."""
        return self.starts[-1] if self.starts else None

    def typical(self, name: str) -> float | None:
        """Return the baseline of a quantity."""
        return None if self.baseline is None else self.baseline.values.get(name)


def add_rows(report: HealthReport, rows: Sequence[HistoryRow]) -> None:
    """Add what is stored of this starter; a damaged row is left out, and that is noted."""
    damaged = 0
    for row in rows:
        try:
            _add_row(report, row)
        except ValueError:
            damaged += 1
    report.totals = counted(row.data for row in rows if row.kind == "counters").totals
    report.trips.reverse()
    report.months.sort(key=lambda month: month.month)
    if damaged:
        report.notes.append(f"{damaged} damaged records are left out")


def _add_row(report: HealthReport, row: HistoryRow) -> None:
    data = row.data
    match row.kind:
        case "start":
            report.starts.append(read_stored(StartRecord, data, starter=row.starter))
        case "curve":
            report.curves.append(read_stored(StartSamples, data))
        case "baseline":
            report.baseline = read_stored(Baseline, data)
            report.drift = report.baseline.text if report.baseline.is_raised else ""
        case "baseline_curve":
            report.baseline_curve = read_stored(StartSamples, data)
        case "month":
            report.months.append(read_stored(Month, data))
        case "trip":
            report.trips.append(data)
        case _:
            pass  # counters are summed up apart


def settings_in(entries: Iterable[Mapping[str, Any]], starter: str, profile: Profile) -> list[Setting]:
    """Return the parameters of a starter that commands have changed, by the audit; the newest first."""
    known: dict[str, str] = {}  # by code, what was set last
    found = []
    for entry in entries:
        if entry.get("starter") != starter or entry.get("verb") not in SETTING_VERBS:
            continue
        if entry.get("decision") != "confirmed" or entry.get("code") == "unchanged":
            continue
        args = entry.get("args") or {}
        before = entry.get("before") or {}
        for code, value in _values_of(args).items():
            row = _row_of(profile, code)
            unit = f" {row.unit}" if row is not None and row.unit else ""
            old = f"{before[code]}{unit}" if code in before else known.get(code, "")
            known[code] = f"{value}{unit}"
            name = "" if row is None else row.name
            time, client = str(entry.get("time") or ""), str(entry.get("client") or "")
            found.append(Setting(time, client, code, name, old, known[code]))
    return found[::-1]


def settings_seen(rows: Iterable[HistoryRow], profile: Profile) -> list[Setting]:
    """Return the parameters that the gateway has found changed, and not by itself; the newest first."""
    found = []
    for row in rows:
        code = str(row.data.get("parameter") or "")
        if row.kind != "setting" or not code:
            continue
        known = _row_of(profile, code)
        name = str(row.data.get("name") or "") if known is None else known.name
        before, after = (_shown(row.data.get(key)) for key in ("before", "after"))
        found.append(Setting(str(row.data.get("time") or ""), "", code, name, before, after))
    return found[::-1]


def _shown(entry: Any) -> str:
    """Return a value of a setting with its unit, or its label."""
    if not isinstance(entry, Mapping) or entry.get("value") is None:
        return ""
    label, unit = entry.get("label"), entry.get("unit")
    return f"{entry['value']}" + (f" {label}" if label else f" {unit}" if unit else "")


def _row_of(profile: Profile, code: str) -> Parameter | None:
    try:
        row = parameters.find(profile, code)
    except CommandError:
        return None
    return row if row.code in profile.parameters else None


def _values_of(args: Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(args.get("values"), Mapping):
        return {str(code): value for code, value in args["values"].items()}
    code = args.get("parameter")
    return {str(code): args.get("value")} if code else {}


def line_quality(line: str, starter: str, address: int, published: Mapping[str, Any]) -> LineQuality:
    """Return what a line's statistics say of one starter."""
    cable = published.get("cable") or {}
    return LineQuality(
        line,
        (published.get("units") or {}).get(str(address)) or {},
        (cable.get("starters") or {}).get(starter) or {},
        tuple(str(text) for text in cable.get("texts") or ()),
    )


def add_values(report: HealthReport, values: Mapping[str, Any]) -> None:
    """Add the own points among a starter's published values, each a payload."""
    for name in _OWN_POINTS:
        payload = values.get(name)
        if isinstance(payload, Mapping) and isinstance(payload.get("value"), int | float):
            report.live[name] = payload["value"]
