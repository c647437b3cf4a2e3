"""What an operator takes for granted of a starter, compared with what was just read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.errors import CommandError
from gateway.families.gather import rows_of_points
from gateway.families.interlock import points_needed
from gateway.families.schema import Profile
from gateway.families.state import STATES, state_of

STATE = "state"


class Expectation:
    """A state, or the values of points, that must still be so; `code` is that of a refusal."""

    def __init__(self, profile: Profile, wanted: Mapping[str, Any], *, code: str = "not_as_expected") -> None:
        for name, value in wanted.items():
            if name != STATE and name not in profile.points:
                raise CommandError(
                    "bad_expect", f"{profile.title} has no {name[:40]!r} to expect anything of"
                )
            if name == STATE and value not in STATES:
                raise CommandError("bad_expect", f"a state is one of {', '.join(STATES)}")
        self._profile = profile
        self._wanted = wanted
        self._code = code

    @property
    def codes(self) -> tuple[str, ...]:
        """Return the rows that must be read to tell."""
        names = [name for name in self._wanted if name != STATE]
        if STATE in self._wanted:
            names += points_needed(self._profile, ("is_ready",))
        return rows_of_points(self._profile, names)

    def check(self, points: Mapping[str, Any]) -> None:
        """Raise CommandError unless all is as expected."""
        for name, wanted in self._wanted.items():
            value = state_of(self._profile, points) if name == STATE else points.get(name)
            if not _is_equal(value, wanted):
                text = f"{name}: expected {_word(wanted)}, but it is {_word(value)}; look, then decide again"
                raise CommandError(self._code, text)


def _is_equal(value: object, wanted: object) -> bool:
    return isinstance(value, bool) is isinstance(wanted, bool) and value == wanted


def _word(value: object) -> str:
    if value is None:
        return "unknown"
    return str(value).lower() if isinstance(value, bool) else str(value)
