"""Sessions and the waits after wrong passwords."""

from __future__ import annotations

import hashlib
import itertools

from gateway.plugins.web.accounts import (
    FREE_FAILURES,
    FREE_OF_ONE,
    IDLE_S,
    LONGEST_OF_ONE_S,
    LONGEST_S,
    LONGEST_WAIT_S,
    MOST_SESSIONS,
    LoginLimiter,
    Sessions,
)
from gateway.plugins.web.plugin import WebUser

USER = WebUser("anna", "alice", "line")


def test_a_session_is_found_by_its_secret_which_is_not_stored() -> None:
    sessions = Sessions()

    secret, session = sessions.open(USER, is_idle_limited=True, now_s=0.0)

    assert sessions.find(secret, now_s=1.0) is session
    assert session.key == hashlib.sha256(secret.encode()).hexdigest()
    assert secret not in repr(vars(sessions))
    assert sessions.find(secret + "x", now_s=1.0) is None
    assert session.csrf != secret


def test_who_may_start_a_motor_is_logged_out_after_half_an_hour_without_use() -> None:
    sessions = Sessions()
    secret, _ = sessions.open(USER, is_idle_limited=True, now_s=0.0)
    other, _ = sessions.open(USER, is_idle_limited=False, now_s=0.0)

    assert sessions.find(secret, now_s=IDLE_S - 1) is not None
    assert sessions.find(secret, now_s=2 * IDLE_S - 2, is_use=False) is not None  # a stream is no use
    assert sessions.find(secret, now_s=2 * IDLE_S) is None
    assert sessions.find(other, now_s=LONGEST_S - 1) is not None
    assert sessions.find(other, now_s=LONGEST_S + 1) is None


def test_a_user_that_is_removed_or_has_another_password_or_operator_is_logged_out() -> None:
    for changed in (
        {},
        {"anna": WebUser("anna", "alice", "other")},
        {"anna": WebUser("anna", "bob", "line")},
    ):
        sessions = Sessions()
        secret, _ = sessions.open(USER, is_idle_limited=True, now_s=0.0)

        sessions.keep_users({"anna": USER})
        assert sessions.find(secret, now_s=1.0) is not None
        sessions.keep_users(changed)
        assert sessions.find(secret, now_s=1.0) is None


def test_of_too_many_sessions_the_one_used_longest_ago_ends() -> None:
    sessions = Sessions()
    secrets = [sessions.open(USER, is_idle_limited=False, now_s=0.0)[0] for _ in range(MOST_SESSIONS)]
    sessions.find(secrets[0], now_s=1.0)

    sessions.open(USER, is_idle_limited=False, now_s=2.0)

    assert sessions.find(secrets[0], now_s=3.0) is not None
    assert sessions.find(secrets[1], now_s=3.0) is None


def failed(limiter: LoginLimiter, times: int, *of: tuple[str, str]) -> list[float]:
    """Fail so often at the same moment; return the wait after each failure."""
    waits_s = []
    for user, address in itertools.islice(itertools.cycle(of), times):
        limiter.failed(user, address, now_s=0.0)
        waits_s.append(limiter.wait_s(user, address, now_s=0.0))
    return waits_s


def test_wrong_passwords_wait_twice_as_long_each_time_after_the_fifth() -> None:
    limiter = LoginLimiter()

    waits_s = failed(limiter, FREE_FAILURES + 12, ("anna", "x"))

    assert waits_s[: FREE_FAILURES - 1] == [0.0] * (FREE_FAILURES - 1)
    assert waits_s[FREE_FAILURES - 1 :][:4] == [1.0, 2.0, 4.0, 8.0]
    assert waits_s[-1] == LONGEST_WAIT_S
    assert limiter.wait_s("bert", "x", now_s=0.0) == 0.0
    assert limiter.wait_s("anna", "y", now_s=0.0) == 0.0


def test_a_login_tried_from_everywhere_and_an_address_that_tries_everything_wait_a_moment() -> None:
    from_everywhere, of_everybody = LoginLimiter(), LoginLimiter()

    failed(from_everywhere, 200, *(("anna", f"x{n}") for n in range(200)))
    failed(of_everybody, 200, *((f"u{n}", "x") for n in range(200)))

    for limiter in (from_everywhere, of_everybody):
        assert limiter.wait_s("anna", "x", now_s=0.0) == LONGEST_OF_ONE_S
        assert limiter.wait_s("bert", "y", now_s=0.0) == 0.0
    assert failed(LoginLimiter(), FREE_OF_ONE - 1, *(("anna", f"x{n}") for n in range(20)))[-1] == 0.0
