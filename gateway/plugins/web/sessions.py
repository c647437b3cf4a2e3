"""Logins: sessions with their times, and how often a wrong password may be tried; pure.

A session's secret is 256 bits, of which only the SHA-256 is stored here.
"""

from __future__ import annotations

import hashlib
import secrets
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass

from gateway.plugins.web.interface import WebUser

IDLE_S = 1800.0  # of those who may start a motor
LONGEST_S = 12 * 3600.0
MOST_SESSIONS = 64  # the one that was used longest ago ends for a new one

FREE_FAILURES = 5  # wrong passwords for a login from one address without a wait; then it doubles
LONGEST_WAIT_S = 300.0
FREE_OF_ONE = 20  # the same for a login from any address, and for any login from an address
LONGEST_OF_ONE_S = 2.0
MOST_KEYS = 1024  # addresses and logins of which failures are remembered


@dataclass(slots=True)
class WebSession:
    """One login."""

    key: str  # SHA-256 of the secret
    user: str
    client: str
    csrf: str
    password_line: str  # with which it was opened: a changed password ends it
    is_idle_limited: bool  # the user may start motors
    begun_s: float
    used_s: float

    def is_over(self, now_s: float) -> bool:
        """Return whether it has ended by time."""
        is_idle = self.is_idle_limited and now_s - self.used_s > IDLE_S
        return is_idle or now_s - self.begun_s > LONGEST_S

    def ends_s(self) -> float:
        """Return when it ends at the latest, used or not."""
        return self.begun_s + LONGEST_S


class Sessions:
    """All sessions of this run."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, WebSession] = OrderedDict()  # by key, the latest used last

    def open(self, user: WebUser, *, is_idle_limited: bool, now_s: float) -> tuple[str, WebSession]:
        """Begin a session; return its secret, which is not stored, and the session."""
        while len(self._sessions) >= MOST_SESSIONS:
            self._sessions.popitem(last=False)
        secret, csrf = secrets.token_urlsafe(32), secrets.token_urlsafe(32)
        key = key_of(secret)
        session = WebSession(
            key, user.name, user.client, csrf, user.password_line, is_idle_limited, now_s, now_s
        )
        self._sessions[key] = session
        return secret, session

    def find(self, secret: str, *, now_s: float, is_use: bool = True) -> WebSession | None:
        """Return the session of this secret; using it counts against its idle time."""
        session = self.by_key(key_of(secret), now_s=now_s)
        if session is not None and is_use:
            session.used_s = now_s
            self._sessions.move_to_end(session.key)
        return session

    def by_key(self, key: str, *, now_s: float) -> WebSession | None:
        """Return a session that has not ended."""
        session = self._sessions.get(key)
        if session is not None and session.is_over(now_s):
            del self._sessions[key]
            return None
        return session

    def end(self, key: str) -> None:
        """End a session, if there is one."""
        self._sessions.pop(key, None)

    def keep_users(self, users: Mapping[str, WebUser]) -> None:
        """End the sessions of users that were removed or have another password or operator."""
        for key, session in tuple(self._sessions.items()):
            user = users.get(session.user)
            if user is None or (user.client, user.password_line) != (session.client, session.password_line):
                del self._sessions[key]


def key_of(secret: str) -> str:
    """Return what a session is found by."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()


class LoginLimiter:
    """How long a login waits at an address after wrong passwords for it from there.

    A login from anywhere, and an address with any login, wait a moment at most: others are not shut out.
    """

    def __init__(self) -> None:
        self._failures: OrderedDict[_Key, tuple[int, float]] = OrderedDict()  # count, until when

    def wait_s(self, user: str, address: str, *, now_s: float) -> float:
        """Return how long this login may not be tried from this address; 0 when it may."""
        return max(0.0, *(self._failures.get(key, (0, now_s))[1] - now_s for key in _limits(user, address)))

    def failed(self, user: str, address: str, *, now_s: float) -> None:
        """Count a wrong password."""
        for key, (free, longest_s) in _limits(user, address).items():
            count = self._failures.pop(key, (0, 0.0))[0] + 1
            wait_s = min(2.0 ** (count - free), longest_s) if count >= free else 0.0
            self._failures[key] = min(count, 64), now_s + wait_s
            while len(self._failures) > MOST_KEYS:
                self._failures.popitem(last=False)

    def succeeded(self, user: str, address: str) -> None:
        """Forget what was wrong before the right password came."""
        for key in _limits(user, address):
            self._failures.pop(key, None)


_Key = tuple[str | None, str | None]  # login, address; None: any


def _limits(user: str, address: str) -> dict[_Key, tuple[int, float]]:
    """Return what counts for this login from this address: passwords without a wait, and the longest wait."""
    return {
        (user, address): (FREE_FAILURES, LONGEST_WAIT_S),
        (user, None): (FREE_OF_ONE, LONGEST_OF_ONE_S),
        (None, address): (FREE_OF_ONE, LONGEST_OF_ONE_S),
    }
