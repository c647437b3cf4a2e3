"""The starters as they answered last, in earlier runs too, and the changes that wait to be accepted."""

from __future__ import annotations

import logging
from collections.abc import Callable

from pydantic import TypeAdapter

from gateway.contract import CommandError, EventCode, RecordWriter, ResultCode
from gateway.families import Identity
from gateway.starters.identity.fingerprint import (
    Fingerprint,
    IdentityMismatch,
    Known,
    completed,
    fingerprint_of,
    mismatch_of,
)
from gateway.starters.setup import StarterSetup
from gateway.store import Documents

logger = logging.getLogger(__name__)

SAVED_TOGETHER_S = 1.0  # what is read within so long is saved at once: at a start that of hundreds
FINGERPRINTS = "fingerprints"  # the document
KNOWN = TypeAdapter(dict[str, Known])  # by starter


class IdentityRegistry:
    """Judges who answers by who was there before; a starter that was never seen is taken as it is.

    All calls on the app's loop.
    """

    def __init__(self, records: RecordWriter, documents: Documents | None = None) -> None:
        self._publish = records.event
        self._known: dict[str, Known] = {}
        self._waiting: dict[str, IdentityMismatch] = {}  # to be accepted
        self._on_accepted: dict[str, Callable[[], None]] = {}
        self._document = (documents or Documents()).open(
            FINGERPRINTS, KNOWN, lambda: self._known, delay_s=SAVED_TOGETHER_S
        )
        self._known |= self._document.loaded or {}

    def when_accepted(self, starter: str, call: Callable[[], None]) -> None:
        """Have something done each time the device of this starter is accepted."""
        self._on_accepted[starter] = call

    def judge(self, setup: StarterSetup, identity: Identity) -> IdentityMismatch | None:
        """Return in what a device of the configured family differs from the known one.

        One that differs in nothing is the known one from now on.
        """
        name, seen = setup.name, fingerprint_of(identity)
        known = self._known.get(name)
        mismatch = mismatch_of(known, seen, setup.variant.model)
        if mismatch is None:
            self._waiting.pop(name, None)
            self._keep(name, known, seen)
        else:
            self._waiting[name] = mismatch
        return mismatch

    def forget(self, starter: str) -> None:
        """Record that the device is silent: the one that answers next is judged again."""
        self._waiting.pop(starter, None)

    def waiting(self, starter: str) -> IdentityMismatch:
        """Return which change waits to be accepted; CommandError when none does."""
        if starter not in self._waiting:
            raise CommandError(ResultCode.NOTHING_TO_ACCEPT)
        return self._waiting[starter]

    def accept(self, starter: str) -> IdentityMismatch:
        """Accept the device that answers as the right one; CommandError when no change waits for that."""
        mismatch = self.waiting(starter)
        self.forget(starter)
        self._known[starter] = Known(mismatch.seen, mismatch.configured)
        self._document.touch()
        self._publish(
            starter,
            EventCode.IDENTITY_ACCEPTED,
            known=mismatch.known.as_data(),
            seen=mismatch.seen.as_data(),
            configured_model=mismatch.configured,
        )
        self._on_accepted.get(starter, lambda: None)()
        return mismatch

    def store(self) -> None:
        """Store what is known now, in the background."""
        self._document.touch()

    async def saved(self) -> bool:
        """Return whether what is known now is on disk."""
        return await self._document.saved()

    def _keep(self, name: str, known: Known | None, seen: Fingerprint) -> None:
        now = Known(seen) if known is None else Known(completed(seen, known.fingerprint), known.despite_model)
        if known is None:
            said = ", ".join(f"{field} {value}" for field, value in seen.as_data().items() if value)
            logger.info("%s seen for the first time: %s", name, said)
        if now != known:
            self._known[name] = now
            self._document.touch()


def mismatch_in(known: Known | None, setup: StarterSetup, identity: Identity) -> IdentityMismatch | None:
    """Return in what a device differs from the one that is known; None when in nothing."""
    return mismatch_of(known, fingerprint_of(identity), setup.variant.model)
