"""STATE messages of the primary host application."""

from __future__ import annotations

import pytest

from gateway.plugins.sparkplug.primary_host import PrimaryHost, host_state
from tests.sparkplug.support import host_says


@pytest.mark.parametrize(
    ("said", "has_gone", "is_online"),
    [
        ([], False, False),
        ([(False, 1000), (True, 999)], False, False),  # what is older than the last is ignored
        ([(False, 1000), (True, 1000)], False, True),
        ([(True, 1000), (False, 999)], False, True),
        ([(True, 1000), (False, 1000)], True, False),  # the connection is to end
    ],
)
def test_a_host_is_as_its_newest_message_says(
    said: list[tuple[bool, int]], *, has_gone: bool, is_online: bool
) -> None:
    host = PrimaryHost("scada")
    host.begin()

    ends = [host.take(host_says(*each)) for each in said]

    assert (any(ends), host.is_online) == (has_gone, is_online)


@pytest.mark.parametrize(
    "payload",
    [
        *(b"", b"ONLINE", b"[]", b"\xff", b'{"online": true}', b"[" * 100_000),
        b'{"online": "true", "timestamp": 1}',
        b'{"online": true, "timestamp": true}',
        b'{"online": true, "timestamp": "1"}',
    ],
)
def test_what_is_no_state_message_says_nothing(payload: bytes) -> None:
    assert host_state(payload) is None
