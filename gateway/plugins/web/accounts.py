"""Who is logged in to the page: sessions, how often a wrong password may be tried, and the audit of both.

A session's secret is 256 bits, of which only the SHA-256 is stored here. Passwords are checked one at a time,
in a thread.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
import secrets
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gateway.config import rights_of
from gateway.contract import AuditRecord, RecordWriter, rfc3339
from gateway.plugins.web.plugin import WebSettings, WebUser
from gateway.plugins.web.requests import Caller, WebError, busy, cookie, set_cookie
from gateway.system.password_hash import MAX_PASSWORD_BYTES, is_password, unmatched_line

log = logging.getLogger(__name__)

WEB = "web"  # the source of commands and logins in the audit

IDLE_S = 1800.0  # of those who may start a motor
LONGEST_S = 12 * 3600.0
MOST_SESSIONS = 64  # the one that was used longest ago ends for a new one

MOST_WAITING = 4  # logins that wait for their check
BUSY_S = 2
FREE_FAILURES = 5  # wrong passwords for a login from one address without a wait; then it doubles
LONGEST_WAIT_S = 300.0
FREE_OF_ONE = 20  # the same for a login from any address, and for any login from an address
LONGEST_OF_ONE_S = 2.0
MOST_KEYS = 1024  # addresses and logins of which failures are remembered
_Key = tuple[str | None, str | None]  # login, address; None: any


@dataclass(slots=True)
class WebSession:
    """One login."""

    key: str  # SHA-256 of the secret
    user: WebUser  # as it was at the login: with another password or operator the session ends
    csrf: str
    is_idle_limited: bool  # the user may start motors
    ends_s: float  # at the latest, used or not
    used_s: float


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


def _limits(user: str, address: str) -> dict[_Key, tuple[int, float]]:
    """Return what counts for this login from this address: passwords without a wait, and the longest wait."""
    return {
        (user, address): (FREE_FAILURES, LONGEST_WAIT_S),
        (user, None): (FREE_OF_ONE, LONGEST_OF_ONE_S),
        (None, address): (FREE_OF_ONE, LONGEST_OF_ONE_S),
    }


class Accounts:
    """On the application's loop."""

    def __init__(
        self,
        settings: WebSettings,
        records: RecordWriter,
        *,
        check: Callable[[str, str], bool] = is_password,
    ) -> None:
        self._settings = settings
        self._records = records
        self._clock = records.clock
        self._check = check
        self._sessions: OrderedDict[str, WebSession] = OrderedDict()  # by key, the latest used last
        self._limiter = LoginLimiter()
        self._one_at_a_time = asyncio.Lock()
        self._waiting = 0

    def reconfigure(self, settings: WebSettings) -> None:
        """Know other users from now on; sessions of those that are no longer the same end."""
        self._settings = settings
        for key, session in tuple(self._sessions.items()):
            if settings.users.get(session.user.name) != session.user:
                del self._sessions[key]

    def session(self, caller: Caller, *, is_use: bool = True) -> WebSession | None:
        """Return the login that a request carries, or None; using it counts against its idle time."""
        session = self._sessions.get(key_of(cookie(caller)))
        if session is None or not self.is_logged_in(session):
            return None
        if is_use:
            session.used_s = self._clock.now_s()
            self._sessions.move_to_end(session.key)
        return session

    def is_logged_in(self, session: WebSession) -> bool:
        """Return whether a session has not ended."""
        now_s = self._clock.now_s()
        if now_s > session.ends_s or (session.is_idle_limited and now_s - session.used_s > IDLE_S):
            self._sessions.pop(session.key, None)
        return session.key in self._sessions

    async def log_in(self, user: object, password: object, caller: Caller) -> tuple[str, WebSession]:
        """Check a password and begin a session; return its secret, which is not stored; WebError.

        Each attempt takes the same time, whatever is wrong with it.
        """
        name = user if isinstance(user, str) else ""
        tried = name[:64], caller.address
        now_s = self._clock.now_s()
        wait_s = self._limiter.wait_s(*tried, now_s=now_s)
        if wait_s > 0 or self._waiting >= MOST_WAITING:
            pause_s = math.ceil(wait_s) or BUSY_S
            text = f"too many wrong passwords; wait {pause_s} s"
            raise busy(text, pause_s, status=429, code="too_many_logins")
        known = self._settings.users.get(name)
        line = unmatched_line() if known is None else known.password_line
        is_text = isinstance(password, str) and len(password) <= MAX_PASSWORD_BYTES
        self._limiter.failed(*tried, now_s=now_s)  # before the check: attempts at the same time count, too
        is_right = await self._checked(str(password) if is_text else "-", line)
        is_same = self._settings.users.get(name) == known  # else a reload has changed the user meanwhile
        if not is_right or not is_text or known is None or not is_same:
            self.audit("login", "wrong_login", known, {"address": caller.address})
            raise WebError(401, "wrong_login", "the user or the password is wrong")
        self._limiter.succeeded(*tried)
        while len(self._sessions) >= MOST_SESSIONS:
            self._sessions.popitem(last=False)
        secret, csrf, now_s = secrets.token_urlsafe(32), secrets.token_urlsafe(32), self._clock.now_s()
        may_start = self._may_start(known.client)
        session = WebSession(key_of(secret), known, csrf, may_start, now_s + LONGEST_S, now_s)
        self._sessions[session.key] = session
        self.audit("login", "ok", known, {"address": caller.address})
        return secret, session

    def log_out(self, session: WebSession, caller: Caller) -> None:
        """End a session."""
        self._sessions.pop(session.key, None)
        self.audit("logout", "ok", session.user, {"address": caller.address})

    def cookie(self, caller: Caller, secret: str) -> str:
        """Return the Set-Cookie header of a login, or of its end."""
        return set_cookie(caller, secret, base_path=self._settings.base_path)

    def as_data(self, session: WebSession | None) -> dict[str, Any]:
        """Return what the page is sent about a login, or about there being none."""
        has_logins = bool(self._settings.users)
        if session is None:
            empty = dict.fromkeys(("user", "client", "csrf", "idle_s", "ends"))
            return {**empty, "logins": has_logins}
        return {
            "user": session.user.name,
            "client": session.user.client,
            "csrf": session.csrf,
            "idle_s": IDLE_S if session.is_idle_limited else None,
            "ends": rfc3339(self._clock.utc_s(session.ends_s)),
            "logins": has_logins,
        }

    async def _checked(self, password: str, line: str) -> bool:
        self._waiting += 1
        try:
            async with self._one_at_a_time:
                return await asyncio.to_thread(self._check, password, line)
        finally:
            self._waiting -= 1

    def _may_start(self, client: str) -> bool:
        """Return whether an operator may start any motor."""
        rights = rights_of(self._settings.config)
        return any(
            rights.is_allowed(client, verb=verb, starter=starter)
            for starter in self._settings.starters
            for verb in ("start", "jog")
        )

    def audit(
        self, verb: str, code: str, user: WebUser | None, args: Mapping[str, str], *, starter: str = ""
    ) -> None:
        """Record an act on the page that is no command, or a refused one, in the audit and the log."""
        name, client = ("", "") if user is None else (user.name, user.client)
        said = " ".join(f"{key}={value}" for key, value in args.items())
        log.info("web %s: user=%s client=%s %s %s", verb, name or "unknown", client, said, code)
        self._records.put(
            AuditRecord(
                starter=starter,
                client=client,
                operator=name or None,
                verb=verb,
                args=args,
                decision="confirmed" if code == "ok" else "rejected",
                code=code,
                time_s=self._clock.utc_s(),
                seq=next(self._records.sequence),
                boot=self._records.boot,
                source=WEB,
            )
        )
