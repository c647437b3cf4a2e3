"""A health report as tables and plots, the same for the terminal and the page."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from gateway.cli.command import coded
from gateway.cli.report.facts import MotorFacts
from gateway.cli.report.plots import Plot, PlotLine
from gateway.contract import rfc3339
from gateway.families import ENGLISH
from gateway.plugins.history.baseline import LAST, LIMIT_PCT

MOST = 10  # starts, trips or settings in a table
MOST_MONTHS = 18
LATEST_STARTS = 20  # in which trips are counted
UNKNOWN = "-"
TRENDS = ("acceleration_s", "peak_a", "i2t_a2s")  # compared with the baseline
BANDS = {"low": "<50", "normal": "50\u201190", "high": "90\u2011120", "over": ">120"}  # % of rated current
REPLIES = ("asked", "answered", "silent", "corrupted", "late", "refused")
RATES = {"error_rate": "corrupted", "silent_rate": "lost", "late_rate": "late"}
LEGEND = ("latest", "earlier", "baseline")
LABELS = Path(__file__).with_name("labels.csv")

Translate = Callable[[str], str]


class Quantity(NamedTuple):
    """A measured quantity of a start."""

    label: str
    head: str  # of its column
    unit: str
    size: float = 1.0  # of the unit, in the record's

    def text(self, amount: float | None) -> str:
        """Return an amount, without the unit."""
        return UNKNOWN if amount is None else _number(float(amount) / self.size)


QUANTITIES = {
    "acceleration_s": Quantity("acceleration time", "acceleration", "s"),
    "peak_a": Quantity("peak current", "peak", "A"),
    "i2t_a2s": Quantity("I²t", "I²t", "10⁶A²s", 1e6),
    "lowest_v": Quantity("lowest voltage", "voltage", "V"),
    "heating_pct": Quantity("heating", "heating", "%"),
}


class FactTable(NamedTuple):
    """A table of texts; the columns in `numbers` are of numbers. Without a head: facts, or sentences."""

    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    numbers: range = range(0)


class Section(NamedTuple):
    """A title, plots side by side, which a page shows, and the tables below them, the last with all facts."""

    title: str
    tables: Sequence[FactTable]
    plots: Sequence[Plot] = ()


class ReportDocument(NamedTuple):
    """A report in one language."""

    title: str
    starter: str
    subtitle: str
    verdict: str
    warnings: FactTable  # sentences, the most important first
    sections: Sequence[Section]  # those of which something is known
    legend: Mapping[str, str]  # the meaning of each kind of curve


def document_of(facts: MotorFacts, *, gateway: str, made_s: float, language: str) -> ReportDocument:
    """Return the report of a motor, made at this time (UTC)."""
    t = _translator(language)
    warnings = [(text,) for text in _warnings(facts, t)]
    sections = (
        Section(t("Identity"), [FactTable(list(_identity(facts, t)))]),
        Section(t("Life"), [FactTable(list(_life(facts, t)))]),
        Section(t("Starts"), [_comparison(facts, t), _starts(facts, t)], [_start_curves(facts, t)]),
        Section(t("Trends by month"), [_months(facts, t)], list(_trends(facts, t))),
        Section(t("Trips"), [_trips(facts, t)]),
        Section(t("Changed parameters"), [_settings(facts, t)]),
        Section(f"{t('Line')} {facts.line.name}", [FactTable(list(_replies(facts, t)))]),
        Section(t("Notes"), [FactTable([(text,) for text in facts.notes])]),
    )
    return ReportDocument(
        title=t("Health report"),
        starter=f"{facts.starter.title} ({facts.starter.name})"
        if facts.starter.title
        else facts.starter.name,
        subtitle=f"{t('gateway')} {gateway}, {t('made')} {_minute(rfc3339(made_s))} UTC",
        verdict=t("Attention") if warnings else t("Nothing unusual"),
        warnings=FactTable(warnings),
        sections=[section for section in sections if section.tables[-1].rows],
        legend={**{kind: t(kind) for kind in LEGEND}, "limit": f"{LIMIT_PCT:g} % {t('from the baseline')}"},
    )


def _warnings(facts: MotorFacts, t: Translate) -> Iterator[str]:
    if facts.baseline is not None and facts.baseline.is_raised and facts.starts:
        changes = {name: change.change_pct for name, change in facts.starts[-1].drift.items()}
        far = [name for name in TRENDS if abs(changes.get(name, 0.0)) >= LIMIT_PCT]
        words = ", ".join(f"{t(QUANTITIES[name].label)} {changes[name]:+.0f} %" for name in far)
        yield f"{t('the last starts differ from the baseline')}: {words or facts.baseline.text}"
    latest = [start.outcome for start in facts.starts[-LATEST_STARTS:]]
    for outcome in ("tripped", "given_up"):
        if outcome in latest:
            of_all = t("of the last {n} starts").replace("{n}", str(len(latest)))
            yield f"{latest.count(outcome)} {of_all}: {t(_spaced(outcome))}"
    yield from map(str, facts.cable.get("texts") or ())


def _identity(facts: MotorFacts, t: Translate) -> Iterator[tuple[str, str]]:
    """Yield the identity of the starter: as it is configured, else as it has said."""
    line, starter, said = facts.line, facts.starter, facts.identity
    of_motor = (f"{start.rated_a:g} A" for start in reversed(facts.starts) if start.rated_a)
    fields = {
        "family": starter.family.upper(),
        "model": starter.model or said.get("model"),
        "firmware": said.get("firmware"),
        "serial number": said.get("serial"),
        "rated current": next(of_motor, (said.get("rated_current") or "").replace(" to ", "\u2013")),
        "line": f"{line.name} ({line.port}, {line.baud} {line.framing})",
        "address": starter.address,
    }
    yield from ((t(label), str(value)) for label, value in fields.items() if value)


def _life(facts: MotorFacts, t: Translate) -> Iterator[tuple[str, str]]:
    totals = facts.totals
    yield t("operating hours"), _hours(facts.published.values.get("hours_total", totals.operating_s / 3600))
    yield t("starts"), _number(totals.starts)
    hours = (f"{BANDS[name]}\xa0%:\xa0{_hours(s / 3600)}" for name, s in totals.bands_s.items())
    yield t("hours by load"), ", ".join(hours)
    yield t("energy"), _number(float(facts.published.values.get("energy_kwh", totals.energy_kwh)), "kWh")
    trips = ", ".join(f"{code.upper()}: {count}" for code, count in totals.trips.most_common())
    yield t("trips"), trips or "0"


def _comparison(facts: MotorFacts, t: Translate) -> FactTable:
    """Return the baseline beside the last start, and beside the median of the last ones once that counts."""
    usual = {} if facts.baseline is None else facts.baseline.values
    rows = []
    for name in TRENDS:
        quantity = QUANTITIES[name]
        last = getattr(facts.starts[-1], name) if facts.starts else None
        drift = facts.starts[-1].drift.get(name) if facts.starts else None
        median = None if drift is None else drift.median
        now, change = last if median is None else median, UNKNOWN
        if now is not None and usual.get(name):
            change = f"{100 * (now / usual[name] - 1):+.0f} %"
        amounts = map(quantity.text, (usual.get(name), median, last))
        rows.append((f"{t(quantity.label)}, {quantity.unit}", *amounts, change))
    return FactTable(
        rows, ("", t("baseline"), f"{t('median of')} {LAST}", t("last start"), t("change")), range(1, 5)
    )


def _starts(facts: MotorFacts, t: Translate) -> FactTable:
    shown = facts.starts[: -MOST - 1 : -1]
    known = [name for name in QUANTITIES if any(getattr(start, name) is not None for start in shown)]
    rows = []
    for start in shown:
        amounts = {name: QUANTITIES[name].text(getattr(start, name)) for name in known}
        if start.resolution_s:
            amounts["acceleration_s"] += f"\xa0±{start.resolution_s:.1g}"
        by = start.cause.client or start.cause.source
        outcome = t(_spaced(start.outcome))
        rows.append((_minute(rfc3339(start.time_s)), outcome, *amounts.values(), by))
    head = (t("time"), t("outcome"), *_heads(known, t), t("given by"))
    return FactTable(rows, head, range(2, len(head) - 1))


def _months(facts: MotorFacts, t: Translate) -> FactTable:
    months = facts.months[-MOST_MONTHS:]
    known = [name for name in QUANTITIES if any(month.mean(name) is not None for month in months)]
    head = (t("month"), t("starts"), *_heads(known, t))
    rows = [
        (month.month, str(month.starts), *(QUANTITIES[name].text(month.mean(name)) for name in known))
        for month in months
    ]
    return FactTable(rows, head, range(1, len(head)))


def _heads(names: Iterable[str], t: Translate) -> list[str]:
    return [f"{t(QUANTITIES[name].head)} {QUANTITIES[name].unit}" for name in names]


def _trips(facts: MotorFacts, t: Translate) -> FactTable:
    rows = []
    for trip in facts.trips[: -MOST - 1 : -1]:
        code, text, before = (str(trip.get(key) or "") for key in ("code", "text", "state_before"))
        rows.append((_minute(trip.get("time")), coded(code, text), before or UNKNOWN))
    return FactTable(rows, (t("time"), t("fault"), t("state before")))


def _settings(facts: MotorFacts, t: Translate) -> FactTable:
    rows = [
        (_minute(s.time), f"{s.code} {s.name}", s.before or UNKNOWN, s.after, s.client or t("at the starter"))
        for s in facts.settings[: -MOST - 1 : -1]
    ]
    return FactTable(rows, (t("time"), t("parameter"), t("before"), t("after"), t("by")))


def _replies(facts: MotorFacts, t: Translate) -> Iterator[tuple[str, str]]:
    """Yield how the starter answers, by the line's statistics."""
    counts = (facts.published.statistics.get("units") or {}).get(str(facts.starter.address)) or {}
    if counts:
        words = (f"{_number(counts[name])} {t(name)}" for name in REPLIES if name in counts)
        yield t("replies"), ", ".join(words)
    rates = (facts.cable.get("starters") or {}).get(facts.starter.name) or {}
    if rates:
        words = (f"{100 * rates[name]:.2f}\xa0% {t(word)}" for name, word in RATES.items() if name in rates)
        yield t("errors lately"), ", ".join(words)


def _start_curves(facts: MotorFacts, t: Translate) -> Plot:
    """Return the starts whose curves are stored, and the baseline's over them."""
    typical = None if facts.baseline is None else facts.baseline.typical  # has its own, dashed curve
    curves = [s.samples for s in facts.starts if s.samples and (s.id != typical or s is facts.starts[-1])]
    drawn = [PlotLine(_current_of(curve), "earlier") for curve in curves[:-1]]
    drawn += [PlotLine(_current_of(curve), "latest") for curve in curves[-1:]]
    if facts.baseline_curve is not None:
        drawn.append(PlotLine(_current_of(facts.baseline_curve), "baseline"))
    return Plot(f"{t('current')}, A; {t('time')}, s", [curve for curve in drawn if curve.points])


def _current_of(samples: Mapping[str, Any]) -> list[tuple[float, float]]:
    pairs = zip(samples["t_s"], samples.get("current") or (), strict=False)
    return [(t_s, current) for t_s, current in pairs if current is not None]


def _trends(facts: MotorFacts, t: Translate) -> Iterator[Plot]:
    """Yield a plot of each compared quantity: its means by month, the baseline, the limits beside that."""
    months = facts.months[-MOST_MONTHS:]
    ends, share = (-0.6, len(months) - 0.4), LIMIT_PCT / 100
    for name in TRENDS:
        quantity = QUANTITIES[name]
        means = [(float(at), month.mean(name)) for at, month in enumerate(months)]
        curves = [PlotLine([(at, mean / quantity.size) for at, mean in means if mean is not None], "latest")]
        usual = None if facts.baseline is None else facts.baseline.values.get(name)
        levels = {} if usual is None else {1.0: "baseline", 1 - share: "limit", 1 + share: "limit"}
        for level, kind in levels.items():
            curves.append(PlotLine([(x, level * (usual or 0.0) / quantity.size) for x in ends], kind))
        yield Plot(
            f"{t(quantity.label)}, {quantity.unit}",
            [curve for curve in curves if curve.points],
            [month.month[2:] for month in months],
            width=180.0,
            height=96.0,
        )


def _number(value: float, unit: str = "") -> str:
    """Return a count as it is, another number with three digits; spaces between thousands."""
    is_whole = isinstance(value, int) or abs(value) >= 100
    text = f"{value:,.0f}".replace(",", "\xa0") if is_whole else f"{value:#.3g}"
    return f"{text} {unit}".rstrip()


def _hours(hours: float) -> str:
    return f"{hours:.1f}\xa0h" if hours < 100 else f"{_number(hours)}\xa0h"


def _minute(time: object) -> str:
    """Return an RFC 3339 time to the minute."""
    return str(time)[:16].replace("T", " ") if time else UNKNOWN


def _spaced(word: str) -> str:
    return word.replace("_", " ")


def _translator(language: str) -> Translate:
    """Return what puts a word of the report into a language; a word that is not listed stays English."""
    if language == ENGLISH:
        return str
    with LABELS.open(encoding="utf-8", newline="") as file:
        words = {row[ENGLISH]: row[language] for row in csv.DictReader(file)}
    return lambda word: words.get(word, word)
