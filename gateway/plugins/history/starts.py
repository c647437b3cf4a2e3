"""The starts of one motor: each is recorded, compared with the baseline, stored and published."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from gateway.contract import (
    AlarmRecord,
    CommandError,
    EventCode,
    InfoRecord,
    Phase,
    Record,
    ResultCode,
    ResultRecord,
    StartRecord,
    StateRecord,
    read_stored,
    stored,
)
from gateway.plugins.history.baseline import Baseline, Month, Trend, TrendVerdict, month_of, values_of
from gateway.plugins.history.delivery import Delivery, Part, Past, Rows
from gateway.plugins.history.start_recorder import StartPoints, StartRecorder
from gateway.starters import Readings, StarterSetup
from gateway.store import HistoryRow

log = logging.getLogger(__name__)

START, CURVE, MONTH, BASELINE = "start", "curve", "month", "baseline"  # kinds in the store
BASELINE_CURVE = "baseline_curve"  # of the baseline's typical start, which outlives the other curves
CURVES, SUMMARIES, MONTHS = 20, 250, 18  # of each starter that stay
DRIFT = "start_drift"  # event and alarm

T = TypeVar("T")


class MotorStarts(Part):
    """Records starts one after the other; they are without their samples as soon as these are stored."""

    def __init__(self, setup: StarterSetup, delivery: Delivery, count: Callable[[StartRecord], None]) -> None:
        self._starter = setup.name
        self._delivery = delivery
        self._count = count
        self._records = delivery.records
        self._recorder = self._recorder_of(setup)
        self._trend = Trend()
        self._latest: list[StartRecord] = []  # those whose curves are stored
        self._month: Month | None = None
        self._is_restored = False

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""
        self._finish(self._recorder.take(readings))

    def put(self, record: Record) -> None:
        """Record who gives a start, when the starter is lost, and its rated current."""
        match record:
            case ResultRecord(verb="start", is_duplicate=False, phase=Phase.WRITTEN):
                self._recorder.note_command(record.client, record.id, self._records.clock.now_s())
            case ResultRecord(verb="start", is_duplicate=False, phase=Phase.FAILED | Phase.REJECTED):
                self._recorder.forget_command(record.client, record.id)
            case StateRecord(state="unknown"):
                self._finish(self._recorder.lose())
            case InfoRecord():
                self._recorder.rated_a = record.rated_current_a
            case _:
                pass

    def note_start_data(self, rows: Rows) -> None:
        """Put what the starter has stored of the start under way beside ours."""
        self._recorder.note_own(rows)

    def restore(self, past: Past) -> None:
        """Go on from the starts of earlier runs; then those come that they could not store."""
        starts = _stored_in(past.rows, START, StartRecord, starter=self._starter)
        self._latest = starts[-CURVES:]
        self._trend = Trend()
        self._trend.restore(starts, next(iter(_stored_in(past.rows, BASELINE, Baseline)), None))
        months = _stored_in(past.rows, MONTH, Month)
        self._month = max(months, key=lambda month: month.month, default=None)
        for latest in (*starts, *past.starts)[-1:]:
            self._recorder.given_up_s = latest.time_s if latest.outcome == "given_up" else None
        if self._trend.baseline is not None and not any(row.kind == BASELINE for row in past.rows):
            self._store_baseline()  # the run that made it was killed
        self._put_alarm()
        self._is_restored = True
        for start in past.starts:
            self._keep(start)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Go on with another machine or other polls under this name; what the broker knew of it is gone."""
        self._finish(self._recorder.lose())
        given_up_s, self._recorder = self._recorder.given_up_s, self._recorder_of(setup)
        self._recorder.given_up_s = given_up_s
        if self._trend.baseline is not None and self._trend.baseline.is_raised:
            self._put_alarm()

    def close(self) -> None:
        """End the start under way."""
        self._finish(self._recorder.lose())

    def choose_baseline(self, id_: str | None, *, client: str) -> Mapping[str, Any]:
        """Compare later starts with this one (None: the last good one) and return it; CommandError."""
        if not self._is_restored:
            raise CommandError(ResultCode.HISTORY_UNAVAILABLE)
        candidates = [start for start in reversed(self._latest) if id_ in (None, start.id)]
        if id_ is not None and not candidates:
            raise CommandError(ResultCode.NO_START, "unknown", start=id_[:60], count=CURVES)
        # The most complete first: a start without its current is chosen only where no other is there.
        for start in sorted(candidates, key=lambda start: len(values_of(start) or ()), reverse=True):
            if self._trend.set_baseline(start, client=client):
                self._mark_baseline(start)
                return _summary(replace(start, is_baseline=True))
        raise CommandError(ResultCode.NO_START, "last" if id_ is None else "chosen")

    def _recorder_of(self, setup: StarterSetup) -> StartRecorder:
        points, records = StartPoints.of(setup.profile), self._records
        recorder = StartRecorder(setup.name, points, boot=records.boot, sequence=records.sequence)
        recorder.rated_a = setup.variant.rated_current_a
        return recorder

    def _finish(self, start: StartRecord | None) -> None:
        """Publish a start that is over, judged against the starts before it, if these are known yet."""
        if start is None:
            return
        verdict = self._verdict_of(start) if self._is_restored else None
        judged = start if verdict is None else _with(verdict, start)
        self._delivery.publish(judged, partial(self._keep, start, verdict))

    def _verdict_of(self, start: StartRecord) -> TrendVerdict:
        return self._trend.add(start, now_s=self._records.clock.utc_s())

    def _keep(self, record: StartRecord, verdict: TrendVerdict | None = None) -> None:
        """Count and store a start that is certain; one that came before the earlier ones is judged now."""
        verdict = verdict or self._verdict_of(record)
        start = _with(verdict, replace(record, samples={}))
        self._latest = [*self._latest, start][-CURVES:]
        self._count(start)
        self._count_in_month(start)
        self._store(CURVE, start.id, record.samples, limit=CURVES)
        self._store(START, start.id, _summary(start), limit=SUMMARIES, is_urgent=True)
        self._report(verdict, start)
        if verdict.is_baseline or verdict.raised or verdict.is_over:
            self._store_baseline()

    def _count_in_month(self, start: StartRecord) -> None:
        name = month_of(start.time_s)
        if self._month is None or self._month.month < name:  # a clock that was set back begins no new month
            self._month = Month(name)
        self._month.add(start)
        self._store(MONTH, self._month.month, stored(self._month), limit=MONTHS)

    def _store(
        self, kind: str, id_: str, data: Mapping[str, Any], *, limit: int, is_urgent: bool = False
    ) -> None:
        self._delivery.store.put(HistoryRow(self._starter, kind, id_, data, limit), is_urgent=is_urgent)

    def _report(self, verdict: TrendVerdict, start: StartRecord) -> None:
        drift = _summary(start).get("drift", {})
        if verdict.raised:
            self._records.event(
                self._starter, EventCode.START_DRIFT, start=start.id, drift=drift, changes=verdict.raised
            )
            self._put_alarm()
        elif verdict.is_over:
            self._records.event(self._starter, EventCode.START_DRIFT_OVER, start=start.id, drift=drift)
            self._put_alarm()

    def _put_alarm(self) -> None:
        """Publish whether there is a drift, if there ever was one."""
        baseline, now_s = self._trend.baseline, self._records.clock.utc_s()
        if baseline is None or not baseline.alarm_count:
            return
        self._records.put(
            AlarmRecord(
                starter=self._starter,
                code=DRIFT,
                is_active=baseline.is_raised,
                severity="alarm",
                text=f"starts have changed: {baseline.text}",
                time_s=now_s if baseline.raised_s is None else baseline.raised_s,
                cleared_s=None if baseline.is_raised else now_s,
                count=baseline.alarm_count,
                seq=next(self._records.sequence),
                boot=self._records.boot,
            )
        )

    def _mark_baseline(self, chosen: StartRecord) -> None:
        """Store which start is the baseline; an alarm against the one before is over."""
        for index, start in enumerate(self._latest):
            marked = replace(start, is_baseline=start.id == chosen.id)
            if marked != start:
                self._latest[index] = marked
                self._store(START, marked.id, _summary(marked), limit=SUMMARIES)
        self._put_alarm()
        self._store_baseline()

    def _store_baseline(self) -> None:
        """Store the baseline, after the curve of its typical start: that outlives the other curves."""
        baseline = self._trend.baseline
        if baseline is not None:
            self._delivery.store.copy(self._starter, CURVE, baseline.typical, BASELINE_CURVE)
            self._store(BASELINE, BASELINE, stored(baseline), limit=1, is_urgent=True)


def _with(verdict: TrendVerdict, start: StartRecord) -> StartRecord:
    return replace(start, is_baseline=verdict.is_baseline, drift=verdict.drift)


def _summary(start: StartRecord) -> Mapping[str, Any]:
    """Return what is stored of a start besides its curve."""
    return {name: value for name, value in stored(start).items() if name != "samples"}


def _stored_in(rows: Iterable[HistoryRow], name: str, kind: type[T], **names: str) -> list[T]:
    """Return what rows of one kind say; one that says nothing is lost."""
    found = []
    for row in rows:
        try:
            found += [read_stored(kind, row.data, **names)] if row.kind == name else []
        except ValueError as error:
            log.warning("starter=%s %s %s is lost: %s", row.starter, name, row.id, error)
    return found
