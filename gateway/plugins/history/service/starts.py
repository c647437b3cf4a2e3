"""The starts of one motor: recorded, compared with the baseline, stored, published."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

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
    StartRecord,
    StateRecord,
)
from gateway.errors import DamagedError, StoreError
from gateway.plugins.history.baseline import Month, Trend, TrendVerdict, month_of, values_of
from gateway.plugins.history.service.part import HistoryPart, Surroundings
from gateway.plugins.history.start_record import StartOutcome, StartSummary, start_to_dict
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


class StartHistory(HistoryPart):
    """Records starts one after the other, and compares each."""

    kinds = (START, MONTH, BASELINE, BASELINE_CURVE)

    def __init__(self, setup: StarterSetup, here: Surroundings) -> None:
        super().__init__(setup, here)
        self._recorder = self._recorder_of(setup)
        self._trend = Trend()
        self._latest: list[StartSummary] = []  # those whose curves are stored
        self._month: Month | None = None
        self._early: list[FinishedStart] | None = []  # over before `restore`
        self._alarm_count = 0
        self._raised_s: float | None = None
        self._curve_of = ""  # the start whose curve is stored as the baseline's
        self._copying: asyncio.Task[None] | None = None
        self.is_unread = False  # what earlier runs have stored could not be read: none of it is replaced

    def take_readings(self, readings: Readings) -> None:
        """Record what was just read."""
        self._finish(self._recorder.take(readings))

    def take_record(self, record: Record) -> None:
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

    def restore(self, rows: Sequence[HistoryRow]) -> None:
        """Go on from the starts of earlier runs; again once they can be read, with those of this run."""
        starts = [start for row in rows if row.kind == START and (start := _summary(row)) is not None]
        stored = next((row.data for row in rows if row.kind == BASELINE), None)
        self._trend = Trend()
        try:
            self._trend.restore(starts, stored)
        except DamagedError as error:
            log.warning("starter=%s the baseline is lost: %s", self._name, error)
            self._trend = Trend()
            self._trend.restore(starts, None)
        self._latest = starts[-CURVES:]
        self._restore_month(rows)
        self._curve_of = next((row.id for row in rows if row.kind == BASELINE_CURVE), "")
        self._restore_alarm(stored or {})
        self._copy_curve()  # unless an earlier run has
        early, self._early = self._early, None
        for finished in early or ():
            self._finish(finished)

    def restore_late(self, rows: Sequence[HistoryRow]) -> None:
        """Restore what could not be read before; the starts since then are among the rows."""
        self.is_unread = False
        self.restore(rows)
        for row in rows:
            if row.kind == START and (start := _summary(row)) is not None and start.boot == self._here.boot:
                self._count_in_month(start)

    def follow(self, setup: StarterSetup) -> None:
        """Go on with another machine or other polls under this name; what the broker knew of it is gone."""
        self._finish(self._recorder.lose())
        self._recorder = self._recorder_of(setup)
        if self._trend.is_raised:
            self._put_alarm()

    def close(self) -> None:
        """End the start under way."""
        self._finish(self._recorder.lose())
        if self._copying is not None:
            self._copying.cancel()

    def choose_baseline(self, id_: str | None, *, client: str) -> StartSummary:
        """Compare later starts with this one (None: the last good one); CommandError when it cannot be."""
        if self._early is not None or self.is_unread:
            raise CommandError(ResultCode.HISTORY_UNAVAILABLE)
        candidates = [start for start in reversed(self._latest) if id_ in (None, start.id)]
        candidates.sort(
            key=lambda start: len(values_of(start) or ()), reverse=True
        )  # the most complete first
        if id_ is not None and not candidates:
            raise CommandError(ResultCode.NO_START, "unknown", start=id_[:60], count=CURVES)
        for start in candidates:
            if self._trend.set_baseline(start, client=client):
                self._mark_baseline(start)
                return replace(start, is_baseline=True)
        raise CommandError(ResultCode.NO_START, "last" if id_ is None else "chosen")

    def _recorder_of(self, setup: StarterSetup) -> StartRecorder:
        points, take_seq = StartPoints.of(setup.profile), self._records.sequence.take
        recorder = StartRecorder(points, boot=self._here.boot, take_seq=take_seq)
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
        if finished.was_found and self._was_recorded(finished.summary):
            return
        before = self._trend.baseline
        verdict = self._trend.add(finished.summary)
        summary = replace(finished.summary, is_baseline=verdict.is_baseline, drift=verdict.drift)
        self._latest = [*self._latest, summary][-CURVES:]
        record = StartRecord(starter=self._name, id=summary.id, data=start_to_dict(summary, finished.curve))
        self._records.put(record)  # counted by that: one transaction
        self._put_rows(replace(finished, summary=summary))
        self._report(verdict, summary)
        if self._trend.baseline is not before or verdict.raised or verdict.is_over:
            self._store_baseline()

    def _was_recorded(self, found: StartSummary) -> bool:
        """Return whether a start that was under way at the first reading is the one given up before that."""
        latest = self._latest[-1] if self._latest else None
        if latest is None or latest.outcome is not StartOutcome.GIVEN_UP:
            return False
        return 0.0 <= found.time_s - latest.time_s <= LONGEST_S

    def _put_rows(self, finished: FinishedStart) -> None:
        """Store a start, its curve and its month in one transaction."""
        summary = finished.summary
        self._count_in_month(summary)
        self._put(CURVE, summary.id, finished.curve.to_dict(), limit=CURVES)
        self._put(START, summary.id, summary.to_dict(), limit=SUMMARIES, is_urgent=True)

    def _count_in_month(self, summary: StartSummary) -> None:
        name = month_of(summary.time_s)
        if self._month is None or self._month.name < name:  # a clock that was set back begins no month anew
            self._month = Month(name)
        self._month.add(summary)
        self._put(MONTH, self._month.name, self._month.to_dict(), limit=MONTHS)

    def _put(
        self, kind: str, id_: str, data: Mapping[str, Any], *, limit: int, is_urgent: bool = False
    ) -> None:
        if not self.is_unread or kind in (START, CURVE):
            super()._put(kind, id_, data, limit=limit, is_urgent=is_urgent)

    def _report(self, verdict: TrendVerdict, summary: StartSummary) -> None:
        start, drift = summary.id, summary.to_dict().get("drift", {})
        if verdict.raised:
            self._alarm_count += 1
            self._raised_s = self._records.clock.utc_s()
            self._records.event(
                self._name, EventCode.START_DRIFT, start=start, drift=drift, changes=verdict.raised
            )
            self._put_alarm()
        elif verdict.is_over:
            self._records.event(self._name, EventCode.START_DRIFT_OVER, start=start, drift=drift)
            self._put_alarm()

    def _put_alarm(self) -> None:
        is_active, now_s = self._trend.is_raised, self._records.clock.utc_s()
        self._records.put(
            AlarmRecord(
                starter=self._name,
                code=DRIFT,
                is_active=is_active,
                severity="alarm",
                text=f"starts have changed: {self._trend.text}",
                time_s=now_s if self._raised_s is None else self._raised_s,
                cleared_s=None if is_active else now_s,
                count=self._alarm_count,
                seq=self._records.sequence.take(),
                boot=self._records.boot,
            )
        )

    def _mark_baseline(self, chosen: StartSummary) -> None:
        """Store which start is the baseline; an alarm against the one before is over."""
        for index, start in enumerate(self._latest):
            marked = replace(start, is_baseline=start.id == chosen.id)
            if marked != start:
                self._latest[index] = marked
                self._put(START, marked.id, marked.to_dict(), limit=SUMMARIES)
        if self._alarm_count:
            self._put_alarm()
        self._store_baseline()

    def _store_baseline(self) -> None:
        stored = self._trend.to_dict()
        if stored is not None:
            alarm = {"alarm_count": self._alarm_count, "raised_s": self._raised_s}
            self._put(BASELINE, BASELINE, {**stored, **alarm}, limit=1, is_urgent=True)
            self._copy_curve()

    def _copy_curve(self) -> None:
        """Have the curve of the baseline's typical start stored apart, unless it is."""
        baseline = self._trend.baseline
        if baseline is None or baseline.typical == self._curve_of:
            return
        if self._copying is not None:
            self._copying.cancel()
        work = self._store_curve(baseline.typical)
        self._copying = asyncio.get_running_loop().create_task(work, name="baseline")

    async def _store_curve(self, id_: str) -> None:
        with suppress(StoreError):
            row = await self._here.store.row(self._name, CURVE, id_)
            if row is not None:
                self._put(BASELINE_CURVE, id_, row.data, limit=1, is_urgent=True)
                self._curve_of = id_

    def _restore_month(self, rows: Sequence[HistoryRow]) -> None:
        months = {row.id: row.data for row in rows if row.kind == MONTH}
        if months:
            name = max(months)
            with suppress(DamagedError):
                self._month = Month(name, months[name])

    def _restore_alarm(self, stored: Mapping[str, Any]) -> None:
        """Publish the alarm as an earlier run has left it, if there ever was one."""
        count, raised_s = stored.get("alarm_count"), stored.get("raised_s")
        if isinstance(count, int) and count > 0:
            self._alarm_count = count
            self._raised_s = raised_s if isinstance(raised_s, float) else None
            self._put_alarm()


def _summary(row: HistoryRow) -> StartSummary | None:
    try:
        return StartSummary.from_dict(row.data)
    except DamagedError:
        return None
