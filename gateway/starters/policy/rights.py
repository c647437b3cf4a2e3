"""Who may do what to which starter; without operators the gateway is read-only."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable

from gateway.contract import CANCEL, Operator

ANY_VERB = "*"


class Rights:
    """The rights of all operators; what was not granted is refused."""

    def __init__(self, operators: Iterable[Operator] = ()) -> None:
        self.operators = tuple(operators)

    def is_known(self, client: str) -> bool:
        """Return whether the client has any right at all."""
        return any(operator.client == client for operator in self.operators)

    def is_lockable(self, starter: str) -> bool:
        """Return whether anybody may set a maintenance lock on this starter."""
        return any(self.is_allowed(each.client, verb="lock", starter=starter) for each in self.operators)

    def is_allowed(self, client: str, *, verb: str, starter: str) -> bool:
        """Return whether one of the client's entries names this verb and this starter; any gives `cancel`."""
        return bool(self._granting(client, verb, starter))

    def freshness(self, client: str, *, verb: str, starter: str) -> tuple[str, ...]:
        """Return the `freshness` of the client's entries that give this right, each of them enough.

        The default counts for what no entry names: verbs that need no right, and what will be refused.
        """
        return tuple(each.freshness for each in self._granting(client, verb, starter)) or ("token",)

    def _granting(self, client: str, verb: str, starter: str) -> list[Operator]:
        return [
            each
            for each in self.operators
            if each.client == client and _matches(each, starter)
            if verb == CANCEL or {ANY_VERB, verb} & set(each.may)
        ]


def _matches(operator: Operator, starter: str) -> bool:
    return any(fnmatch.fnmatchcase(starter, pattern) for pattern in operator.starters)
