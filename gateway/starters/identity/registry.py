"""The starters as they answered last, in earlier runs too."""

from __future__ import annotations

import logging
from dataclasses import replace

from pydantic import TypeAdapter

from gateway.contract import EventCode, RecordWriter
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

    def __init__(self, records: RecordWriter, documents: Documents) -> None:
        self._publish = records.event
        self._document = documents.open(FINGERPRINTS, KNOWN, lambda: self._known, delay_s=SAVED_TOGETHER_S)
        self._known = self._document.loaded or {}

    def judge(self, setup: StarterSetup, identity: Identity) -> IdentityMismatch | None:
        """Return in what a device of the configured family differs from the known one.

        One that differs in nothing is the known one from now on.
        """
        mismatch = mismatch_in(self._known.get(setup.name), setup, identity)
        if mismatch is None:
            self._keep(setup.name, fingerprint_of(identity))
        return mismatch

    def accept(self, starter: str, mismatch: IdentityMismatch) -> None:
        """Let the device that differs be the known one, also where it contradicts the configured model."""
        self._known[starter] = Known(mismatch.seen, mismatch.configured)
        self._document.touch()
        self._publish(
            starter,
            EventCode.IDENTITY_ACCEPTED,
            known=mismatch.known.as_data(),
            seen=mismatch.seen.as_data(),
            configured_model=mismatch.configured,
        )

    async def saved(self) -> bool:
        """Return whether what is known now is on disk."""
        return await self._document.saved()

    def _keep(self, name: str, seen: Fingerprint) -> None:
        if name not in self._known:
            said = ", ".join(f"{field} {value}" for field, value in seen.as_data().items() if value)
            logger.info("%s seen for the first time: %s", name, said)
        known = self._known.get(name, Known())
        now = replace(known, fingerprint=completed(seen, known.fingerprint))
        if now != known:
            self._known[name] = now
            self._document.touch()


def mismatch_in(known: Known | None, setup: StarterSetup, identity: Identity) -> IdentityMismatch | None:
    """Return in what a device differs from the one that is known; None when in nothing."""
    return mismatch_of(known or Known(), fingerprint_of(identity), setup.variant.model)
