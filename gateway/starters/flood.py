"""How many commands are taken from one client, for one starter, from everyone; how many refusals are told."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

TELL_EVERY_S = 0.1  # refusals to one client


@dataclass(frozen=True, slots=True)
class Rate:
    """So many a second on average, so many at once."""

    per_s: float
    burst: int


@dataclass(frozen=True, slots=True)
class Limits:
    """What the gateway takes; nobody operates motors this fast by hand."""

    client: Rate = Rate(20.0, 100)
    starter: Rate = Rate(5.0, 20)  # of one client
    everyone: Rate = Rate(200.0, 300)
    under_way_on_line: int = 32  # so that none waits for the line longer than it is fresh
    parameters_on_line: int = 16  # of them reads and settings, which have a share of the line only
    answered_stops: int = 8  # of one starter's at the same time; the others are carried out all the same


class Bucket:
    """A token bucket: full at the beginning."""

    def __init__(self, rate: Rate) -> None:
        self._rate = rate
        self._tokens = float(rate.burst)
        self._at_s: float | None = None

    def take(self, now_s: float) -> bool:
        """Take a token; return whether there was one."""
        if self._at_s is not None:
            gained = (now_s - self._at_s) * self._rate.per_s
            self._tokens = min(self._tokens + gained, float(self._rate.burst))
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class Flood:
    """Says which commands are too many. Keys must come from a bounded set."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._clients: dict[Hashable, Bucket] = {}
        self._starters: dict[Hashable, Bucket] = {}
        self._everyone = Bucket(limits.everyone)

    def admits(self, *, client: Hashable, starter: Hashable, now_s: float) -> bool:
        """Count a command and return whether it is within all limits; one too many costs others nothing."""
        of_client = self._clients.setdefault(client, Bucket(self._limits.client))
        of_starter = self._starters.setdefault((client, starter), Bucket(self._limits.starter))
        return of_client.take(now_s) and of_starter.take(now_s) and self._everyone.take(now_s)


class Damper:
    """Lets one refusal for each client pass in an interval and counts the others."""

    def __init__(self, every_s: float = TELL_EVERY_S) -> None:
        self._every_s = every_s
        self._told_s: dict[Hashable, float] = {}
        self._untold: dict[Hashable, int] = {}

    def passes(self, client: Hashable, *, now_s: float) -> bool:
        """Return whether a refusal is told by itself; otherwise it is counted."""
        told_s = self._told_s.get(client)
        if client not in self._untold and (told_s is None or now_s - told_s >= self._every_s):
            self._told_s[client] = now_s
            return True
        self._untold[client] = self._untold.get(client, 0) + 1
        return False

    def take(self, client: Hashable, *, now_s: float) -> int:
        """Return how many refusals were counted since the last was told, and count from none again."""
        self._told_s[client] = now_s
        return self._untold.pop(client)
