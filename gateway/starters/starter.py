"""One starter as it is read: from the line's outcomes to its state, and to what is published of it.

What is decided is decided by pure functions (`state`); here is the loop around them.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import assert_never

from gateway.contract import CommandError, EventCode, RecordWriter, phrase
from gateway.errors import PortLostError
from gateway.families import Identity, Profile, Variant, diagnosis, reading
from gateway.line import Answered, Garbled, LineClient, Outcome, Priority, Refused, Silent
from gateway.modbus import Request, exception_name
from gateway.starters.bulk_read import BulkReading, read_in_bulk, short_reads
from gateway.starters.description import info_of
from gateway.starters.identity import Contact, IdentityRegistry, IdentityStatus
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.polling import Polling
from gateway.starters.setup import Asked, StarterSetup, ask, merged
from gateway.starters.state import (
    NO_POINTS,
    SOONEST_S,
    Availability,
    Happenings,
    LockOf,
    Moment,
    NewReadings,
    Points,
    PublishedFaults,
    Readings,
    ReplyReader,
    Rows,
    Said,
    Snapshot,
    StatePublisher,
    advance,
    bad,
    good_values,
    sources_of,
    stale,
    unread,
)

logger = logging.getLogger(__name__)

REFUSED_TOPIC, IDENTITY_TOPIC = "refused", "identity"  # why it cannot be read whole


class StarterService:
    """What goes along with one starter, and reads in the background what no poll reads; on the app's loop."""

    def begin(self) -> None:
        """Begin, or begin again: the starter has proved to be what is configured."""

    def note_written(self, request: Request) -> None:
        """Record that a write may have reached the starter."""

    def note_change(self, before: str, after: str, happenings: Happenings) -> None:
        """Record the state that was and the state that is, and what has happened."""

    async def close(self) -> None:
        """Do nothing more."""


class StarterTelemetry:
    """Reads one starter and publishes what it reads; everything happens on the app's loop."""

    def __init__(
        self,
        setup: StarterSetup,
        *,
        line: LineClient,
        records: RecordWriter,
        identities: IdentityRegistry,
        watchdogs: KnownWatchdogs,
        published_faults: PublishedFaults,
        lock_of: LockOf,
        refresh_s: float,
    ) -> None:
        self.setup = setup
        self.line = line
        self.variant = setup.variant
        self.snapshot = Snapshot(unread(setup.profile, published_faults.of(setup.name)))
        self._publisher = StatePublisher(
            setup.name,
            records,
            setup.profile,
            faults=published_faults,
            lock_of=lock_of,
            refresh_s=refresh_s,
            look=self._look,
        )
        self.event = partial(records.event, setup.name)
        self.availability = Availability(setup.name, records)
        self.on_readings: Callable[[Readings], None] = lambda _: None  # of each reply; must not raise
        self.services: list[StarterService] = []
        self._clock = records.clock
        self._replies = ReplyReader(setup.profile, self._known_rows)
        self._polling = Polling(setup, line)
        self.watchdogs = watchdogs
        self.watchdogs.add(setup, line)
        self.contact = Contact(
            setup,
            line,
            registry=identities,
            records=records,
            on_rows=partial(self.watchdogs.note, setup.name),
            on_judged=self._take_identity,
        )

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
        return self.snapshot.state.status.word

    @property
    def is_identified(self) -> bool:
        """Return whether the configured device answers, as known before."""
        return self.is_answering and self.identity_standing is IdentityStatus.MATCHING

    def ask(self, request: Request, *, lane: Priority, until_s: float = math.inf) -> Asked:
        """Send the starter a request, not later than `until_s`."""
        asked = ask(self.line, self.setup, request, lane=lane, until_s=until_s)
        if request.is_write:
            asked.add_done_callback(lambda _: self._note_written(request))
        return asked

    async def read_rows(self, codes: Iterable[str]) -> BulkReading | None:
        """Read rows for which everything else goes first; return None when that fails: polls say why."""
        reads = short_reads(self.profile, tuple(codes))
        try:
            found = await read_in_bulk(self._ask_last, self.profile, reads, tries=1)
        except (CommandError, PortLostError) as error:
            logger.debug("starter=%s not read in the background: %s", self.setup.name, error)
            return None
        self.watchdogs.note(self.setup.name, found.rows)
        return found

    def _ask_last(self, request: Request) -> Asked:
        return self.ask(request, lane=Priority.PATROL)

    def _note_written(self, request: Request) -> None:
        for service in self.services:
            service.note_written(request)

    def start(self) -> None:
        """Publish what is known so far, usually before the first answer; call once, on the app's loop."""
        self._publisher.info(info_of(self.setup, self.variant, self.identity))
        self.availability.start(is_enabled=self.setup.is_enabled)
        self._look()

    def set_every(self, every_s: float) -> None:
        """Apply another period for the status and the electrical values."""
        self.setup = replace(self.setup, every_s=every_s)
        self._polling.replan(self.setup, self.variant)
        self.watchdogs.add(self.setup, self.line)

    def set_refresh(self, refresh_s: float) -> None:
        """Publish unchanged values again after another time, from now on."""
        self._publisher.set_refresh(refresh_s)
        self._look()

    def republish_state(self) -> None:
        """Publish the state again, because the starter's lock has changed."""
        if not self._publisher.is_closed and self._publisher.expire():
            self._look()

    def retire(self) -> None:
        """Make room for another: ask for nothing and publish nothing any more; `close` must follow."""
        self._publisher.close()
        self.contact.cancel()
        self._polling.withdraw()
        self.availability.on_trouble("")
        self.watchdogs.remove(self.setup.name)

    def end(self, reason: str) -> None:
        """Publish that the starter is no longer watched: offline, all stale; take nothing from now on."""
        self.contact.cancel()
        self.availability.end(reason)
        self._look(doubts=stale(self.snapshot.readings, self.snapshot.readings))
        self._publisher.publish_values(self.snapshot.state, now_s=self._clock.now_s() + SOONEST_S)
        self._publisher.close()

    async def close(self) -> None:
        """Do nothing more on its own; call once nothing is handed to it any more."""
        await self.contact.close()
        for service in self.services:
            await service.close()
        self._publisher.close()

    # What comes from the line

    def on_poll(self, key: str, outcome: Outcome) -> None:
        """Record the outcome of a poll; one that was withdrawn meanwhile is ignored."""
        block = self._polling.block(key)
        if block is None or self._publisher.is_closed:
            return
        match outcome:
            case Answered():
                self._take_answer(key, block, outcome)
            case Refused():
                self._come_online()
                self._take_refusal(key, outcome)
            case Silent() | Garbled():
                self._look()  # time has passed: something may be overdue
            case _:
                assert_never(outcome)

    def on_unit(self, *, is_answering: bool, reason: str, frames: tuple[str, ...] = ()) -> None:
        """Record that the starter began to answer or went silent."""
        if self._publisher.is_closed or not self.setup.is_enabled:  # a stop asks a disabled one, too
            return
        if is_answering and self.is_answering:
            self.snapshot.outdate_rows()
            self.contact.renew()  # the port was opened again
        elif is_answering:
            self._come_online()
        elif self.is_answering:
            self._go_offline(reason, frames)
        else:
            self.availability.note_never_answered(reason)

    def take_rows(self, rows: Rows, *, at_s: float) -> None:
        """Record rows that were just read for a command; it goes on before they are decoded and published."""
        self._keep_rows(rows, at_s=at_s)
        asyncio.get_running_loop().call_soon(self._take_late, rows, at_s)

    def _take_late(self, rows: Rows, at_s: float) -> None:
        """Take what rows say that were recorded for a command."""
        if self._polling.is_withdrawn or self._publisher.is_closed:
            return  # only a stop asks such a starter, and needs its rows
        known = self._known_rows(at_s)
        self._take(sources_of(self.profile).decode(self.variant, rows, known=known), at_s)

    def _keep_rows(self, rows: Rows, *, at_s: float) -> None:
        self.snapshot.keep_rows(rows, at_s=at_s)
        if rows.keys().isdisjoint(diagnosis.watchdog_codes(self.setup.profile)):
            return  # as nearly always
        if self.identity_standing is not IdentityStatus.MISMATCHED:
            self.watchdogs.note(self.setup.name, rows)

    def _known_rows(self, at_s: float) -> Rows:
        """Return the rows that were current then."""
        return self.snapshot.rows_since(at_s - self._polling.patience_s)

    def _take_answer(self, key: str, block: reading.Block, answer: Answered) -> None:
        at_s = answer.at_s
        said = self._replies.read(key, block, self.variant, answer.value, at_s=at_s)
        if self.contact.standing.is_readable:  # else its values grow old
            self._polling.note_answer(key, at_s=at_s)
        if REFUSED_TOPIC in self.availability.troubles:
            self.availability.set_trouble(REFUSED_TOPIC, self._polling.refusal())
        self._keep_rows(said.rows, at_s=at_s)
        self._take(said, at_s)

    def _take_refusal(self, key: str, refusal: Refused) -> None:
        """Ask in another way, or less often, for what is refused; after a passing refusal nothing changes."""
        if not refusal.is_lasting:
            self._look()
            return
        unknown = self._polling.note_refusal(key, refusal.code, at_s=refusal.at_s)
        if unknown and self._polling.block(key) is None:
            where = f"line={self.setup.line} unit={self.setup.address} starter={self.setup.name}"
            logger.info("%s refuses %s (%s)", where, *unknown, exception_name(refusal.code))
        self.availability.set_trouble(REFUSED_TOPIC, self._polling.refusal())
        self._look(doubts=bad(self.snapshot.readings, sources_of(self.profile).fed_by(unknown)))

    def _come_online(self) -> None:
        if self.availability.is_online:
            return
        self.availability.come_online()
        if self.availability.was_lost:
            self._polling.restore()
        self.contact.begin(is_known=self.watchdogs.is_known(self.setup))

    def _go_offline(self, reason: str, frames: tuple[str, ...]) -> None:
        self.snapshot.outdate_rows()
        self.contact.note_silence()
        self.availability.go_offline(reason, frames)
        self._polling.note_silence()
        self._look(doubts=stale(self.snapshot.readings, self.snapshot.readings))

    # The state and what follows from it

    def _take(self, said: Said, at_s: float) -> None:
        """Take what a reply says into the state, publish it, and hand its good values to the recorders."""
        if not self.availability.is_online:
            self._come_online()
        standing, read = self.contact.standing, Moment(at_s, self._clock.utc_s(at_s))
        if not standing.is_readable:
            self._look(read=read)
            return
        state, doubts = self.snapshot.state, NO_POINTS
        points = said.points if at_s >= state.newest_s else state.fresh(said.points, at_s)
        if said.missing:
            doubts = bad(self.snapshot.readings, said.missing, standing.contradiction)
        if standing.contradiction:
            points = bad(points, points, standing.contradiction)
        self._look(points, read, doubts=doubts)
        word = self.snapshot.state.status.word
        self.on_readings(Readings(at_s, read.time_s, word, good_values(points)))

    def _look(
        self, points: Points = NO_POINTS, read: Moment | None = None, *, doubts: Points = NO_POINTS
    ) -> None:
        """Look at all that is known now, with what a reply says, and publish what is due.

        `read` is when the newest reading was taken. Publishing itself asks nothing of the line.
        """
        now_s, before = self._clock.now_s(), self.snapshot.state
        if now_s >= self._polling.next_overdue_s:
            overdue = self._polling.take_overdue(now_s)
            doubts = {**stale(before.points, sources_of(self.profile).fed_by(overdue)), **doubts}
        news = NewReadings(now_s, read or Moment(now_s, self._clock.utc_s()), points, doubts)
        state, happenings = advance(before, news, self.setup.profile)
        self.snapshot.state = state
        if state.settled.waiting and not before.settled.waiting:
            self._polling.expedite("status")  # it is an event once it is read again
        is_other = state.status is not before.status
        if is_other:
            self._polling.follow(state.status.word)
        reason, look_s = self._why_unknown(), self._polling.next_overdue_s
        self._publisher.publish(state, happenings, now_s=now_s, reason=reason, look_s=look_s)
        for service in self.services if is_other or happenings else ():
            service.note_change(before.status.word, state.status.word, happenings)

    # Who answers: what the identity's machine is asked, and what follows from its answers

    @property
    def identity(self) -> Identity:
        """Return what the device said about itself."""
        return self.contact.standing.identity

    @property
    def identity_standing(self) -> IdentityStatus:
        """Return whether the device has proved to be the configured family, as before."""
        return self.contact.standing.status

    @property
    def identity_reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        return self.contact.standing.reason

    @property
    def contradiction(self) -> str:
        """Return in what the device contradicts the configuration, so that its values mean nothing."""
        return self.contact.standing.contradiction

    def _take_identity(self) -> None:
        """Publish what follows from who answers, and read at once what counts from now on."""
        is_family = self.identity_standing not in (IdentityStatus.UNKNOWN, IdentityStatus.MISMATCHED)
        if is_family:
            self._polling.restore()  # another device may have refused what this one has
            self.line.retry_refused(self.setup.address)
            self._take_variant(merged(self.setup.variant, self.identity))
            self._publisher.info(info_of(self.setup, self.variant, self.identity))
        reason = self.contradiction
        trouble = phrase(EventCode.DEGRADED, "unusable", why=reason) if reason else ""
        self.availability.set_trouble(IDENTITY_TOPIC, trouble)
        self._polling.expedite()
        self._look(doubts=bad(self.snapshot.readings, self.snapshot.readings, reason) if reason else {})
        for service in self.services if is_family else ():
            service.begin()

    def _why_unknown(self) -> str:
        """Return why nothing is said of a starter; empty when something is, or it was never read."""
        if not self.availability.is_online:
            reason, was_lost = self.availability.reason, self.availability.was_lost
            return phrase(EventCode.WENT_SILENT, "gone", reason=reason) if was_lost else ""
        standing = self.contact.standing
        return standing.contradiction if standing.is_readable else standing.reason

    def _take_variant(self, variant: Variant) -> None:
        if variant != self.variant:
            self.variant = variant
            self._polling.replan(self.setup, variant)
            self._polling.expedite()  # some rows mean something else now
