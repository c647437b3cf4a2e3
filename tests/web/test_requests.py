"""Whom a request calls and where it comes from."""

from __future__ import annotations

import pytest

from gateway.plugins.web.interface import WebSettings
from gateway.plugins.web.requests import (
    Caller,
    caller_of,
    cookie,
    cross_site,
    is_json,
    is_own_host,
    security_headers,
    set_cookie,
    takes_gzip,
)

LOOPBACK = WebSettings()
PLANT = WebSettings(host="0.0.0.0", hosts=("mcc1.plant",), trusted_proxies=("10.0.0.0/8",))
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
    assert is_own_host(WebSettings(host="::1"), "[0:0::1]:8480", local="::1")
    assert is_own_host(WebSettings(host="::"), "192.0.2.1", local="::ffff:192.0.2.1")


@pytest.mark.parametrize(
    ("headers", "is_allowed"),
    [
        ({"origin": "http://mcc1.plant:8480", "sec-fetch-site": "same-origin"}, True),
        ({"origin": "http://mcc1.plant:8480"}, True),
        ({}, False),
        ({"sec-fetch-site": "same-origin"}, False),
        ({"origin": "http://evil.example"}, False),
        ({"origin": "https://mcc1.plant:8480"}, False),
        ({"origin": "http://mcc1.plant"}, False),
        ({"origin": "null"}, False),
        ({"sec-fetch-site": "cross-site"}, False),
        ({"sec-fetch-site": "same-site", "origin": "http://mcc1.plant:8480"}, False),
        ({"sec-fetch-site": "none"}, False),
    ],
)
def test_what_changes_something_must_come_from_the_page_itself(
    headers: dict[str, str], is_allowed: bool
) -> None:
    assert (cross_site(headers, PAGE) == "") is is_allowed


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
    assert cookie({"cookie": "a=1; sid=x; b=2"}, "sid") == "x"
    assert cookie({"cookie": "sid=x; sid=y"}, "sid") == ""
    assert cookie({"cookie": "sid=x,sid=y"}, "sid") == ""
    assert cookie({}, "sid") == ""


def test_no_form_of_another_page_can_be_json() -> None:
    assert is_json({"content-type": "application/json; charset=utf-8"})
    for form in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
        assert not is_json({"content-type": form})


def test_hsts_is_said_with_tls_only() -> None:
    assert b"strict-transport-security" not in dict(security_headers(PAGE))
    assert b"strict-transport-security" in dict(security_headers(Caller("", "", "https")))
    policy = dict(security_headers(None))[b"content-security-policy"].decode()
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize(
    ("accepted", "is_taken"),
    [
        ("gzip, deflate, br", True),
        ("GZIP", True),
        ("gzip;q=0.001", True),
        ("*", True),
        ("br;q=1.0, *;q=0.5", True),
        ("x-gzip", True),
        ("gzip;q=0", False),
        ("gzip ; q=0.000", False),
        ("gzip;q=0, *", False),
        ("*;q=0", False),
        ("identity", False),
        ("gzipped", False),
        ("", False),
        ("gzip;q=much", False),
    ],
)
def test_gzip_is_sent_to_those_alone_that_take_it(accepted: str, is_taken: bool) -> None:
    assert takes_gzip(accepted) is is_taken
