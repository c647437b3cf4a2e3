"""Who is logged in to the page: passwords checked one at a time in a thread, each attempt in the audit."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gateway.contract import rfc3339
from gateway.plugins.web.interface import GatewayAccess, WebSettings
from gateway.plugins.web.requests import Caller, cookie, cookie_name, set_cookie
from gateway.plugins.web.sessions import IDLE_S, LoginLimiter, Sessions, WebSession
from gateway.system.clock import Clock
from gateway.system.password_hash import MAX_PASSWORD_BYTES, is_password, unmatched_line

MOST_WAITING = 4  # logins that wait for their check
BUSY_S = 2


@dataclass(frozen=True, slots=True)
class LoginOutcome:
    """A session with its secret, or how long to wait; neither: wrong."""

    session: WebSession | None = None
    secret: str = field(default="", repr=False)
    wait_s: int = 0


class Accounts:
    """On the application's loop."""

    def __init__(
        self,
        settings: WebSettings,
        access: GatewayAccess,
        clock: Clock,
        *,
        check: Callable[[str, str], bool] = is_password,
    ) -> None:
        self._settings = settings
        self._access = access
        self._clock = clock
        self._check = check
        self._sessions = Sessions()
        self._limiter = LoginLimiter()
        self._one_at_a_time = asyncio.Lock()
        self._waiting = 0

    def move(self, settings: WebSettings) -> None:
        """Know other users from now on; sessions of those that are no longer the same end."""
        self._settings = settings
        self._sessions.keep_users(settings.users)

    def session(
        self, headers: Mapping[str, str], caller: Caller, *, is_use: bool = True
    ) -> WebSession | None:
        """Return the login that a request carries; None for none."""
        secret = cookie(headers, cookie_name(caller))
        if not secret:
            return None
        return self._sessions.find(secret, now_s=self._clock.now_s(), is_use=is_use)

    def is_logged_in(self, key: str) -> bool:
        """Return whether a session has not ended."""
        return self._sessions.by_key(key, now_s=self._clock.now_s()) is not None

    async def log_in(self, user: object, password: object, caller: Caller) -> LoginOutcome:
        """Check a password; each attempt takes the same time, whatever is wrong with it."""
        name = user if isinstance(user, str) else ""
        tried = name[:64], caller.address
        now_s = self._clock.now_s()
        wait_s = self._limiter.wait_s(*tried, now_s=now_s)
        if wait_s > 0 or self._waiting >= MOST_WAITING:
            return LoginOutcome(wait_s=math.ceil(wait_s) or BUSY_S)
        known = self._settings.users.get(name)
        line = unmatched_line() if known is None else known.password_line
        is_text = isinstance(password, str) and len(password) <= MAX_PASSWORD_BYTES
        self._limiter.failed(*tried, now_s=now_s)  # before the check: attempts at the same time count, too
        is_right = await self._checked(str(password) if is_text else "-", line)
        is_same = self._settings.users.get(name) == known  # else a reload has changed the user meanwhile
        if not is_right or not is_text or known is None or not is_same:
            who = ("", "") if known is None else (name, known.client)
            self._note("login", "wrong_login", *who, caller)
            return LoginOutcome()
        self._limiter.succeeded(*tried)
        secret, session = self._sessions.open(
            known, is_idle_limited=self._access.may_start(known.client), now_s=self._clock.now_s()
        )
        self._note("login", "ok", known.name, known.client, caller)
        return LoginOutcome(session, secret)

    def log_out(self, session: WebSession, caller: Caller) -> None:
        """End a session."""
        self._sessions.end(session.key)
        self._note("logout", "ok", session.user, session.client, caller)

    def cookie(self, caller: Caller, secret: str) -> str:
        """Return the Set-Cookie header of a login, or of its end."""
        return set_cookie(caller, secret, base_path=self._settings.base_path)

    def as_data(self, session: WebSession | None) -> dict[str, Any]:
        """Return what the page is sent about a login, or about there being none."""
        has_logins = bool(self._settings.users)
        if session is None:
            empty = dict.fromkeys(("user", "client", "csrf", "idle_s", "ends"))
            return {**empty, "logins": has_logins}
        ends_s = self._clock.utc_s(session.ends_s()) if session.ends_s() else None
        return {
            "user": session.user,
            "client": session.client,
            "csrf": session.csrf,
            "idle_s": IDLE_S if session.is_idle_limited else None,
            "ends": rfc3339(ends_s),
            "logins": has_logins,
        }

    async def _checked(self, password: str, line: str) -> bool:
        self._waiting += 1
        try:
            async with self._one_at_a_time:
                return await asyncio.to_thread(self._check, password, line)
        finally:
            self._waiting -= 1

    def _note(self, verb: str, code: str, user: str, client: str, caller: Caller) -> None:
        self._access.note_login(verb, code, user=user, client=client, address=caller.address)
