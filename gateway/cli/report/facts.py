"""The rows and tables of a report as texts, the same for the terminal and the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from gateway.cli.report.content import TRENDS, HealthReport
from gateway.cli.report.labels import Translate
from gateway.contract import StartRecord, StartSamples, rfc3339
from gateway.plugins.history.baseline import LAST, LIMIT_PCT

MOST_STARTS, MOST_TRIPS, MOST_SETTINGS, MOST_MONTHS = 10, 10, 12, 12
UNKNOWN = "-"
UNITS = {  # by quantity: the unit that it is shown in, and how much of ours that is
    "acceleration_s": ("s", 1.0),
    "peak_a": ("A", 1.0),
    "i2t_a2s": ("10⁶ A²s", 1e6),
    "lowest_v": ("V", 1.0),
    "heating_pct": ("%", 1.0),
}
_SHOWN = ("acceleration_s", "peak_a", "i2t_a2s", "lowest_v", "heating_pct")
_HOUR_S = 3600.0


class TextTable(NamedTuple):
    """A table of texts; the columns in `numbers` are of numbers."""

    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    numbers: frozenset[int] = frozenset()


def number(value: float | None, unit: str = "", digits: int = 3) -> str:
    """Return a value with about so many digits and fixed spaces between thousands."""
    if value is None:
        return UNKNOWN
    size = abs(value)
    is_whole = size >= 10 ** (digits - 1)
    text = f"{value:,.0f}".replace(",", "\xa0") if is_whole else f"{value:.{digits}g}"
    return f"{text} {unit}" if unit else text


def moment(time: str) -> str:
    """Return an RFC 3339 time to the minute."""
    return time[:16].replace("T", " ") if time else UNKNOWN


def attention(report: HealthReport, t: Translate) -> list[str]:
    """Return what a person should look at, the most important first; empty when all is as usual."""
    found = drift(report, t)
    latest = report.starts[-20:]
    for outcome in ("tripped", "given_up"):
        count = sum(start.outcome == outcome for start in latest)
        if count:
            found.append(f"{count} {t('of the last 20 starts')}: {t(outcome.replace('_', ' '))}")
    left = report.live.get("starts_left")
    if isinstance(left, int) and left <= 1:
        found.append(f"{t('starts left this hour')}: {left}")
    return found + list(report.line.texts if report.line is not None else ())


def life(report: HealthReport, t: Translate) -> list[tuple[str, str]]:
    """Return hours, starts, trips and limits."""
    totals, live = report.totals, report.live
    hours = live.get("hours_total", totals.operating_s / _HOUR_S)
    rows = [(t("operating hours"), number(float(hours), "h"))]
    if sum(totals.bands_s.values()) > 0:
        limits = {"low": "<50", "normal": "50\u201190", "high": "90\u2011120", "over": ">120"}
        bands = (f"{limits[name]}\xa0%:\xa0{number(s / _HOUR_S)}\xa0h" for name, s in totals.bands_s.items())
        rows.append((t("hours by load"), ", ".join(bands)))
    energy = live.get("energy_kwh", totals.energy_kwh)
    if energy:
        rows.append((t("energy"), number(float(energy), "kWh")))
    rows.append((t("starts"), number(totals.starts)))
    codes = ", ".join(f"{code.upper()}: {count}" for code, count in totals.trips.most_common())
    rows.append((t("trips"), f"{totals.trips.total()}{f' ({codes})' if codes else ''}"))
    shown = {
        "starts_left": "starts left this hour",
        "pause_left_s": "pause left",
        "standstill_s": "standstill",
        "restart_in_s": "cool enough for a start in",
    }
    for name, label in shown.items():
        if name in live:
            rows.append((t(label), _span(float(live[name])) if name.endswith("_s") else str(live[name])))
    return rows


def comparison(report: HealthReport, t: Translate) -> TextTable:
    """Return the baseline beside the last start, and beside the median of the last ones once that counts."""
    last = report.last
    rows = []
    for name in TRENDS:
        usual, drift = report.typical(name), None if last is None else last.drift.get(name)
        now = None if last is None else getattr(last, name)
        median = now if drift is None else drift.median
        change = UNKNOWN if not usual or median is None else f"{100 * (median / usual - 1):+.0f} %"
        middle = UNKNOWN if drift is None else value(name, drift.median)
        rows.append((quantity(name, t), value(name, usual), middle, value(name, now), change))
    head = ("", t("baseline"), f"{t('median of')} {LAST}", t("last start"), t("change"))
    return TextTable(head, rows, frozenset({1, 2, 3, 4}))


def drift(report: HealthReport, t: Translate) -> list[str]:
    """Return how the last starts differ from the baseline while a drift is raised."""
    last = report.last
    if not report.drift or last is None:
        return []
    found = [
        f"{quantity(name, t)} {change.change_pct:+.0f} %: {value(name, change.baseline)} -> "
        f"{value(name, change.median)} ({t('median of the last')} {LAST})"
        for name, change in last.drift.items()
        if name in TRENDS and abs(change.change_pct) >= LIMIT_PCT
    ]
    return found or [report.drift]


def starts(report: HealthReport, t: Translate) -> TextTable:
    """Return the last starts, the newest first."""
    rows = [
        (
            moment(str(rfc3339(start.time_s))),
            t(start.outcome.value.replace("_", " ")),
            *(_with_error(name, start) for name in _SHOWN),
            start.cause.client or start.cause.source.value,
        )
        for start in report.starts[: -MOST_STARTS - 1 : -1]
    ]
    table = TextTable((t("time"), t("outcome"), *_heads(t), t("given by")), rows, frozenset(range(2, 7)))
    return _without_unknown(table)


def months(report: HealthReport, t: Translate) -> TextTable:
    """Return the means by month, the oldest first."""
    rows = [
        (month.month, str(month.starts), *(shown(name, month.mean(name)) for name in _SHOWN))
        for month in report.months[-MOST_MONTHS:]
    ]
    return _without_unknown(TextTable((t("month"), t("starts"), *_heads(t)), rows, frozenset(range(1, 7))))


def trips(report: HealthReport, t: Translate) -> TextTable:
    """Return the last trips, the newest first."""
    rows = []
    for trip in report.trips[:MOST_TRIPS]:
        time, code, text, before = (str(trip.get(n) or "") for n in ("time", "code", "text", "state_before"))
        rows.append((moment(time), f"{code.upper()} {text}", before or UNKNOWN))
    return TextTable((t("time"), t("fault"), t("state before")), rows)


def settings(report: HealthReport, t: Translate) -> TextTable:
    """Return the parameters that commands or others have changed, the newest first."""
    rows = [
        (
            moment(each.time),
            f"{each.code} {each.name}".strip(),
            each.before or UNKNOWN,
            each.after,
            each.client or t("at the starter"),
        )
        for each in report.settings[:MOST_SETTINGS]
    ]
    return TextTable((t("time"), t("parameter"), t("before"), t("after"), t("by")), rows)


def line(report: HealthReport, t: Translate) -> list[tuple[str, str]]:
    """Return what the line says of this starter; empty when that could not be had."""
    if report.line is None:
        return []
    numbers, rates = report.line.numbers, report.line.rates
    names = ("asked", "answered", "silent", "corrupted", "late", "refused")
    counts = ", ".join(f"{number(numbers[name])} {t(name)}" for name in names if name in numbers)
    rows = [(t("replies"), counts or UNKNOWN)]
    times = numbers.get("response_time_s") or {}
    if times.get("p50") is not None:
        ms = {name: 1000 * times[name] for name in ("p50", "p99") if times.get(name) is not None}
        rows.append(
            (t("response time"), ", ".join(f"{name} {number(each, 'ms')}" for name, each in ms.items()))
        )
    if rates:
        share = {name: 100 * rates[name] for name in ("error_rate", "silent_rate", "late_rate")}
        words = {"error_rate": "corrupted", "silent_rate": "lost", "late_rate": "late"}
        shares = ", ".join(f"{value:.2f}\xa0% {t(words[name])}" for name, value in share.items())
        rows.append((t("errors lately"), shares))
    if not report.line.texts and rates:
        rows.append(("", t("the cable looks good")))
    return rows


def quantity(name: str, t: Translate) -> str:
    """Return the name of a quantity of a start."""
    return {"acceleration_s": t("acceleration time"), "peak_a": t("peak current"), "i2t_a2s": "I²t"}[name]


def shown(name: str, amount: float | None) -> str:
    """Return a quantity in the unit of `UNITS`, without it."""
    if amount is None:
        return UNKNOWN
    scaled = amount / UNITS[name][1]
    return f"{scaled:,.0f}".replace(",", "\xa0") if abs(scaled) >= 100 else f"{scaled:#.3g}"


def _with_error(name: str, start: StartRecord) -> str:
    """Return a quantity of a start, with what it is known to plus or minus where the record says that."""
    text = shown(name, getattr(start, name))
    if name == "acceleration_s" and start.acceleration_s is not None and start.resolution_s:
        return f"{text}\xa0±{start.resolution_s:.1g}"
    if name == "i2t_a2s" and start.i2t_a2s is not None and start.i2t_error_pct:
        return f"{text}\xa0±{start.i2t_error_pct:.0f}\xa0%"
    return text


def current_of(curve: StartSamples) -> list[tuple[float, float]]:
    """Return the current of a start by its time, where it was read."""
    pairs = zip(curve["t_s"], curve.get("current", ()), strict=False)
    return [(t_s, current) for t_s, current in pairs if current is not None]


def value(name: str, amount: float | None) -> str:
    """Return a quantity with its unit."""
    if amount is None:
        return UNKNOWN
    unit = UNITS[name][0]
    return f"{shown(name, amount)}{'·' if unit.startswith('10') else ' '}{unit}"


def _heads(t: Translate) -> tuple[str, ...]:
    words = {"acceleration_s": "time", "peak_a": "current", "heating_pct": "heating", "lowest_v": "voltage"}
    return tuple(f"{t(words.get(name, 'I²t'))} {UNITS[name][0]}" for name in _SHOWN)


def _without_unknown(table: TextTable) -> TextTable:
    """Return a table without the columns of numbers that nothing is known of."""
    left = [
        at
        for at in range(len(table.head))
        if at not in table.numbers or any(row[at] != UNKNOWN for row in table.rows)
    ]
    numbers = frozenset(new for new, old in enumerate(left) if old in table.numbers)
    return TextTable(
        tuple(table.head[at] for at in left), [tuple(row[at] for at in left) for row in table.rows], numbers
    )


def _span(seconds: float) -> str:
    for size, unit in ((86400.0, "d"), (_HOUR_S, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.0f} s"
