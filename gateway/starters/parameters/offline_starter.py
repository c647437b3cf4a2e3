"""One starter on a line without polls: identified once, then read and set by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from math import inf

from gateway.contract import CommandError, Record, RecordWriter, ResultCode
from gateway.families import Identity, Profile, Question, Read, Variant, diagnosis
from gateway.line import Answered, LineClient, Outcome, Priority, Refused
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from gateway.starters.identity.first_contact import IdentityStatus, not_matching, standing_of
from gateway.starters.identity.recognition import Recognition
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.setup import Asked, StarterSetup, ask, merged
from gateway.starters.state import Emitter, Snapshot
from gateway.system.clock import Clock


class OfflineStarter:
    """A `StarterControlView` without polls, so that a command judges only what it has just read itself."""

    contradiction = ""  # a device that is not the configured one is given up when it is identified

    def __init__(
        self,
        setup: StarterSetup,
        *,
        line: LineClient,
        clock: Clock,
        watchdogs: KnownWatchdogs | None = None,
    ) -> None:
        self.setup = setup
        self.line = line
        self.variant: Variant = setup.variant
        self.snapshot = Snapshot({})
        self.emitter = Emitter(setup.name, RecordWriter(_NoRecords(), clock))
        self.identity = Identity(reason="not yet asked")
        self._watchdogs = watchdogs or KnownWatchdogs()
        self._recognition = Recognition(setup.profile)
        self.is_answering = False
        self.status_period_s = 0.0  # no poll vouches for anything

    @property
    def profile(self) -> Profile:
        """Return the starter's family."""
        return self.setup.profile

    @property
    def identity_standing(self) -> IdentityStatus:
        """Return whether the device has proved to be the configured family."""
        return standing_of(self.setup, self.identity)

    @property
    def identity_reason(self) -> str:
        """Return in words why the identity is not matching; empty when it is."""
        return diagnosis.why_not(self.profile, self.identity) or ""

    async def identify(self) -> None:
        """Identify the device; CommandError when none answers, or another than the configured one."""
        outcomes = {q: await self._put(q) for q in diagnosis.identify_requests(self.profile)}
        self.is_answering = any(isinstance(outcome, (Answered, Refused)) for outcome in outcomes.values())
        if not self.is_answering:
            name, address = self.setup.name, self.setup.address
            raise CommandError(ResultCode.OFFLINE, "address", starter=name, address=address)
        self._recognition.note(outcomes)
        answers = {q.tag: out.value if isinstance(out, Answered) else None for q, out in outcomes.items()}
        self.identity = diagnosis.identify(self.profile, answers)
        standing = self.identity_standing
        if standing is not IdentityStatus.MATCHING:
            raise not_matching(standing, self.identity_reason)
        self.variant = merged(self.setup.variant, self.identity)

    async def prove(self, *, lane: Priority) -> None:
        """Raise CommandError unless the device that answers now is the one that was identified."""
        if await self._recognition.is_same(partial(self._put, lane=lane)) is not True:
            await self.identify()

    async def _put(self, question: Question, *, lane: Priority = Priority.READ_BACK) -> Outcome:
        return await self.ask(question.request, lane=lane)

    def ask(self, request: Request, *, lane: Priority = Priority.READ_BACK, until_s: float = inf) -> Asked:
        """Send a request."""
        return ask(self.line, self.setup, request, lane=lane, until_s=until_s)

    async def read(
        self, reads: Iterable[Read], *, on_read: Callable[[Read], None] | None = None
    ) -> BulkReading:
        """Carry out many reads; CommandError and PortLostError as `read_in_bulk`."""
        return await read_in_bulk(self.ask, self.profile, reads, on_read=on_read)

    def take_rows(self, rows: Mapping[str, tuple[int, ...]], *, at_s: float) -> None:
        """Keep rows that were just read for a command."""
        self.snapshot.keep_rows(rows, at_s=at_s)
        self.note_settings(rows)

    def republish_state(self) -> None:
        """Do nothing: no state is published."""

    def set_trouble(self, topic: str, reason: str) -> None:
        """Ignore what cannot be read: the command itself says so."""

    def note_settings(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Record settings that were just read."""
        self._watchdogs.note(self.setup.name, rows)


class _NoRecords:
    """Discards every record: the command says itself what happens."""

    def put(self, record: Record) -> None:
        """Leave a record."""
