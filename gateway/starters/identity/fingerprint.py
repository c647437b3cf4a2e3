"""Who a starter was when it answered last, and whether the device that answers now is the same."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from gateway.families.devices.device import Identity
from gateway.families.profile.decode import rated_current_a


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """What a starter said about itself; None is not known."""

    family: str | None = None
    model: str | None = None
    rated_current: str | None = None  # "85 A", or the range of an SSW900's size
    firmware: str | None = None
    serial: str | None = None

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

    def as_data(self) -> dict[str, str | None]:
        """Return it as it is stored."""
        return {**self.fingerprint.as_data(), "despite_model": self.despite_model}


def known_from(document: Any) -> Known | None:
    """Return what `Known.as_data` stored; None when it is no such thing."""
    if not isinstance(document, Mapping):
        return None
    stored = {name: document.get(name) for name in (*FIELDS, "despite_model")}
    if any(value is not None and not isinstance(value, str) for value in stored.values()):
        return None
    despite_model = stored.pop("despite_model")
    return Known(Fingerprint(**stored), despite_model)


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
    return tuple(name for name, pair in pairs.items() if None not in pair and pair[0] != pair[1])


def completed(seen: Fingerprint, known: Fingerprint) -> Fingerprint:
    """Return what is known now, where it says nothing from what was known before."""
    return replace(known, **{name: value for name, value in seen.as_data().items() if value is not None})


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
    current_a = rated_current_a(model)
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
