"""The fingerprint of a starter: what it says of itself, and how another, or its model, differs from it."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace

from gateway.contract import Event, EventCode, event_of, phrase
from gateway.families import Identity, decode

_SERIES = re.compile(r"SSW0?(6|7|8|900)(?![0-9])")
_CURRENT = re.compile(r"([0-9.]+) A")
_RANGE = re.compile(r"([0-9]+) to ([0-9]+) A")  # of S3.3.1


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


@dataclass(frozen=True, slots=True)
class Known:
    """The last fingerprint that was taken for right, and a configured model that it may contradict."""

    fingerprint: Fingerprint = Fingerprint()
    despite_model: str | None = None  # what stood in the configuration when an operator accepted it


@dataclass(frozen=True, slots=True)
class IdentityMismatch:
    """The starter that answers instead of the known one."""

    known: Fingerprint
    seen: Fingerprint
    configured: str | None  # a model that it contradicts
    event: Event
    contradiction: str = ""  # of the configuration, not accepted yet: values would be of the wrong model


def fingerprint_of(identity: Identity) -> Fingerprint:
    """Return the fingerprint of a starter that was identified."""
    current_a = identity.rated_current_a
    return Fingerprint(
        family=identity.family_seen,
        model=identity.model,
        rated_current=identity.rating or (f"{current_a:g} A" if current_a else None),
        firmware=identity.firmware,
        serial=identity.serial,
    )


def mismatch_of(known: Known, seen: Fingerprint, model: str | None) -> IdentityMismatch | None:
    """Return in what a starter differs from the known one, or from its configured model; None: nothing."""
    before, configured = known.fingerprint, model if contradicts(model, seen) else None
    reasons = []
    for name in differences(before, seen):
        was, now = getattr(before, name), getattr(seen, name)
        reasons.append(phrase(EventCode.IDENTITY_CHANGED, "differs", field=name, before=was, now=now))
    contradiction = ""
    if configured is not None and configured != known.despite_model:
        spoken = ", ".join(filter(None, (seen.model, seen.rated_current)))
        contradiction = phrase(EventCode.IDENTITY_CHANGED, "contradicts", configured=configured, seen=spoken)
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


def contradicts(model: str | None, seen: Fingerprint) -> bool:
    """Return whether a configured model cannot be the one that answers.

    Texts are spelt in many ways, so only what both say counts: the series (06 of SSW-06), the rated current,
    and of an SST the whole name.
    """
    if model is None or seen.model is None:
        return False
    configured, said = _plain(model), _plain(seen.model)
    if configured.startswith("SST") and said.startswith("SST"):
        return not (configured.startswith(said) or said.startswith(configured))
    series = _SERIES.match(configured), _SERIES.match(said)
    if series[0] and series[1] and series[0][1] != series[1][1]:
        return True
    current_a = decode.rated_current_a(model)
    return current_a is not None and not _may_have(seen, current_a)


def _is_part(text: str, whole: str | None) -> bool:
    """Return whether this is the same, or the type of an SST whose name (registers 22-29) was not read."""
    is_type = text.startswith("SST") and "-" not in text
    return text == whole or (is_type and whole is not None and whole.startswith(f"{text}-"))


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
