"""One starter on a line without polls: identified once, then read and set by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import inf

from gateway.contract import Record, RecordWriter
from gateway.families import Identity, Profile, Question, Read, Variant
from gateway.line import LineClient, Outcome, Priority
from gateway.modbus.pdu import Request
from gateway.starters.bulk_read import BulkReading, read_in_bulk
from gateway.starters.identity import IdentityStatus, identified
from gateway.starters.known_watchdogs import KnownWatchdogs
from gateway.starters.setup import Asked, StarterSetup, ask, merged
from gateway.starters.state import Emitter, Snapshot
from gateway.system.clock import Clock


class OfflineStarter:
    """A `StarterIo` without polls: a command judges only what was just read for a command."""

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
        self._identity = Identity()
        self.identity_standing, self.identity_reason = IdentityStatus.UNKNOWN, "not yet asked"
        self._watchdogs = watchdogs or KnownWatchdogs()
        self.is_answering = False

    @property
    def profile(self) -> Profile:
        """Return the starter's family."""
        return self.setup.profile

    @property
    def identity(self) -> Identity:
        """Return what the device said about itself."""
        return self._identity

    async def identify(self) -> None:
        """Identify the device; CommandError when none answers, or another than the configured one."""
        self._identity = await identified(self.setup, self._put)
        self.is_answering, self.identity_standing = True, IdentityStatus.MATCHING
        self.variant = merged(self.setup.variant, self._identity)

    async def _put(self, question: Question) -> Outcome:
        return await self.ask(question.request)

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
