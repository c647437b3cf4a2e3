"""The starts of one motor: each is recorded, compared with the baseline, stored and published."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from gateway.contract import (
    AlarmRecord,
    AvailabilityRecord,
    CommandError,
    EventCode,
    InfoRecord,
    Phase,
    Record,
    ResultCode,
    ResultRecord,
    StartOutcome,
    StartRecord,
    StateRecord,
    read_stored,
    stored,
)
from gateway.plugins.history.baseline import Baseline, Month, Trend, TrendVerdict, month_of, values_of
from gateway.plugins.history.delivery import Delivery
from gateway.plugins.history.start_recorder import (
    LONGEST_S,
    FinishedStart,
    StartCommand,
    StartPoints,
    StartRecorder,
)
from gateway.starters.setup import StarterSetup
from gateway.starters.telemetry.readings import Readings
from gateway.storage.history_table import HistoryRow

log = logging.getLogger(__name__)

START, CURVE, MONTH, BASELINE = "start", "curve", "month", "baseline"  # kinds in the store
BASELINE_CURVE = "baseline_curve"  # of the baseline's typical start, which outlives the other curves
CURVES, SUMMARIES, MONTHS = 20, 250, 18  # of each starter that stay
DRIFT = "start_drift"  # event and alarm
NOT_DRIVEN = ("offline", "disabled")  # availability

T = TypeVar("T")


class MotorStarts:
    """Records starts one after the other; they are without their samples as soon as these are stored."""

    kinds = (START, MONTH, BASELINE, BASELINE_CURVE)

    def __init__(self, setup: StarterSetup, delivery: Delivery) -> None:
        self._starter = setup.name
        self._delivery = delivery
        self._records = delivery.records
        self._recorder = self._recorder_of(setup)
        self._trend = Trend()
        self._latest: list[StartRecord] = []  # those whose curves are stored
        self._month: Month | None = None
        self._early: list[FinishedStart] | None = []  # over before `restore`
        self._curve_of = ""  # the start whose curve is stored as the baseline's
        self._is_unread = False  # what earlier runs have stored could not be read: none of it is replaced

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""
        self._finish(self._recorder.take(readings))

    def put(self, record: Record) -> None:
        """Record who gives a start, when the starter is lost, and its rated current."""
        match record:
            case ResultRecord(verb="start", is_duplicate=False):
                self._note_command(record)
            case AvailabilityRecord() if record.state in NOT_DRIVEN:
                self._finish(self._recorder.lose())
            case StateRecord(state="unknown"):
                self._finish(self._recorder.lose())
            case InfoRecord():
                self._recorder.rated_a = record.rated_current_a
            case _:
                pass

    def restore(self, rows: Sequence[HistoryRow] | None) -> None:
        """Go on from the starts of earlier runs; None: they cannot be read yet.

        Once they can be, this is called again, and the starts that this run has stored are among them.
        """
        was_unread, self._is_unread = self._is_unread, rows is None
        of_kind: dict[str, list[HistoryRow]] = {kind: [] for kind in self.kinds}
        for row in rows or ():
            of_kind.setdefault(row.kind, []).append(row)
        starts = [start for row in of_kind[START] if (start := self._read(StartRecord, row)) is not None]
        self._latest = starts[-CURVES:]
        self._trend = Trend()
        self._trend.restore(starts, next((self._read(Baseline, row) for row in of_kind[BASELINE]), None))
        month = max(of_kind[MONTH], key=lambda row: row.id, default=None)
        self._month = None if month is None else self._read(Month, month)
        if was_unread:
            for start in starts:
                if start.boot == self._records.boot:
                    self._count_in_month(start)
        self._curve_of = next((row.id for row in of_kind[BASELINE_CURVE]), "")
        self._put_alarm()
        self._copy_curve()  # unless an earlier run has
        early, self._early = self._early, None
        for finished in early or ():
            self._finish(finished)

    def reconfigure(self, setup: StarterSetup) -> None:
        """Go on with another machine or other polls under this name; what the broker knew of it is gone."""
        self._finish(self._recorder.lose())
        self._recorder = self._recorder_of(setup)
        if self._trend.baseline is not None and self._trend.baseline.is_raised:
            self._put_alarm()

    def close(self) -> None:
        """End the start under way."""
        self._finish(self._recorder.lose())

    def choose_baseline(self, id_: str | None, *, client: str) -> Mapping[str, Any]:
        """Compare later starts with this one (None: the last good one) and return it; CommandError."""
        if self._early is not None or self._is_unread:
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

    def _note_command(self, result: ResultRecord) -> None:
        if result.phase is Phase.WRITTEN:
            self._recorder.note_command(StartCommand(result.client, result.id, self._records.clock.now_s()))
        elif result.phase in (Phase.FAILED, Phase.REJECTED):
            self._recorder.forget_command(result.client, result.id)

    def _finish(self, finished: FinishedStart | None) -> None:
        if finished is None:
            return
        if self._early is not None:
            self._early.append(finished)
            return
        if finished.was_found and self._was_recorded(finished.record):
            return
        before = self._trend.baseline
        verdict = self._trend.add(finished.record, now_s=self._records.clock.utc_s())
        record = replace(finished.record, is_baseline=verdict.is_baseline, drift=verdict.drift)
        start = replace(record, samples={})
        self._latest = [*self._latest, start][-CURVES:]
        self._delivery.publish(record)
        self._count_in_month(start)
        self._store(CURVE, start.id, record.samples, limit=CURVES)
        self._store(START, start.id, _summary(start), limit=SUMMARIES, is_urgent=True)
        self._report(verdict, start)
        if self._trend.baseline is not before:
            self._store_baseline()

    def _was_recorded(self, found: StartRecord) -> bool:
        """Return whether a start that was under way at the first reading is the one given up before that."""
        latest = self._latest[-1] if self._latest else None
        if latest is None or latest.outcome is not StartOutcome.GIVEN_UP:
            return False
        return 0.0 <= found.time_s - latest.time_s <= LONGEST_S

    def _count_in_month(self, start: StartRecord) -> None:
        name = month_of(start.time_s)
        if self._month is None or self._month.month < name:  # a clock that was set back begins no new month
            self._month = Month(name)
        self._month.add(start)
        self._store(MONTH, self._month.month, stored(self._month), limit=MONTHS)

    def _store(
        self, kind: str, id_: str, data: Mapping[str, Any], *, limit: int, is_urgent: bool = False
    ) -> None:
        if not self._is_unread or kind in (START, CURVE):
            self._delivery.store(self._starter, kind, id_, data, limit=limit, is_urgent=is_urgent)

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
        if self._trend.baseline is not None:
            self._store(BASELINE, BASELINE, stored(self._trend.baseline), limit=1, is_urgent=True)
            self._copy_curve()

    def _copy_curve(self) -> None:
        """Have the curve of the baseline's typical start stored apart, unless it is."""
        baseline = self._trend.baseline
        if baseline is not None and baseline.typical != self._curve_of and not self._is_unread:
            self._curve_of = baseline.typical
            self._delivery.copy(self._starter, CURVE, baseline.typical, BASELINE_CURVE)

    def _read(self, kind: type[T], row: HistoryRow) -> T | None:
        try:
            return read_stored(kind, row.data, starter=self._starter)
        except ValueError as error:
            log.warning("starter=%s %s %s is lost: %s", self._starter, row.kind, row.id, error)
            return None


def _summary(start: StartRecord) -> Mapping[str, Any]:
    """Return what is stored of a start besides its curve."""
    return stored(start, without={"samples"})
