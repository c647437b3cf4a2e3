"""Publishes whether an identified starter is ready for remote control, and which watchdog acts when."""

from __future__ import annotations

import asyncio
import itertools
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from gateway.contract import CommandError, EventCode, Severity, phrase
from gateway.errors import PortLostError
from gateway.families import Finding, Weight, diagnosis, reading
from gateway.line import Priority
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from gateway.starters.view import PolledStarter
from gateway.system.rate_limits import ChangeDetector
from gateway.system.supervised import SupervisedTask

logger = logging.getLogger(__name__)

PAUSES_S = (0.0, 5.0, 30.0, 120.0)  # before each attempt to read the settings
WATCHDOG_TOPIC = "watchdog"  # of what keeps a starter from being read whole

_SEVERITIES = {Weight.NOTE: Severity.INFO, Weight.WARNING: Severity.WARNING, Weight.ERROR: Severity.ERROR}


class ReadinessService:
    """Reads one starter's settings on each `begin`; publishes the findings only when they have changed."""

    def __init__(self, starter: PolledStarter) -> None:
        self._starter = starter
        self.on_rows: Callable[[Mapping[str, tuple[int, ...]]], object] = lambda _: None  # gets what was read
        self._task = SupervisedTask(f"readiness {starter.setup.name}")
        self.close = self._task.close
        self._news = ChangeDetector()  # what the last event was made of

    def begin(self) -> None:
        """Look; the starter is identified."""
        self._task.begin(self._look_until_read)

    async def _look_until_read(self) -> None:
        """Look, and again after ever longer pauses until the starter has given the rows of its watchdog."""
        for pause_s in itertools.chain(PAUSES_S, itertools.repeat(PAUSES_S[-1])):
            await asyncio.sleep(pause_s)
            if not self._starter.is_answering:
                return  # its identification begins this anew
            try:
                found = await self._read()
            except (CommandError, PortLostError) as error:
                logger.info("starter=%s readiness is not known: %s", self._starter.setup.name, error)
            else:
                rows = found.rows
                self._starter.note_settings(rows)
                self.on_rows(rows)
                self._publish(rows, await self._starter.gap_s())
                if not self._report_refused_watchdog(found):
                    return

    def _report_refused_watchdog(self, found: BulkReading) -> bool:
        """Return whether a row is refused without which the watchdog is not known, and say so."""
        profile = self._starter.profile
        missing = {
            code: why
            for code, why in found.refused.items()
            if code in diagnosis.watchdog_codes(profile) and profile.parameters[code].is_sure
        }
        rows = "; ".join(
            phrase(EventCode.DEGRADED, "row_refused", code=code, why=why) for code, why in missing.items()
        )
        trouble = phrase(EventCode.DEGRADED, "watchdog_unknown", rows=rows) if rows else ""
        self._starter.set_trouble(WATCHDOG_TOPIC, trouble)
        return bool(missing)

    async def _read(self) -> BulkReading:
        profile = self._starter.profile
        reads = reading.bulk_reads(profile, diagnosis.readiness_codes(profile))
        ask = partial(self._starter.ask, lane=Priority.PATROL)
        return await read_in_bulk(ask, profile, reads, tries=1)

    def _publish(self, rows: dict[str, tuple[int, ...]], gap_s: float | None) -> None:
        starter = self._starter
        findings = diagnosis.readiness(
            starter.profile,
            starter.variant,
            rows,
            gap_s=gap_s,
            watchdog_s=starter.setup.watchdog_s,
            slot_trouble=diagnosis.slot_trouble(
                starter.setup.profile, starter.setup.variant, starter.identity
            ),
        )
        said = (tuple(sorted(rows.items())), tuple(finding.weight for finding in findings))
        if not findings or not self._news.is_new(said):
            return
        problems = "; ".join(each.text for each in findings if each.weight is not Weight.NOTE)
        starter.emitter.event(
            EventCode.READINESS,
            severity=_SEVERITIES[findings[0].weight],  # errors come first
            would_refuse_start=diagnosis.refuses_start(findings),
            findings=[_as_data(finding) for finding in findings],
            watchdogs=[
                {"parameter": each.code, "after_s": each.after_s, "does": each.does}
                for each in diagnosis.watchdogs(starter.profile, starter.variant, rows)
            ],
            problems=problems or phrase(EventCode.READINESS, "ready"),
        )


def _as_data(finding: Finding) -> dict[str, Any]:
    return {"topic": finding.topic.value, "weight": finding.weight.value, "text": finding.text}
