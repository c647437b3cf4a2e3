"""One starter as it is read: from the line's outcomes to records."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import assert_never

from gateway.contract import EventCode, RecordWriter, phrase
from gateway.families import Identity, Profile, Variant, reading
from gateway.line import Answered, Garbled, LineClient, Outcome, Poll, Priority, Refused, Silent
from gateway.modbus.codes import exception_name
from gateway.modbus.pdu import Request
from gateway.starters.identity import Contact, IdentityRegistry, IdentityStatus
from gateway.starters.setup import Asked, StarterSetup, ask, merged
from gateway.starters.telemetry.availability import Availability
from gateway.starters.telemetry.decoding import AnswerCache, DecodedPoints, deadbands_of, sources_of, units_of
from gateway.starters.telemetry.description import info_of
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs, setting_codes
from gateway.starters.telemetry.polling import LONGEST_PAUSE_S, Polling, PollLoss
from gateway.starters.telemetry.readings import Readings
from gateway.starters.telemetry.reporting import (
    REFRESH_S,
    SOONEST_S,
    Emitter,
    LockOf,
    Report,
    TickTimer,
)
from gateway.starters.telemetry.snapshot import Snapshot
from gateway.starters.telemetry.status import Status, status_codes
from gateway.starters.telemetry.transitions import PublishedFaults
from gateway.system.rate_limits import ChangeDetector

logger = logging.getLogger(__name__)

REFUSED_TOPIC, LOSS_TOPIC, IDENTITY_TOPIC = "refused", "loss", "identity"  # why it cannot be read whole


class StarterTelemetry:
    """Reads one starter and publishes what it reads; everything happens on the app's loop."""

    def __init__(
        self,
        setup: StarterSetup,
        *,
        line: LineClient,
        records: RecordWriter,
        identities: IdentityRegistry | None = None,
        watchdogs: KnownWatchdogs | None = None,
        published_faults: PublishedFaults | None = None,
        lock_of: LockOf = lambda _: None,
        refresh_s: float = REFRESH_S,
    ) -> None:
        profile = setup.profile
        self.setup = setup
        self.line = line
        self.variant = setup.variant
        self.snapshot = Snapshot(units_of(profile))
        self.emitter = Emitter(setup.name, records, lock_of=lock_of)
        self._clock = records.clock
        self._sources = sources_of(profile)
        self._answers = AnswerCache(profile, self._sources)
        self._polling = Polling(setup, line)
        self._status_codes = status_codes(profile)
        self._status = Status(profile, self.emitter, published_faults)
        self._report = Report(self.snapshot.readings, deadbands_of(profile), refresh_s=refresh_s)
        self._setting_codes = setting_codes(profile)
        self._watchdogs = watchdogs or KnownWatchdogs()
        self._watchdogs.add(setup, line)
        identities = identities or IdentityRegistry(records)
        identities.when_accepted(setup.name, self._take_acceptance)
        self._contact = Contact(
            setup,
            line,
            registry=identities,
            records=records,
            on_rows=self.note_settings,
            on_judged=self._take_identity,
        )
        self._info = ChangeDetector()  # what was published of it
        self.availability = Availability(self.emitter)
        self._has_ended = False
        self._loss = PollLoss()
        self._refused: tuple[str, ...] = ()  # rows that decide something, as published last
        self._on_identified: list[Callable[[], None]] = []
        self.on_readings: Callable[[Readings], None] = lambda _: None  # of each reply; must not raise
        self._waker = TickTimer(records.clock, self._publish)
        self._where = f"line={setup.line} unit={setup.address} starter={setup.name}"

    @property
    def profile(self) -> Profile:
        """Return the starter's family."""
        return self.setup.profile

    @property
    def is_answering(self) -> bool:
        """Return whether the starter is online."""
        return self.availability.is_online

    @property
    def state(self) -> str:
        """Return the state as of the latest reading; unknown while the starter does not answer."""
        return self._status.state

    @property
    def identity(self) -> Identity:
        """Return what the device said about itself."""
        return self._contact.standing.identity

    @property
    def identity_standing(self) -> IdentityStatus:
        """Return whether the device has proved to be the configured family, as before."""
        return self._contact.standing.status

    @property
    def identity_reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        return self._contact.standing.reason

    @property
    def contradiction(self) -> str:
        """Return in what the device contradicts the configuration, so that its values mean nothing."""
        return self._contact.standing.contradiction

    @property
    def status_period_s(self) -> float:
        """Return how long two readings of the status are apart at most."""
        return self._polling.status_period_s

    def polls(self) -> tuple[Poll, ...]:
        """Return the polls with which the line must begin."""
        return self._watchdogs.polls(self.setup)

    def when_identified(self, call: Callable[[], None]) -> None:
        """Have something done each time the starter has proved to be what is configured."""
        self._on_identified.append(call)

    def set_trouble(self, topic: str, reason: str) -> None:
        """Publish that a part of the starter cannot be read at present; an empty reason: it can be again."""
        self.availability.set_trouble(topic, reason)

    def ask(self, request: Request, *, lane: Priority, until_s: float = math.inf) -> Asked:
        """Send the starter a request, not later than `until_s`."""
        return ask(self.line, self.setup, request, lane=lane, until_s=until_s)

    def start(self) -> None:
        """Publish what is known so far, usually before the first answer; call once, on the app's loop."""
        self._publish_info()
        self.availability.start(is_enabled=self.setup.is_enabled)
        self._publish()

    def set_every(self, every_s: float) -> None:
        """Apply another period for the status and the electrical values."""
        self.setup = replace(self.setup, every_s=every_s)
        self._polling.set_every(every_s)
        self._watchdogs.add(self.setup, self.line)

    def set_refresh(self, refresh_s: float) -> None:
        """Publish unchanged values again after another time, from now on."""
        self._report.set_refresh(refresh_s)
        self._publish()

    def republish_state(self) -> None:
        """Publish the state again, because the starter's lock has changed."""
        if not self._has_ended and self._status.expire():
            self._publish()

    def retire(self) -> None:
        """Make room for another: ask for nothing and publish nothing any more; `close` must follow."""
        self._has_ended = True
        self._on_identified.clear()
        self._contact.cancel()
        self._waker.cancel()
        self._polling.withdraw()
        self.availability.on_trouble("")
        self._watchdogs.remove(self.setup.name)

    def end(self, reason: str) -> None:
        """Publish that the starter is watched no more: offline, its state stale; take nothing from now on.

        `publish_stale_values` must follow: it can wait until this has been published of all starters.
        """
        self._has_ended = True
        self._contact.cancel()
        self._waker.cancel()
        self.availability.end(reason)
        self.snapshot.mark_stale()
        now_s, utc_s = self._clock.now_s(), self._clock.utc_s()
        self.emitter.put(*self._status.look(self.snapshot, now_s=now_s, utc_s=utc_s))

    def publish_stale_values(self) -> None:
        """Publish all values as stale, at once."""
        now_s = self._clock.now_s()
        self._report.note_changed(self.snapshot.take_changed(), now_s=now_s)
        self.emitter.values(self._report.take_due(now_s + SOONEST_S))

    async def close(self) -> None:
        """Do nothing more on its own; call once nothing is handed to it any more."""
        await self._contact.close()
        self._waker.cancel()

    def on_poll(self, key: str, outcome: Outcome) -> None:
        """Record what became of a poll; one that was withdrawn meanwhile is ignored."""
        block = self._polling.block(key)
        if block is None or self._has_ended:
            return
        if self.availability.is_online:
            poor = self._loss.note(is_lost=isinstance(outcome, (Silent, Garbled)))
            if poor is not None:
                self.set_trouble(LOSS_TOPIC, poor)
        match outcome:
            case Answered():
                self._take_answer(key, block, outcome)
            case Refused():
                self._come_online()
                self._take_refusal(key, outcome)
            case Silent() | Garbled():
                self._publish()  # time has passed: something may be overdue
            case _:
                assert_never(outcome)

    def on_unit(self, *, is_answering: bool, reason: str, frames: tuple[str, ...] = ()) -> None:
        """Record that the starter began to answer or went silent."""
        if self._has_ended or not self.setup.is_enabled:  # a stop asks a disabled one, too
            return
        if is_answering and self.is_answering:
            self._contact.renew()  # the port was opened again
        elif is_answering:
            self._come_online()
        elif self.is_answering:
            self._go_offline(reason, frames)
        else:
            self.availability.note_never_answered(reason)

    def settings_recalled(self) -> Mapping[str, tuple[int, ...]]:
        """Return the settings of its watchdog as an earlier run has left them."""
        return self._watchdogs.rows(self.setup.name)

    def note_settings(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Record settings that were just read: the watchdog's count for the line."""
        self._watchdogs.note(self.setup.name, rows)

    def take_rows(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        """Record rows that were just read for a command; it goes on before they are decoded and published."""
        self._record(rows, at_s=at_s)
        asyncio.get_running_loop().call_soon(self._take_decoded, rows, at_s)

    def _record(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        self.snapshot.keep_rows(rows, at_s=at_s)
        is_other = self.identity_standing is IdentityStatus.MISMATCHED
        if not self._setting_codes.isdisjoint(rows) and not is_other:
            self.note_settings(rows)

    def _take_decoded(
        self, rows: Mapping[str, tuple[int, ...]], at_s: float, decoded: DecodedPoints | None = None
    ) -> None:
        """Decode rows that were recorded, unless that is done, and publish what they say."""
        if self._polling.is_withdrawn or self._has_ended:
            return  # only a stop asks such a starter, and needs its rows
        self._come_online()
        time_s = self._clock.utc_s(at_s)
        applied: Collection[str] = ()
        if self._contact.standing.is_readable:
            applied = self._apply(rows, at_s, time_s, decoded)
        self._publish(time_s)
        if applied:
            values = self.snapshot.good_values_of(applied, at_s=at_s)
            self.on_readings(Readings(at_s, time_s, self._status.state, values))

    def _apply(
        self,
        rows: Mapping[str, tuple[int, ...]],
        at_s: float,
        time_s: float,
        decoded: DecodedPoints | None = None,
    ) -> Collection[str]:
        """Record what rows say, read at `at_s` (`time_s` UTC), and return of which points."""
        if decoded is None:
            known = self.snapshot.rows_since(at_s - self._polling.patience_s)
            decoded = self._sources.decode(self.variant, rows, known=known)
        if not self._status_codes.isdisjoint(rows):
            self._status.remember(self.snapshot, now_s=at_s)
        self.snapshot.apply(decoded.points, at_s=at_s, time_s=time_s)
        if decoded.missing:
            self.snapshot.refuse(decoded.missing)
        return decoded.points.keys()

    def _take_answer(self, key: str, block: reading.Block, answer: Answered) -> None:
        said = self._answers.read(key, block, self.variant, answer.value)
        if self._contact.standing.is_readable:  # else its values grow old
            self._polling.note_answer(key, at_s=answer.at_s)
        if self._refused:
            self._look_at_refusals()
        self._record(said.rows, at_s=answer.at_s)
        self._take_decoded(said.rows, answer.at_s, said.decoded)

    def _take_refusal(self, key: str, refusal: Refused) -> None:
        """Ask in another way, or less often, for what is refused; after a passing refusal nothing changes."""
        why = exception_name(refusal.code)
        if not refusal.is_lasting:
            self._publish()
            return
        unknown = self._polling.note_refusal(key, at_s=refusal.at_s)
        self.snapshot.refuse(self._sources.fed_by(unknown))
        if unknown and self._polling.block(key) is None:
            logger.info("%s refuses %s (%s)", self._where, *unknown, why)
        self._look_at_refusals(why)
        self._publish()

    def _look_at_refusals(self, why: str = "") -> None:
        """Publish which of the rows that decide state, fault or watchdog are refused."""
        codes = self._polling.refused_vital()
        before = self.availability.trouble(REFUSED_TOPIC)
        if codes or before:
            reason = before if codes == self._refused else ""
            self._refused = codes
            self.set_trouble(REFUSED_TOPIC, (reason or _refusal(codes, why)) if codes else "")

    def _come_online(self) -> None:
        if self.availability.is_online:
            return
        self.availability.come_online()
        if self.availability.was_lost:
            self._polling.restore()
        self._contact.begin(is_known=self._watchdogs.is_known(self.setup))

    def _go_offline(self, reason: str, frames: tuple[str, ...]) -> None:
        self._contact.note_silence()
        self._refused = ()
        self._loss.clear()
        self.availability.go_offline(reason, frames)
        self.snapshot.mark_stale()
        self._polling.note_silence()
        self._publish()

    def _take_identity(self) -> None:
        """Publish what follows from who answers, and read at once what counts from now on."""
        is_family = self.identity_standing not in (IdentityStatus.UNKNOWN, IdentityStatus.MISMATCHED)
        if is_family:
            self._polling.restore()  # another device may have refused what this one has
            self.line.retry_refused(self.setup.address)
            self._take_variant(merged(self.setup.variant, self.identity))
            self._publish_info()
        self._judge_values()
        self._polling.expedite()
        self._publish()
        for call in self._on_identified if is_family else ():
            call()

    def _take_acceptance(self) -> None:
        self._contact.accept()
        self._judge_values()

    def _why_unknown(self) -> str:
        """Return why nothing is said of a starter; empty when something is, or it was never read."""
        if not self.availability.is_online:
            reason = self.availability.lost_reason
            return phrase(EventCode.WENT_SILENT, "gone", reason=reason) if reason else ""
        standing = self._contact.standing
        return self.snapshot.distrust_reason if standing.is_readable else standing.reason

    def _judge_values(self) -> None:
        """Make values bad while the device contradicts the configuration, good again once it does not."""
        reason = self.contradiction
        is_new = self.snapshot.distrust(reason)
        self.set_trouble(IDENTITY_TOPIC, phrase(EventCode.DEGRADED, "unusable", why=reason) if reason else "")
        if not is_new:
            return
        if not reason:
            self._polling.expedite()
        self._publish()

    def _take_variant(self, variant: Variant) -> None:
        if variant != self.variant:
            self.variant = variant
            self._polling.replan(variant)
            self._polling.expedite()  # some rows mean something else now

    def _publish_info(self) -> None:
        info = info_of(self.setup, self.variant, self.identity)
        if self._info.is_new(info):
            self.emitter.put(info)

    def _publish(self, time_s: float | None = None) -> None:
        """Look at all that is known now, pace the polls by it, and publish what is due after that.

        `time_s` is when the newest reading was taken, UTC. Publishing itself asks nothing of the line.
        """
        now_s = self._clock.now_s()
        overdue = self._polling.take_overdue(now_s)
        if overdue:
            self.snapshot.mark_stale(self._sources.fed_by(overdue))
        was_waiting, before = self._status.is_waiting, self._status.state
        utc_s = self._clock.utc_s() if time_s is None else time_s
        records = self._status.look(self.snapshot, now_s=now_s, utc_s=utc_s, reason=self._why_unknown())
        if self._status.is_waiting and not was_waiting:
            self._polling.expedite_group("status")  # what has changed is an event once it is read again
        self._polling.follow(self._status.state, before=before)
        if records:
            self.emitter.put(*records)
        self._report.note_changed(self.snapshot.take_changed(), now_s=now_s)
        self.emitter.values(self._report.take_due(now_s))
        overdue_s = self._polling.next_overdue_s()
        self._waker.at(min(self._report.next_due_s(), self._status.next_due_s, overdue_s))


def _refusal(codes: Sequence[str], why: str) -> str:
    """Return which rows a starter refuses, and why as far as that is known."""
    named = ", ".join(codes)
    if not why:
        return phrase(EventCode.DEGRADED, "rows_refused", codes=named, seconds=LONGEST_PAUSE_S)
    return phrase(EventCode.DEGRADED, "rows_refused_for", codes=named, why=why, seconds=LONGEST_PAUSE_S)
