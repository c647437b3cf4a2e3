"""The fingerprints of all starters as last known, and the starters that must be accepted before a command."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gateway.errors import CommandError, DamagedError
from gateway.families.devices.device import Identity
from gateway.records import EventRecord, SequenceNumbers, Severity, Sink
from gateway.starters.identity.fingerprint import (
    NOTHING,
    Fingerprint,
    Known,
    completed,
    contradicts,
    differences,
    fingerprint_of,
    known_from,
)
from gateway.starters.setup import StarterSetup
from gateway.storage.json_file import JsonStore, NoStore, Saver
from gateway.system.clock import Clock

logger = logging.getLogger(__name__)

KEPT_WITHIN_S = 2.0
IDENTITIES_FILE = "identities.json"  # in state_dir
CHANGED_EVENT = "identity_changed"


@dataclass(frozen=True, slots=True)
class IdentityMismatch:
    """Who answers instead of the one that is known."""

    known: Fingerprint
    seen: Fingerprint
    configured: str | None  # a model that it contradicts
    text: str
    contradiction: str = ""  # of the configuration, not accepted yet: values would be of the wrong model


class IdentityRegistry:
    """Judges who answers by who was there before; the file is read when this is made.

    A starter that was never seen is taken as it is. All calls on the app's loop.
    """

    def __init__(
        self, *, sink: Sink, clock: Clock, sequence: SequenceNumbers, memory: JsonStore | None = None
    ) -> None:
        self._sink = sink
        self._clock = clock
        self._sequence = sequence
        self._known: dict[str, Known] = {}
        self._strangers: dict[str, IdentityMismatch] = {}
        self._told: dict[str, IdentityMismatch] = {}
        self._on_accepted: dict[str, Callable[[], None]] = {}
        self._saver = Saver(memory or NoStore(), self._document, on_trouble=self._tell_trouble)
        self._restore(memory or NoStore())

    def when_accepted(self, starter: str, call: Callable[[], None]) -> None:
        """Have something done each time the device of this starter is accepted."""
        self._on_accepted[starter] = call

    def note(self, setup: StarterSetup, identity: Identity, *, is_settled: bool) -> None:
        """Take over who answers; unsettled, a question is still open, and nothing is told or kept yet."""
        name, seen = setup.name, fingerprint_of(identity)
        known = self._known.get(name)
        stranger = _stranger(known, seen, setup.variant.model)
        if stranger is None:
            self._strangers.pop(name, None)
            self._told.pop(name, None)
            if is_settled:
                self._keep(name, known, seen)
            return
        self._strangers[name] = stranger
        if is_settled and self._told.get(name) != stranger:
            self._told[name] = stranger
            self._tell(name, CHANGED_EVENT, Severity.ERROR, stranger.text, _as_data(stranger))

    def forget(self, starter: str) -> None:
        """Take over that nobody answers any more: whoever comes next is judged anew."""
        self._strangers.pop(starter, None)
        self._told.pop(starter, None)

    def trouble(self, starter: str) -> str:
        """Return why commands to a starter are held; empty when they are not."""
        stranger = self._strangers.get(starter)
        return "" if stranger is None else stranger.text

    def contradiction(self, starter: str) -> str:
        """Return in what the device contradicts the configuration and was not accepted; empty: in nothing."""
        stranger = self._strangers.get(starter)
        return "" if stranger is None else stranger.contradiction

    def waiting(self, starter: str) -> IdentityMismatch:
        """Return who waits to be accepted; CommandError when nobody does."""
        stranger = self._told.get(starter)
        if stranger is None or stranger != self._strangers.get(starter):
            raise CommandError("nothing_to_accept", "no change of the starter's identity waits for that")
        return stranger

    def accept(self, starter: str) -> IdentityMismatch:
        """Take the one who answers for right from now on; CommandError when nobody waits for that."""
        stranger = self.waiting(starter)
        self.forget(starter)
        self._known[starter] = Known(stranger.seen, stranger.configured)
        self._saver.touch()
        text = "the present identity was accepted: commands are carried out again"
        self._tell(starter, "identity_accepted", Severity.INFO, text, _as_data(stranger))
        self._on_accepted.get(starter, lambda: None)()
        return stranger

    def keep(self) -> None:
        """Have what is known now outlive the gateway."""
        self._saver.touch()

    async def kept(self) -> bool:
        """Return whether what is known now outlives the gateway."""
        return await self._saver.saved(within_s=KEPT_WITHIN_S)

    async def close(self) -> None:
        """Keep what is left to be kept, and then do nothing more."""
        await self._saver.close(within_s=KEPT_WITHIN_S)

    def _keep(self, name: str, known: Known | None, seen: Fingerprint) -> None:
        now = Known(seen) if known is None else Known(completed(seen, known.fingerprint), known.despite_model)
        if known is None:
            said = ", ".join(f"{field} {value}" for field, value in seen.as_data().items() if value)
            logger.info("%s seen for the first time: %s", name, said)
        if now != known:
            self._known[name] = now
            self._saver.touch()

    def _document(self) -> dict[str, Any]:
        return {"starters": {name: known.as_data() for name, known in self._known.items()}}

    def _restore(self, memory: JsonStore) -> None:
        try:
            starters = _starters_in(memory.load() or {})
        except DamagedError as error:
            memory.set_aside()
            self._tell("", "memory_damaged", Severity.ERROR, f"{error}: every starter counts as new", {})
            return
        for name, kept in starters.items():
            known = known_from(kept)
            if known is not None:
                self._known[name] = known

    def _tell_trouble(self, trouble: str) -> None:
        if trouble:
            text = f"the starters' fingerprints cannot be kept: {trouble}"
            self._tell("", "identities_away", Severity.WARNING, text, {})
        else:
            text = "the starters' fingerprints are kept again"
            self._tell("", "identities_back", Severity.INFO, text, {})

    def _tell(self, starter: str, code: str, severity: Severity, text: str, data: Mapping[str, Any]) -> None:
        utc_s, seq = self._clock.utc_s(), self._sequence.take()
        self._sink.put(EventRecord(starter, code, severity, text, utc_s, seq, data))


def stranger_in(
    document: Mapping[str, Any], setup: StarterSetup, identity: Identity
) -> IdentityMismatch | None:
    """Return who answers instead of the one that a kept document knows; DamagedError when it is none."""
    known = known_from(_starters_in(document).get(setup.name))
    return _stranger(known, fingerprint_of(identity), setup.variant.model)


def _starters_in(document: Mapping[str, Any]) -> Mapping[str, Any]:
    starters = document.get("starters", {})
    if not isinstance(starters, Mapping):
        raise DamagedError("the fingerprints of the starters are damaged")
    return starters


def _stranger(known: Known | None, seen: Fingerprint, model: str | None) -> IdentityMismatch | None:
    """Return what speaks against the one who answers; None when nothing does."""
    before = NOTHING if known is None else known.fingerprint
    differing = differences(before, seen)
    accepted_model = None if known is None else known.despite_model
    configured = model if contradicts(model, seen) else None
    reasons = [f"{name} was {getattr(before, name)}, is {getattr(seen, name)}" for name in differing]
    contradiction = ""
    if configured is not None and configured != accepted_model:
        contradiction = f"the configuration says {configured}, it says {_spoken(seen)}"
        reasons.append(contradiction)
    if not reasons:
        return None
    text = f"another starter than before? {'; '.join(reasons)} (look, then send accept)"
    return IdentityMismatch(before, seen, configured, text, contradiction)


def _spoken(seen: Fingerprint) -> str:
    return ", ".join(filter(None, (seen.model, seen.rated_current)))


def _as_data(stranger: IdentityMismatch) -> dict[str, Any]:
    return {
        "known": stranger.known.as_data(),
        "seen": stranger.seen.as_data(),
        "configured_model": stranger.configured,
    }
