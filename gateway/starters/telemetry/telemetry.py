"""One starter as it is read: from the line's outcomes to records."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import assert_never

from gateway.families.mapped_registers import MappedBlock
from gateway.families.profile.identify import Identity, why_not
from gateway.families.profile.load import stop_profile
from gateway.families.profile.schema import Profile, Variant
from gateway.families.reading.bulk import rows_of_points
from gateway.families.reading.poll_blocks import Block
from gateway.line.client import LineClient
from gateway.line.rtu.outcome import Answered, Garbled, Outcome, Refused, Silent
from gateway.line.scheduler.requests import Poll
from gateway.modbus.codes import exception_name
from gateway.records import InfoRecord, SequenceNumbers, Severity, Sink
from gateway.starters.identity.query import IdentityQuery, IdentityStatus, standing_of
from gateway.starters.identity.registry import IdentityRegistry
from gateway.starters.setup import StarterSetup, merged
from gateway.starters.telemetry.decoding import AnswerCache, PointSources, Told, unit_of
from gateway.starters.telemetry.degraded import LONGEST_PAUSE_S, PollLoss
from gateway.starters.telemetry.emitter import Emitter, info_of
from gateway.starters.telemetry.first_contact import FirstContact
from gateway.starters.telemetry.known_watchdogs import KnownWatchdogs
from gateway.starters.telemetry.polling import Polling
from gateway.starters.telemetry.reporting import SOONEST_S, Report, TickTimer
from gateway.starters.telemetry.snapshot import Snapshot
from gateway.starters.telemetry.status import SUMMARY_FLAGS, Status
from gateway.starters.telemetry.transitions import UNKNOWN, PublishedFaults
from gateway.starters.telemetry.withheld import Withheld
from gateway.system.clock import Clock

logger = logging.getLogger(__name__)

BUSY_STATES = frozenset({"starting", "stopping", "fault"})  # read faster while in one of these
REFUSED_TOPIC, LOSS_TOPIC, IDENTITY_TOPIC = "refused", "loss", "identity"  # why it cannot be read whole
IDLE_STATES = frozenset({"ready", "not_ready"})  # the motor stands: values read more slowly


class StarterTelemetry:
    """Reads one starter and tells what it reads; everything happens on the app's loop."""

    def __init__(
        self,
        setup: StarterSetup,
        *,
        line: LineClient,
        sink: Sink,
        clock: Clock,
        sequence: SequenceNumbers,
        identities: IdentityRegistry | None = None,
        watchdogs: KnownWatchdogs | None = None,
        told_faults: PublishedFaults | None = None,
    ) -> None:
        profile = setup.profile
        self.setup = setup
        self.line = line
        self.variant = setup.variant
        self.snapshot = Snapshot({name: unit_of(profile, name) for name in profile.points})
        self.publisher = Emitter(setup.name, sink=sink, clock=clock, sequence=sequence)
        self._clock = clock
        self._sources = PointSources(profile)
        self._answers = AnswerCache(profile, self._sources)
        self._polling = Polling(setup, line)
        summary = (name for name in SUMMARY_FLAGS if name in profile.points)
        self._status_codes = frozenset(rows_of_points(profile, summary))
        self._status = Status(profile, self.publisher, told_faults)
        self._report = Report({name: point.deadband for name, point in profile.points.items()})
        self._identification = IdentityQuery(setup, line, self._take_identity)
        self._first_contact = FirstContact(setup, line, self.note_settings)
        self._watchdogs = watchdogs or KnownWatchdogs()
        self._watchdogs.add(setup, line)
        self._identities = identities or IdentityRegistry(sink=sink, clock=clock, sequence=sequence)
        self._identities.when_accepted(setup.name, self._judge_values)
        self._identity = Identity(reason="not yet asked")
        self._withheld = Withheld()
        self._info: InfoRecord | None = None
        self._is_answering = False
        self._was_lost = False
        self._has_ended = False
        self._troubles: dict[str, str] = {}  # by topic: what cannot be read at present
        self._loss = PollLoss()
        self._refused: tuple[str, ...] = ()  # rows that decide something, as told last
        self._on_trouble: Callable[[str], None] = lambda _: None
        self._never_answered = "not yet read"  # why, as last told
        self._state = UNKNOWN
        self._on_identified: list[Callable[[], None]] = []
        self._on_fast_words_lost: Callable[[str], None] = lambda _: None
        self._waker = TickTimer(clock, self._publish)
        self._where = f"line={setup.line} unit={setup.address} starter={setup.name}"

    @property
    def profile(self) -> Profile:
        """Return the starter's family."""
        return self.setup.profile

    @property
    def is_answering(self) -> bool:
        """Return whether the starter is online."""
        return self._is_answering

    @property
    def identity(self) -> Identity:
        """Return what the one who answers said about itself."""
        return self._identity

    @property
    def identity_standing(self) -> IdentityStatus:
        """Return whether the one who answers has proved to be the configured family, as before."""
        standing = standing_of(self.setup, self._identity)
        is_held = standing is IdentityStatus.MATCHING and self._identities.trouble(self.setup.name)
        return IdentityStatus.CHANGED if is_held else standing

    @property
    def identity_reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        return why_not(self.profile, self._identity) or self._identities.trouble(self.setup.name)

    @property
    def contradiction(self) -> str:
        """Return in what the device contradicts the configuration, so that its values mean nothing."""
        if standing_of(self.setup, self._identity) is IdentityStatus.MISMATCHED:
            return why_not(self.profile, self._identity) or ""
        return self._identities.contradiction(self.setup.name)

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

    def when_fast_words_are_lost(self, call: Callable[[str], None]) -> None:
        """Have something done with the reason when the mapped words must not be read any more."""
        self._on_fast_words_lost = call

    def when_troubled(self, call: Callable[[str], None]) -> None:
        """Have something done with each change of what cannot be read of it; empty: nothing."""
        self._on_trouble = call

    def set_trouble(self, topic: str, reason: str) -> None:
        """Publish that a part of the starter cannot be read at present; an empty reason: it can be again."""
        if self._troubles.get(topic, "") == reason:
            return
        was_degraded = bool(self._troubles)
        if reason:
            self._troubles[topic] = reason
        else:
            del self._troubles[topic]
        text = "; ".join(self._troubles.values())
        if self._is_answering:
            self._publish_availability()
        if reason:
            self.publisher.event("degraded", Severity.WARNING, reason, {"topic": topic})
        elif was_degraded and not text:
            self.publisher.event("recovered", Severity.INFO, "the starter can be read whole again")
        self._on_trouble(text)

    def use_fast_words(self, block: MappedBlock | None) -> None:
        """Read the points of this block in one request from now on; None: as they stand in the starter."""
        self._polling.use_fast_words(block)

    def start(self) -> None:
        """Publish what is known so far, usually before the first answer; call once, on the app's loop."""
        self._publish_info()
        if not self.setup.is_enabled:
            self.publisher.availability("disabled", reason="disabled in the configuration")
        elif not self._is_answering:
            self.publisher.availability("offline", reason=self._never_answered)
        self._publish()

    def set_every(self, every_s: float) -> None:
        """Take over another period for the status and the electrical values."""
        self.setup = replace(self.setup, every_s=every_s)
        self._polling.set_every(every_s)
        self._watchdogs.add(self.setup, self.line)

    def retire(self) -> None:
        """Make room for another: ask for nothing and tell nothing any more; `close` must follow."""
        self._on_identified.clear()
        self._identification.cancel()
        self._first_contact.cancel()
        self._waker.cancel()
        self._polling.withdraw()
        self._on_trouble("")
        self._watchdogs.remove(self.setup.name)

    def end(self, reason: str) -> None:
        """Publish that the starter is watched no more: offline, its state stale; take nothing from now on.

        `publish_stale_values` must follow: it can wait until this has been published of all starters.
        """
        self._has_ended = True
        self._identification.cancel()
        self._first_contact.cancel()
        self._waker.cancel()
        if self._is_answering:
            self.publisher.availability("offline", reason=reason)
        self.snapshot.mark_stale()
        self._status.tell(self.snapshot, now_s=self._clock.now_s(), utc_s=self._clock.utc_s())

    def publish_stale_values(self) -> None:
        """Publish all values as stale, at once."""
        now_s = self._clock.now_s()
        self._report.offer(self.snapshot.take_changed(), now_s=now_s)
        for point, reading in self._report.take_due(now_s + SOONEST_S).items():
            self.publisher.value(point, reading)

    async def close(self) -> None:
        """Do nothing more on its own; call once nothing is handed to it any more."""
        await self._identification.close()
        await self._first_contact.close()
        self._waker.cancel()

    def on_poll(self, key: str, outcome: Outcome) -> None:
        """Take over what became of a poll; one that is not ours any more is ignored."""
        block = self._polling.block(key)
        if block is None or self._has_ended:
            return
        if self._is_answering:
            poor = self._loss.note(is_lost=isinstance(outcome, (Silent, Garbled)))
            if poor is not None:
                self.set_trouble(LOSS_TOPIC, poor)
        match outcome:
            case Answered():
                self._take_answer(key, block, outcome)
            case Refused():
                self._come_online()
                self._take_refusal(key, block, outcome)
            case Silent() | Garbled():
                self._publish()  # time has passed: something may be overdue
            case _:
                assert_never(outcome)

    def on_unit(self, *, is_answering: bool, reason: str, frames: tuple[str, ...] = ()) -> None:
        """Take over that the starter began to answer or went silent."""
        if self._has_ended:
            return
        if is_answering:
            self._come_online()
        elif self._is_answering:
            self._go_offline(reason, frames)
        elif not self._was_lost and reason != self._never_answered:
            self._never_answered = reason
            self.publisher.availability("offline", reason=reason)

    def settings_recalled(self) -> Mapping[str, tuple[int, ...]]:
        """Return the settings of its watchdog as an earlier run has left them."""
        return self._watchdogs.rows(self.setup.name)

    def note_settings(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Record settings that were just read: the watchdog's count for the line."""
        self._watchdogs.note(self.setup.name, rows)

    def take_rows(
        self, rows: Mapping[str, tuple[int, ...]], *, at_s: float, told: Told | None = None
    ) -> None:
        """Take over rows that were just read, by a poll or for a command, and publish what they say."""
        self.snapshot.keep_rows(rows, at_s=at_s)
        if self.identity_standing is not IdentityStatus.MISMATCHED:
            self.note_settings(rows)
        if self._polling.is_withdrawn or self._has_ended:
            return  # only a stop asks such a starter, and needs its rows
        self._come_online()
        if self._withheld.is_open:
            self._withheld.put(rows, at_s=at_s)
            self._publish(at_s)
            return
        self._tell_rows(rows, at_s=at_s, told=told)

    def _tell_rows(
        self, rows: Mapping[str, tuple[int, ...]], *, at_s: float, told: Told | None = None
    ) -> None:
        if told is None:
            known = self.snapshot.rows_since(at_s - self._polling.patience_s)
            told = Told(*self._sources.tell(self.variant, rows, known=known))
        if not self._status_codes.isdisjoint(rows):
            self._status.remember(self.snapshot, now_s=at_s)
        self.snapshot.apply(told.points, at_s=at_s, time_s=self._clock.utc_s(at_s))
        self.snapshot.refuse(told.untold)
        self._publish(at_s)

    def _take_answer(self, key: str, block: Block, answer: Answered) -> None:
        said = self._answers.read(key, block, self.variant, answer.value)
        if said is None:
            self._come_online()
            self._lose_fast_words("they are not mapped as they were")
            return
        self._polling.note_answer(key, at_s=answer.at_s)
        if self._refused:
            self._look_at_refusals()
        self.take_rows(said.rows, at_s=answer.at_s, told=said.told)

    def _lose_fast_words(self, reason: str) -> None:
        """Read everything as it stands in the starter again, at once."""
        self._polling.use_fast_words(None)
        self._polling.hasten()
        self._on_fast_words_lost(reason)
        self._publish()

    def _take_refusal(self, key: str, block: Block, refusal: Refused) -> None:
        """Ask in another way, or less often, for what is refused; after a passing refusal nothing changes."""
        why = exception_name(refusal.code)
        if not refusal.is_lasting:
            self._publish()
            return
        unknown = self._polling.note_refusal(key, at_s=refusal.at_s)
        if isinstance(block, MappedBlock) and self._polling.is_refused(key):
            self._lose_fast_words(f"they are refused ({why})")
            return
        self.snapshot.refuse(self._sources.fed_by(unknown))
        if unknown and self._polling.block(key) is None:
            logger.info("%s refuses %s (%s)", self._where, *unknown, why)
        self._look_at_refusals(why)
        self._publish()

    def _look_at_refusals(self, why: str = "") -> None:
        """Publish which of the rows that decide state, fault or watchdog are refused."""
        codes = self._polling.refused_vital()
        if codes or self._troubles.get(REFUSED_TOPIC):
            text = f"{', '.join(codes)} refused ({why}), asked again at least every {LONGEST_PAUSE_S:g} s"
            reason = self._troubles.get(REFUSED_TOPIC) if codes == self._refused else text
            self._refused = codes
            self.set_trouble(REFUSED_TOPIC, (reason or text) if codes else "")

    def _come_online(self) -> None:
        if self._is_answering:
            return
        self._is_answering = True
        self._publish_availability()
        if self._was_lost:
            self.publisher.event("answers_again", Severity.INFO, "the starter answers again")
            self._polling.restore()
        self._first_contact.begin(is_known=self._watchdogs.is_known(self.setup))
        self._identification.begin()

    def _publish_availability(self) -> None:
        text = "; ".join(self._troubles.values())
        self.publisher.availability("degraded" if text else "online", reason=text or None)

    def _go_offline(self, reason: str, frames: tuple[str, ...]) -> None:
        self._is_answering, self._was_lost = False, True
        self._identification.cancel()
        self._first_contact.cancel()
        self._identity = Identity(reason="it has not been asked since it went silent")
        self._identities.forget(self.setup.name)
        self._withheld.withhold()
        self._refused = ()
        self._loss.clear()
        self._troubles.clear()  # everything is asked again once it answers
        self._on_trouble("")
        self.publisher.availability("offline", reason=reason)
        data = {"reason": reason, "frames": list(frames)}
        self.publisher.event("went_silent", Severity.WARNING, f"the starter went silent: {reason}", data)
        self.snapshot.mark_stale()
        self._polling.note_silence()
        self._publish()

    def _take_identity(self, identity: Identity) -> None:
        before = self._identity
        self._identity = identity
        if standing_of(self.setup, identity) is IdentityStatus.MATCHING:
            is_settled = self._identification.is_settled
            self._identities.note(self.setup, identity, is_settled=is_settled)
            if standing_of(self.setup, before) is not IdentityStatus.MATCHING:
                self._polling.restore()  # another device may have refused what this one has
            self._take_variant(merged(self.setup.variant, identity))
            self._publish_info()
            for call in self._on_identified:
                call()
        elif self.identity_reason != why_not(self.profile, before):
            self._tell_held()
        self._judge_values()
        if self._withheld.is_open and self._identification.is_answered:
            for at_s, rows in self._withheld.release():
                self._tell_rows(rows, at_s=at_s)
            self._publish()

    def _why_unknown(self) -> str:
        """Return why nothing is said of a starter that answers; empty when something is."""
        if not self._is_answering:
            return ""
        return "it is being identified" if self._withheld.is_open else self.contradiction

    def _judge_values(self) -> None:
        """Make values bad while the device contradicts the configuration, good again once it does not."""
        reason = self.contradiction
        is_new = self.snapshot.distrust(reason)
        self.set_trouble(IDENTITY_TOPIC, f"values are not usable: {reason}" if reason else "")
        if not is_new:
            return
        if not reason:
            self._polling.hasten()
        self._publish()

    def _take_variant(self, variant: Variant) -> None:
        if variant != self.variant:
            self.variant = variant
            self._polling.replan(variant)
            self._polling.hasten()  # some rows mean something else now

    def _tell_held(self) -> None:
        """Say that commands are held, because someone else answers or because it is not known who does."""
        text = f"commands are held: {self.identity_reason}"
        if self.identity_standing is IdentityStatus.MISMATCHED:
            seen = self._identity
            stop_profile(self.profile, seen)  # loaded now, so that a stop need not wait for it
            data = {"expected": self.profile.family, "seen": seen.family_seen, "model": seen.model}
            self.publisher.event("identity_mismatch", Severity.ERROR, text, data)
        else:
            self.publisher.event("identity_unknown", Severity.WARNING, text)

    def _publish_info(self) -> None:
        info = info_of(self.setup, self.variant, self._identity)
        if info != self._info:
            self._info = info
            self.publisher.sink.put(info)

    def _publish(self, at_s: float | None = None) -> None:
        """Publish what is due now; `at_s` is when the newest reading was taken."""
        now_s = self._clock.now_s()
        overdue = self._polling.take_overdue(now_s)
        if overdue:
            self.snapshot.mark_stale(self._sources.fed_by(overdue))
        was_waiting = self._status.is_waiting
        state = self._status.tell(
            self.snapshot, now_s=now_s, utc_s=self._clock.utc_s(at_s), reason=self._why_unknown()
        )
        if self._status.is_waiting and not was_waiting:
            self._polling.hasten_status()  # what has changed is an event once it is read again
        self._polling.hurry(is_fast=state in BUSY_STATES, is_idle=state in IDLE_STATES)
        if state == "fault" and self._state != state:
            self._polling.hasten()  # the fault's number and the values around it, as soon as the line allows
        self._state = state
        self._report.offer(self.snapshot.take_changed(), now_s=now_s)
        for point, reading in self._report.take_due(now_s).items():
            self.publisher.value(point, reading)
        overdue_s = self._polling.next_overdue_s()
        self._waker.at(min(self._report.next_due_s(), self._status.next_due_s, overdue_s))
