"""What follows from a profile alone is made once, and shared by all starters of the family."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Generic, TypeVar

from gateway.families.profile.schema import Profile

MOST = 64  # profiles that a function remembers; a site has a few, tests have many

T = TypeVar("T")
Key = TypeVar("Key")


def once_per_profile(make: Callable[[Profile], T]) -> Callable[[Profile], T]:
    """Return `make` with its results remembered by the profile itself; they must never be changed.

    With 247 starters of one family 247 equal tables would stand in memory.
    """
    made: dict[int, tuple[Profile, T]] = {}  # by id, since it cannot be hashed; it lives as long

    @wraps(make)
    def remembered(profile: Profile) -> T:
        found = made.get(id(profile))
        if found is None:
            if len(made) >= MOST:
                made.clear()
            found = made[id(profile)] = (profile, make(profile))
        return found[1]

    return remembered


class ProfileMemo(Generic[Key, T]):
    """The same for what follows from a profile and a key: up to `MOST` of each profile."""

    def __init__(self) -> None:
        self._known = once_per_profile(_empty)

    def get(self, profile: Profile, key: Key, make: Callable[[], T]) -> T:
        """Return what was made for this profile and key before, else what `make` returns now."""
        known: dict[Key, T] = self._known(profile)
        if key not in known:
            if len(known) >= MOST:
                known.clear()
            known[key] = make()
        return known[key]


def _empty(_: Profile) -> dict[Any, Any]:
    return {}
