"""Whom a request calls and where it comes from."""

from __future__ import annotations

import json
from dataclasses import replace
from urllib.parse import unquote

import pytest

from gateway.plugins.web.plugin import WebSettings
from gateway.plugins.web.requests import (
    Caller,
    WebError,
    caller_of,
    cookie,
    is_own_host,
    path_in,
    require_own_post,
    set_cookie,
    takes_gzip,
)
from tests.web.support import web_settings

LOOPBACK = web_settings()
PLANT = web_settings(host="0.0.0.0", hosts=("mcc1.plant",), trusted_proxies=("10.0.0.0/8",))
PAGE = Caller("127.0.0.1", "mcc1.plant:8480", "http")


@pytest.mark.parametrize(
    ("settings", "host", "is_own"),
    [
        (LOOPBACK, "127.0.0.1:8480", True),
        (LOOPBACK, "127.0.0.1", True),
        (LOOPBACK, "localhost:8480", True),
        (LOOPBACK, "LOCALHOST.:8480", True),
        (LOOPBACK, "evil.example:8480", False),
        (LOOPBACK, "127.0.0.1.evil.example", False),
        (LOOPBACK, "127.0.0.2", False),
        (LOOPBACK, "", False),
        (LOOPBACK, "a@127.0.0.1", False),
        (LOOPBACK, "127.0.0.1,evil.example", False),
        (LOOPBACK, "127.0.0.1:99999999", False),
        (LOOPBACK, "[::1", False),
        (PLANT, "mcc1.plant", True),
        (PLANT, "MCC1.plant:443", True),
        (PLANT, "127.0.0.1:8480", True),  # the address of this connection
        (PLANT, "192.0.2.9", False),
        (PLANT, "other.plant", False),
    ],
)
def test_the_page_answers_to_its_own_names_only(settings: WebSettings, host: str, is_own: bool) -> None:
    assert is_own_host(settings, host, local="127.0.0.1") is is_own


def test_an_address_of_version_6_is_compared_in_its_usual_form() -> None:
    assert is_own_host(web_settings(host="::1"), "[0:0::1]:8480", local="::1")
    assert is_own_host(web_settings(host="::"), "192.0.2.1", local="::ffff:192.0.2.1")


OWN = {
    "origin": "http://mcc1.plant:8480",
    "sec-fetch-site": "same-origin",
    "content-type": "application/json",
    "x-csrf-token": "t0ken",
}


@pytest.mark.parametrize(
    ("headers", "refusal"),
    [
        ({}, ""),
        ({"sec-fetch-site": None}, ""),  # of an old browser
        ({"content-type": "application/json; charset=utf-8"}, ""),
        ({"origin": None}, "cross_site"),
        ({"origin": "http://evil.example"}, "cross_site"),
        ({"origin": "https://mcc1.plant:8480"}, "cross_site"),
        ({"origin": "http://mcc1.plant"}, "cross_site"),
        ({"origin": "null"}, "cross_site"),
        ({"sec-fetch-site": "cross-site"}, "cross_site"),
        ({"sec-fetch-site": "same-site"}, "cross_site"),
        ({"sec-fetch-site": "none"}, "cross_site"),
        ({"content-type": None}, "no_json"),
        ({"content-type": "text/plain"}, "no_json"),
        ({"content-type": "application/x-www-form-urlencoded"}, "no_json"),
        ({"content-type": "multipart/form-data"}, "no_json"),
        ({"x-csrf-token": None}, "csrf"),
        ({"x-csrf-token": "guess"}, "csrf"),
    ],
)
def test_what_changes_something_must_come_from_the_page_itself(
    headers: dict[str, str | None], refusal: str
) -> None:
    given = {name: value for name, value in {**OWN, **headers}.items() if value is not None}
    assert refusal_of(Caller("127.0.0.1", "mcc1.plant:8480", "http", given), "t0ken") == refusal


def test_without_a_session_nothing_but_a_login_is_done() -> None:
    caller = replace(PAGE, headers={**OWN, "x-csrf-token": ""})

    assert refusal_of(caller, "") == "login"
    assert refusal_of(caller, None) == ""
    assert refusal_of(replace(caller, headers={}), None) == "cross_site"


def refusal_of(caller: Caller, csrf: str | None) -> str:
    try:
        require_own_post(caller, csrf)
    except WebError as error:
        return str(json.loads(error.body)["error"])
    return ""


@pytest.mark.parametrize(
    ("base", "raw", "path"),
    [
        ("/", "/api/v1/command/pump/stop", "/api/v1/command/pump/stop"),
        ("/", "/api/v1/command/p%75mp/stop", "/api/v1/command/pump/stop"),
        ("/", "/api/v1/command/p%2575mp/stop", "/api/v1/command/p%75mp/stop"),  # once, not twice
        ("/", "/api/v1/command/pump%2fstop", None),
        ("/", "/api/v1/command/pump%2Fstop", None),
        ("/motors/", "/motors/health", "/health"),
        ("/motors/", "/motors/", "/"),
        ("/motors/", "/motors", None),  # sent on to the one with a slash
        ("/motors/", "/health", "/health"),
        ("/motors/", "/motorshealth", "/motorshealth"),
    ],
)
def test_a_path_is_unquoted_once_and_counts_below_the_base_path(
    base: str, raw: str, path: str | None
) -> None:
    settings = web_settings(base_path=base)
    if path is None:
        with pytest.raises(WebError):
            path_in(settings, unquote(raw), raw=raw.encode())
    else:
        assert path_in(settings, unquote(raw), raw=raw.encode()) == path


def test_a_proxy_is_believed_only_when_it_is_named() -> None:
    headers = {
        "host": "gateway:8480",
        "x-forwarded-for": "203.0.113.9, 10.1.1.1",
        "x-forwarded-proto": "https",
        "x-forwarded-host": "mcc1.plant",
    }

    believed = caller_of(PLANT, headers, peer="10.0.0.5", scheme="http")
    unnamed = caller_of(PLANT, headers, peer="192.0.2.5", scheme="http")
    none_configured = caller_of(LOOPBACK, headers, peer="127.0.0.1", scheme="http")

    assert believed == Caller("203.0.113.9", "mcc1.plant", "https")
    assert unnamed == Caller("192.0.2.5", "gateway:8480", "http")
    assert none_configured == Caller("127.0.0.1", "gateway:8480", "http")


def test_the_cookie_is_http_only_and_strict_and_with_tls_bound_to_the_host() -> None:
    plain = set_cookie(PAGE, "s3cret", base_path="/mcc1/")
    secure = set_cookie(Caller("1.2.3.4", "mcc1.plant", "https"), "s3cret", base_path="/mcc1/")

    assert plain == "sid=s3cret; Path=/mcc1/; HttpOnly; SameSite=Strict"
    assert secure == "__Host-sid=s3cret; Path=/; HttpOnly; SameSite=Strict; Secure"
    assert set_cookie(PAGE, "", base_path="/").endswith("; Max-Age=0")


def test_a_cookie_that_is_there_twice_counts_for_none() -> None:
    for header, value in (
        ("a=1; sid=x; b=2", "x"),
        ("sid=x; sid=y", ""),
        ("sid=x,sid=y", ""),
        ("", ""),
    ):
        assert cookie(replace(PAGE, headers={"cookie": header})) == value


@pytest.mark.parametrize(
    ("accepted", "is_taken"),
    [
        ("gzip, deflate, br", True),
        ("GZIP", True),
        ("gzip;q=0.001", True),
        ("gzip;q=0", False),
        ("gzip ; q=0.000", False),
        ("gzip;q=0, *", False),
        ("identity", False),
        ("gzipped", False),
        ("", False),
    ],
)
def test_gzip_is_sent_to_those_alone_that_take_it(accepted: str, is_taken: bool) -> None:
    assert takes_gzip(accepted) is is_taken
