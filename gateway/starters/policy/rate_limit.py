"""How many commands are taken from one client, for one starter, from everyone; how many refusals are told."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from gateway.system.token_bucket import Bucket, Rate


@dataclass(frozen=True, slots=True)
class RateLimits:
    """What the gateway takes; nobody operates motors this fast by hand."""

    client: Rate = Rate(20.0, 100)
    starter: Rate = Rate(5.0, 20)  # of one client
    everyone: Rate = Rate(200.0, 300)
    under_way_on_line: int = 32  # so that none waits for the line longer than it is fresh
    parameters_on_line: int = 16  # of them reads and settings, which have a share of the line only
    answered_stops: int = 8  # of one starter's at the same time; the others are carried out all the same


class RateLimiter:
    """Says which commands are too many. Keys must come from a bounded set."""

    def __init__(self, limits: RateLimits) -> None:
        self._limits = limits
        self._clients: dict[Hashable, Bucket] = {}
        self._starters: dict[Hashable, Bucket] = {}
        self._everyone = Bucket(limits.everyone)

    def admits(self, *, client: Hashable, starter: Hashable, now_s: float) -> bool:
        """Count a command and return whether it is within all limits; one too many costs others nothing."""
        of_client = self._clients.setdefault(client, Bucket(self._limits.client))
        of_starter = self._starters.setdefault((client, starter), Bucket(self._limits.starter))
        return of_client.take(now_s) and of_starter.take(now_s) and self._everyone.take(now_s)
