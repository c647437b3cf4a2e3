"""Whether a command is fresh: the one rule, and the tokens that prove it.

What a command passes on its way (a client's queue, brokers, a bridge, a stalled connection) may hold it for
any time. So it carries what dates it:

1. `token`: made by this gateway each second, published at once and remembered with its time on the gateway's
   own steady clock. A command that carries one was decided upon after that time. No other clock takes part.
2. `issued_at`: the sender's wall clock, compared with ours while ours is synchronised and was not stepped.

Any right proof is enough, but none saves a command whose own time (`ttl_s`) has run out by another. `read`
needs no proof. `boot` names the connection and proves nothing; one that is not the present one is refused.

They also say when a command was decided upon at the earliest, which is compared with the stops: a start that
may have been decided upon before a stop came must not act after it, however fresh it is. By a token that is
when it was made; by `issued_at` alone MAX_AHEAD_S before that time, since the sender's clock may run ahead by
so much. Of several the earliest counts.
"""

from __future__ import annotations

import secrets
from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import islice

from gateway.contract import MAX_TTL_S, READ, CommandError, CommandRequest, ResultCode

MAX_AHEAD_S = 2.0  # how far a sender's clock may run before ours
EVERY_S = 1.0  # between two tokens
_TOKEN_BYTES = 12


BY_TOKEN, BY_ISSUED_AT = "token", "issued_at"  # `freshness` of an operator


class Tokens:
    """The tokens of the last MAX_TTL_S; a lost connection or a standstill invalidates them.

    Numbers (`seq`) go on over a reconnection, so their messages carry `run`; `boot` changes whenever tokens
    are invalidated.
    """

    def __init__(self, run: str) -> None:
        self.run = run
        self._boots = 1  # so far
        self._connected_s: float | None = None
        self._made: dict[str, tuple[float, str]] = {}  # token: when, and the boot of then; oldest first

    @property
    def boot(self) -> str:
        """Return the `boot` of gateway/status: the run's own name during its first connection."""
        return self.run if self._boots == 1 else f"{self.run}-{self._boots}"

    def connected(self, now_s: float) -> None:
        """Note, on the steady clock, since when commands can arrive; further calls change nothing."""
        if self._connected_s is None:
            self._connected_s = now_s

    def disconnected(self) -> None:
        """Invalidate the tokens of the lost connection; without a connection nothing changes."""
        if self._connected_s is not None:
            self._boots += 1
            self._connected_s = None

    def stood_still(self, now_s: float) -> None:
        """Invalidate the tokens issued so far: a command that carries one has waited for an unknown time."""
        self._boots += 1
        if self._connected_s is not None:
            self._connected_s = now_s

    def is_before_connection(self, at_s: float) -> bool:
        """Return whether a moment of the steady clock lies before the present connection."""
        return self._connected_s is not None and at_s < self._connected_s

    def issue(self, now_s: float) -> str:
        """Return a new token, made now on the steady clock."""
        for token, (made_s, _) in list(islice(self._made.items(), 2)):  # more go than come
            if now_s - made_s > MAX_TTL_S + EVERY_S:
                del self._made[token]
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._made[token] = now_s, self.boot
        return token

    def has_made(self, token: str) -> bool:
        """Return whether this gateway made a token lately, whether it counts or not."""
        return token in self._made

    def made_s(self, token: str) -> float | None:
        """Return when a token was made; None for one that does not count, or never was."""
        made_s, boot = self._made.get(token, (None, ""))
        return made_s if boot == self.boot else None


@dataclass(frozen=True, slots=True)
class ArrivalTime:
    """When a command is judged: steady clock and wall clock, and why the latter is not trusted, if so."""

    now_s: float
    utc_s: float
    clock_doubt: str | None = None  # None: `issued_at` can be compared with `utc_s`


def dated(
    request: CommandRequest, *, freshness: Collection[str], tokens: Tokens, moment: ArrivalTime
) -> CommandRequest:
    """Return a fresh command with the time at which it was decided upon; CommandError for others.

    `freshness` holds the settings of the operator's entries that give the right; any of them is enough.
    """
    now_s, ttl_s = moment.now_s, request.ttl_s
    if request.boot not in (None, tokens.boot):
        raise CommandError(ResultCode.WRONG_BOOT)
    made_s, issued_s = tokens.made_s(request.token or ""), None  # on the steady clock
    if request.issued_s is not None and moment.clock_doubt is None:
        issued_s = now_s - (moment.utc_s - request.issued_s)
    dates = [at_s for at_s in (made_s, issued_s) if at_s is not None]
    since_s = min(dates, default=now_s)
    if now_s - since_s > ttl_s:
        raise CommandError(ResultCode.EXPIRED, "decided", age_s=now_s - since_s, ttl_s=ttl_s)
    trouble = None if issued_s is None else _issued_trouble(issued_s, tokens, now_s)
    is_issued = issued_s is not None and trouble is None
    if request.verb != READ and not is_issued and (made_s is None or BY_TOKEN not in freshness):
        raise trouble or _unproven(request, freshness, moment)
    if request.is_early:
        raise before_connection()
    expires_s = min(since_s, now_s) + ttl_s
    if request.expires_s is not None:
        expires_s = min(expires_s, request.expires_s)
    ahead_s = MAX_AHEAD_S if made_s is None else 0.0  # the sender's clock may run so far before ours
    return replace(request, expires_s=expires_s, decided_s=since_s - ahead_s if dates else None)


def _issued_trouble(issued_s: float, tokens: Tokens, now_s: float) -> CommandError | None:
    """Return why `issued_at`, read by a good clock and not expired, proves nothing."""
    if issued_s - now_s > MAX_AHEAD_S:
        return CommandError(ResultCode.NOT_FRESH, "ahead", ahead_s=issued_s - now_s)
    if tokens.is_before_connection(issued_s - MAX_AHEAD_S):
        return before_connection()
    return None


def before_connection() -> CommandError:
    """Return the refusal of what may have been issued while no gateway was there to take a stop."""
    return CommandError(ResultCode.BEFORE_CONNECTION, "broker")


def dated_alone(doubt: str | None) -> CommandError:
    """Return what commands of `freshness = "issued_at"` lack; `doubt` is of the gateway's clock."""
    if doubt is None:
        return CommandError(ResultCode.NOT_FRESH, "needs_issued_at")
    return CommandError(ResultCode.NOT_FRESH, "clock_in_doubt", doubt=doubt)


def _unproven(request: CommandRequest, freshness: Collection[str], moment: ArrivalTime) -> CommandError:
    """Return what is missing, of a command with no proof that can be taken."""
    if set(freshness) == {BY_ISSUED_AT}:
        return dated_alone(moment.clock_doubt)
    if request.token is not None:
        return CommandError(ResultCode.NOT_FRESH, "token_unknown", longest_s=MAX_TTL_S)
    if request.issued_s is not None:
        return CommandError(ResultCode.NOT_FRESH, "issued_at_in_doubt", doubt=moment.clock_doubt)
    return CommandError(ResultCode.NOT_FRESH, "no_proof")
