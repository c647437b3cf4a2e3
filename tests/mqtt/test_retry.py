from __future__ import annotations

import pytest

from gateway.mqtt.connection.reconnect import Attempts
from gateway.mqtt.connection.settings import BrokerSettings, Version
from gateway.system.rate_limits import Backoff


def attempts_of(version: Version | None) -> Attempts:
    return Attempts(BrokerSettings("broker.test", 1883, "g", version=version), seed=1)


def test_the_pauses_double_to_their_ceiling() -> None:
    backoff = Backoff(0.5, 30.0, seed=1)

    pauses_s = [backoff.next_s() for _ in range(10)]

    for pause_s, longest_s in zip(pauses_s, [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30], strict=True):
        assert max(0.5, 0.75 * longest_s) <= pause_s <= longest_s


def test_a_connection_that_held_makes_the_next_pause_short() -> None:
    backoff = Backoff(0.5, 30.0, seed=1)
    for _ in range(5):
        backoff.next_s()

    backoff.reset()

    assert backoff.next_s() == 0.5


def test_mqtt_5_is_tried_first_and_3_1_1_at_once_when_the_broker_refuses_it() -> None:
    attempts = attempts_of(None)
    first = attempts.version

    assert attempts.is_next_at_once(0x84, is_closed=True)
    assert (first, attempts.version) == (Version.V5, Version.V311)


def test_a_broker_that_closes_right_upon_mqtt_5_is_asked_once_more_before_3_1_1() -> None:
    attempts = attempts_of(None)

    versions = [(attempts.is_next_at_once(None, is_closed=True), attempts.version.value) for _ in range(3)]

    assert versions == [(True, "5"), (True, "3.1.1"), (False, "3.1.1")]


def test_silence_is_never_a_refusal_however_often() -> None:
    attempts = attempts_of(None)

    for _ in range(20):
        assert not attempts.is_next_at_once(None, is_closed=False)
        attempts.pause_s()

    assert attempts.version is Version.V5


def test_a_broker_that_closes_once_and_then_is_silent_has_refused_nothing() -> None:
    attempts = attempts_of(None)

    assert attempts.is_next_at_once(None, is_closed=True)
    assert not attempts.is_next_at_once(None, is_closed=False)
    attempts.pause_s()
    assert attempts.is_next_at_once(None, is_closed=True)
    assert attempts.version is Version.V5


def test_mqtt_5_is_tried_anew_at_each_connect() -> None:
    attempts = attempts_of(None)
    attempts.is_next_at_once(0x84, is_closed=True)

    attempts.pause_s()

    assert attempts.version is Version.V5


@pytest.mark.parametrize("version", list(Version))
def test_a_configured_version_is_never_left(version: Version) -> None:
    attempts = attempts_of(version)

    assert not attempts.is_next_at_once(0x84, is_closed=True)
    assert not attempts.is_next_at_once(None, is_closed=True)
    attempts.pause_s()
    assert attempts.version is version
