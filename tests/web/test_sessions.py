"""Sessions and the waits after wrong passwords."""

from __future__ import annotations

import hashlib
import itertools
from typing import Any

from gateway.plugins.web.accounts import (
    FREE_FAILURES,
    FREE_OF_ONE,
    IDLE_S,
    LONGEST_OF_ONE_S,
    LONGEST_S,
    LONGEST_WAIT_S,
    MOST_SESSIONS,
    LoginLimiter,
    WebSession,
)
from gateway.plugins.web.plugin import WebUser
from gateway.plugins.web.requests import Caller
from tests.web.support import USER, PageRig, web_settings

OF_ALL = {"anna": USER, "bert": WebUser("bert", "bob", "line-of-anna")}


def caller(secret: str = "") -> Caller:
    return Caller("127.0.0.1", "localhost", "http", {"cookie": f"sid={secret}"})


async def logged_in(rig: PageRig, user: str = "anna") -> tuple[str, WebSession]:
    return await rig.accounts.log_in(user, "right", caller())


def is_known(rig: PageRig, secret: str, **how: Any) -> bool:
    return rig.accounts.session(caller(secret), **how) is not None


async def test_a_session_is_found_by_its_secret_which_is_not_stored() -> None:
    rig = PageRig()

    secret, session = await logged_in(rig)

    assert rig.accounts.session(caller(secret)) is session
    assert session.key == hashlib.sha256(secret.encode()).hexdigest()
    assert secret not in repr(vars(rig.accounts))
    assert not is_known(rig, secret + "x")
    assert session.csrf != secret


async def test_who_may_start_a_motor_is_logged_out_after_half_an_hour_without_use() -> None:
    rig = PageRig(web_settings(users=OF_ALL))
    (secret, _), (other, _) = await logged_in(rig), await logged_in(rig, "bert")

    rig.clock.s += IDLE_S - 1
    assert is_known(rig, secret)
    rig.clock.s += IDLE_S - 1
    assert is_known(rig, secret, is_use=False)  # a stream is no use
    rig.clock.s += 2
    assert not is_known(rig, secret)
    rig.clock.s += LONGEST_S - 2 * IDLE_S - 1
    assert is_known(rig, other)
    rig.clock.s += 2
    assert not is_known(rig, other)


async def test_a_user_that_is_removed_or_has_another_password_or_operator_is_logged_out() -> None:
    for changed in (
        {},
        {"anna": WebUser("anna", "alice", "other")},
        {"anna": WebUser("anna", "bob", "line-of-anna")},
    ):
        rig = PageRig()
        secret, _ = await logged_in(rig)

        rig.accounts.reconfigure(web_settings("another"))
        assert is_known(rig, secret)
        rig.accounts.reconfigure(web_settings(users=changed))
        assert not is_known(rig, secret)


async def test_of_too_many_sessions_the_one_used_longest_ago_ends() -> None:
    rig = PageRig()
    first, second, *_ = [(await logged_in(rig))[0] for _ in range(MOST_SESSIONS)]
    assert is_known(rig, first)

    await logged_in(rig)

    assert is_known(rig, first)
    assert not is_known(rig, second)


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
