"""STATE messages of the primary host application."""

from __future__ import annotations

import pytest

from gateway.plugins.sparkplug.primary_host import PrimaryHost, host_state
from tests.sparkplug.support import host_says


def host() -> PrimaryHost:
    made = PrimaryHost("scada")
    made.begin()
    return made


def test_the_state_of_exactly_the_configured_host_is_asked_for() -> None:
    assert host().topic == "spBv1.0/STATE/scada"


def test_a_host_is_online_once_it_says_so_with_a_time_that_is_not_before_the_last() -> None:
    waits = host()
    assert not waits.is_online
    waits.take(host_says(False, 1000))
    waits.take(host_says(True, 999))
    assert not waits.is_online

    waits.take(host_says(True, 1000))

    assert waits.is_online


def test_a_host_that_goes_ends_the_connection_unless_its_message_is_old() -> None:
    waits = host()
    waits.take(host_says(True, 1000))

    assert not waits.take(host_says(False, 999))
    assert waits.is_online
    assert waits.take(host_says(False, 1000))
    assert not waits.is_online


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"ONLINE",
        b"[]",
        b"\xff",
        b'{"online": true}',
        b'{"online": "true", "timestamp": 1}',
        b'{"online": true, "timestamp": true}',
        b'{"online": true, "timestamp": "1"}',
        b"[" * 100_000,
    ],
)
def test_what_is_no_state_message_is_ignored(payload: bytes) -> None:
    waits = host()

    assert host_state(payload) is None
    assert not waits.take(payload)
    assert not waits.is_online
