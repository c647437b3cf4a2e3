"""Who turned the keypad: settings that read otherwise than before, although nobody set them through us."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.errors import CommandError
from gateway.families.bulk import is_set_by_people
from gateway.families.parameters import find, to_words
from gateway.families.schema import Profile, Variant
from gateway.starters.changes import Change
from gateway.starters.parameter_set import Entry, entries_of
from gateway.starters.records import Severity

EVENT = "parameter_changed"


def watched_codes(profile: Profile) -> tuple[str, ...]:
    """Return the settings of a family that change only when somebody sets them."""
    return tuple(row.code for row in profile.parameters.values() if is_set_by_people(row))


class KeypadWatch:
    """Compares each reading of a setting with the one before it; the first one of all tells nothing."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile
        self._watched = frozenset(watched_codes(profile))
        self._known: dict[str, tuple[int, ...]] = {}
        self._ours: dict[str, tuple[int, ...]] = {}  # what we last set, until it is read
        self._settled: set[str] = set()  # of these, what the command has ended for

    def note_command(self, variant: Variant, verb: str, args: Mapping[str, Any], *, is_over: bool) -> None:
        """Take over that a `set` or `configure` of ours is under way; `is_over` once it has ended.

        What it wrote is ours up to the first reading after its end.
        """
        for code, value in rows_set(verb, args).items():
            try:
                row = find(self._profile, code)
                words = to_words(self._profile, row, value, variant=variant)
            except CommandError:  # it is refused then
                continue
            self._ours[row.code] = words
            if is_over:
                self._settled.add(row.code)
            else:
                self._settled.discard(row.code)

    def recall(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Take over rows as they were read in an earlier run, as far as nothing newer is known."""
        self._known = {code: words for code, words in rows.items() if code in self._watched} | self._known

    def note_written(self, rows: Mapping[str, tuple[int, ...]]) -> None:
        """Take over that the gateway itself writes these rows now."""
        self._ours.update(rows)
        self._settled.update(rows)

    def note_reading(self, variant: Variant, rows: Mapping[str, tuple[int, ...]]) -> tuple[Change, ...]:
        """Take over settings that were just read and return what somebody else has changed."""
        found = []
        for code, words in rows.items():
            if code not in self._watched:
                continue
            before = self._known.get(code)
            self._known[code] = words
            ours = self._ours.get(code)
            if code in self._settled:
                self._settled.discard(code)
                del self._ours[code]
            if before not in (None, words) and ours != words:
                found.append(self._change(variant, code, before or (), words))
        return tuple(found)

    def _change(self, variant: Variant, code: str, before: tuple[int, ...], after: tuple[int, ...]) -> Change:
        old = entries_of(self._profile, variant, {code: before})[code]
        new = entries_of(self._profile, variant, {code: after})[code]
        text = f"{code} {old.name} was changed at the starter: {old.shown} -> {new.shown}"
        data = {"parameter": code, "name": old.name, "before": _as_data(old), "after": _as_data(new)}
        return Change(EVENT, Severity.WARNING, text, data)


def rows_set(verb: str, args: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a command sets, by code."""
    if verb != "set":
        return dict(args)
    several = [each for each in args.values() if isinstance(each, Mapping)]
    wanted = {str(code): value for each in several for code, value in each.items()}
    return wanted or {str(args.get("parameter")): args.get("value")}


def _as_data(entry: Entry) -> dict[str, Any]:
    return {
        "value": entry.value,
        "label": entry.label,
        "unit": entry.unit,
        "raw": list(entry.raw or ()),
    }
