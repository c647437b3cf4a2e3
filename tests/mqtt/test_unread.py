"""Whether the broker has sent something that nobody has dealt with yet."""

from __future__ import annotations

import socket

import pytest

from gateway.mqtt.connection.unread import Unread


def test_what_waits_in_the_socket_is_unread_until_it_is_read() -> None:
    unread = Unread()
    ours, theirs = socket.socketpair()
    with ours, theirs:
        unread.watch(ours.fileno())
        assert not unread()

        theirs.send(b"stop")
        assert unread()

        ours.recv(100)
        assert not unread()


def test_what_is_being_read_is_unread_until_it_has_been_dealt_with() -> None:
    unread = Unread()
    unread.begin()
    assert unread()
    unread.end()
    assert not unread()


@pytest.mark.parametrize("is_told", [True, False])
def test_a_socket_that_is_closed_has_nothing_unread(is_told: bool) -> None:
    unread = Unread()
    ours, theirs = socket.socketpair()
    unread.watch(ours.fileno())
    theirs.send(b"stop")
    if is_told:
        unread.forget()
    ours.close()
    theirs.close()
    assert not unread()
