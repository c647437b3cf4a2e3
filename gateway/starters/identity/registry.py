"""Who each starter was when it answered last, and the starters that must be accepted before a command."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

from pydantic import TypeAdapter

from gateway.contract import (
    CommandError,
    Event,
    EventCode,
    RecordWriter,
    ResultCode,
    event_of,
    phrase,
)
from gateway.families import Identity, decode
from gateway.starters.setup import StarterSetup
from gateway.store import Documents

logger = logging.getLogger(__name__)

SAVED_TOGETHER_S = 1.0  # what is read within so long is saved at once: at a start that of hundreds
FINGERPRINTS = "fingerprints"  # the document


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """What a starter said about itself, the surest first; None is not known."""

    serial: str | None = None
    firmware: str | None = None
    family: str | None = None
    model: str | None = None
    rated_current: str | None = None  # "85 A", or the range of an SSW900's size

    def as_data(self) -> dict[str, str | None]:
        """Return it by field, for events, results and the file."""
        return {name: getattr(self, name) for name in FIELDS}


FIELDS = tuple(field.name for field in fields(Fingerprint))

NOTHING = Fingerprint()


@dataclass(frozen=True, slots=True)
class Known:
    """The last fingerprint that was taken for right, and a configured model that it may contradict."""

    fingerprint: Fingerprint
    despite_model: str | None = None  # what stood in the configuration when an operator accepted it


KNOWN = TypeAdapter(dict[str, Known])  # by starter


def fingerprint_of(identity: Identity) -> Fingerprint:
    """Return the fingerprint of a starter that was identified."""
    current_a = identity.rated_current_a
    return Fingerprint(
        family=identity.family_seen,
        model=identity.model,
        rated_current=f"{current_a:g} A" if current_a else identity.rating,
        firmware=identity.firmware,
        serial=identity.serial,
    )


def differences(known: Fingerprint, seen: Fingerprint) -> tuple[str, ...]:
    """Return the fields that say something else now; what either does not know makes no difference."""
    pairs = {name: (getattr(known, name), getattr(seen, name)) for name in FIELDS}
    return tuple(
        name
        for name, (before, now) in pairs.items()
        if None not in (before, now) and not _is_part(before, now) and not _is_part(now, before)
    )


def completed(seen: Fingerprint, known: Fingerprint) -> Fingerprint:
    """Return what is known now, where it says nothing or less from what was known before."""
    said = {name: value for name, value in seen.as_data().items() if value is not None}
    return replace(known, **{n: value for n, value in said.items() if not _is_part(value, getattr(known, n))})


def _is_part(text: str, whole: str | None) -> bool:
    """Return whether this is the same, or the type of an SST whose name (registers 22-29) was not read."""
    is_type = text.startswith("SST") and "-" not in text
    return text == whole or (is_type and whole is not None and whole.startswith(f"{text}-"))


def contradicts(model: str | None, seen: Fingerprint) -> bool:
    """Return whether a configured model cannot be the one that answers.

    Texts are spelt in many ways, so only what both say counts: the series (06 of SSW-06), the rated current,
    and of an SST the whole name.
    """
    if model is None or seen.model is None:
        return False
    ours, theirs = _plain(model), _plain(seen.model)
    if ours.startswith("SST") and theirs.startswith("SST"):
        return not (ours.startswith(theirs) or theirs.startswith(ours))
    series = _SERIES.match(ours), _SERIES.match(theirs)
    if series[0] and series[1] and series[0][1] != series[1][1]:
        return True
    current_a = decode.rated_current_a(model)
    return current_a is not None and not _may_have(seen, current_a)


_SERIES = re.compile(r"SSW0?(6|7|8|900)(?![0-9])")
_CURRENT = re.compile(r"([0-9.]+) A")
_RANGE = re.compile(r"([0-9]+) to ([0-9]+) A")  # of S3.3.1


def _plain(model: str) -> str:
    """Return a model's first word without its dashes: SSW06, SST330I75."""
    text = model.strip().upper().replace("SSW ", "SSW").replace("-", "")
    return text.partition(" ")[0]


def _may_have(seen: Fingerprint, current_a: float) -> bool:
    """Return whether a starter may be of this rated current; it may while it does not say its own."""
    text = seen.rated_current or ""
    size = _RANGE.fullmatch(text)
    if size is not None:
        return float(size[1]) <= current_a <= float(size[2])
    current = _CURRENT.fullmatch(text)
    return current is None or float(current[1]) == current_a


@dataclass(frozen=True, slots=True)
class IdentityMismatch:
    """Who answers instead of the one that is known."""

    known: Fingerprint
    seen: Fingerprint
    configured: str | None  # a model that it contradicts
    event: Event
    contradiction: str = ""  # of the configuration, not accepted yet: values would be of the wrong model


class IdentityRegistry:
    """Judges who answers by who was there before, which an earlier run may have saved.

    A starter that was never seen is taken as it is. All calls on the app's loop.
    """

    def __init__(self, records: RecordWriter, documents: Documents | None = None) -> None:
        self._publish = records.event
        self._known: dict[str, Known] = {}
        self._mismatches: dict[str, IdentityMismatch] = {}
        self._published: dict[str, IdentityMismatch] = {}
        self._on_accepted: dict[str, Callable[[], None]] = {}
        self._document = (documents or Documents()).open(
            FINGERPRINTS, KNOWN, lambda: self._known, delay_s=SAVED_TOGETHER_S, is_for_operators=True
        )
        self._known |= self._document.loaded or {}

    def when_accepted(self, starter: str, call: Callable[[], None]) -> None:
        """Have something done each time the device of this starter is accepted."""
        self._on_accepted[starter] = call

    def note(self, setup: StarterSetup, identity: Identity, *, is_settled: bool) -> None:
        """Record which device answers; until `is_settled` nothing of it is published or stored."""
        name, seen = setup.name, fingerprint_of(identity)
        known = self._known.get(name)
        mismatch = _mismatch_of(known, seen, setup.variant.model)
        if mismatch is None:
            self._mismatches.pop(name, None)
            self._published.pop(name, None)
            if is_settled:
                self._keep(name, known, seen)
            return
        self._mismatches[name] = mismatch
        if is_settled and self._published.get(name) != mismatch:
            self._published[name] = mismatch
            self._publish(name, mismatch.event)

    def forget(self, starter: str) -> None:
        """Record that the device is silent: the one that answers next is judged anew."""
        self._mismatches.pop(starter, None)
        self._published.pop(starter, None)

    def trouble(self, starter: str) -> str:
        """Return why commands to a starter are held; empty when they are not."""
        mismatch = self._mismatches.get(starter)
        return "" if mismatch is None else mismatch.event.text

    def contradiction(self, starter: str) -> str:
        """Return in what the device contradicts the configuration and was not accepted; empty: in nothing."""
        mismatch = self._mismatches.get(starter)
        return "" if mismatch is None else mismatch.contradiction

    def waiting(self, starter: str) -> IdentityMismatch:
        """Return which change waits to be accepted; CommandError when none does."""
        mismatch = self._published.get(starter)
        if mismatch is None or mismatch != self._mismatches.get(starter):
            raise CommandError(ResultCode.NOTHING_TO_ACCEPT)
        return mismatch

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
    return _mismatch_of(known, fingerprint_of(identity), setup.variant.model)


def _mismatch_of(known: Known | None, seen: Fingerprint, model: str | None) -> IdentityMismatch | None:
    """Return in what the device differs from the known one; None when in nothing."""
    before = NOTHING if known is None else known.fingerprint
    differing = differences(before, seen)
    accepted_model = None if known is None else known.despite_model
    configured = model if contradicts(model, seen) else None
    reasons = [
        phrase(
            EventCode.IDENTITY_CHANGED,
            "differs",
            field=name,
            before=getattr(before, name),
            now=getattr(seen, name),
        )
        for name in differing
    ]
    contradiction = ""
    if configured is not None and configured != accepted_model:
        contradiction = phrase(
            EventCode.IDENTITY_CHANGED, "contradicts", configured=configured, seen=_spoken(seen)
        )
        reasons.append(contradiction)
    if not reasons:
        return None
    event = event_of(
        EventCode.IDENTITY_CHANGED,
        known=before.as_data(),
        seen=seen.as_data(),
        configured_model=configured,
        differences="; ".join(reasons),
    )
    return IdentityMismatch(before, seen, configured, event, contradiction)


def _spoken(seen: Fingerprint) -> str:
    return ", ".join(filter(None, (seen.model, seen.rated_current)))
