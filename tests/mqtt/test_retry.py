from __future__ import annotations

import pytest

from gateway.mqtt.connection.reconnect import Attempts
from gateway.mqtt.connection.settings import BrokerSettings, Version
from gateway.system.rate_limits import Backoff


def attempts_of(version: Version | None) -> Attempts:
    return Attempts(BrokerSettings("broker.test", 1883, "g", version=version), seed=1)


def test_the_pauses_double_to_their_ceiling_and_are_short_again_after_a_connection_that_held() -> None:
    backoff = Backoff(0.5, 30.0, seed=1)

    pauses_s = [backoff.next_s() for _ in range(10)]
    backoff.reset()

    for pause_s, longest_s in zip(pauses_s, [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30], strict=True):
        assert max(0.5, 0.75 * longest_s) <= pause_s <= longest_s
    assert backoff.next_s() == 0.5


REFUSED, CLOSED, SILENT = (0x84, True), (None, True), (None, False)
PAUSE = None


@pytest.mark.parametrize(
    ("ends", "at_once", "version"),
    [
        ([REFUSED], [True], Version.V311),
        ([CLOSED, CLOSED, CLOSED], [True, True, False], Version.V311),  # asked once more in MQTT 5
        ([CLOSED], [True], Version.V5),
        ([SILENT, PAUSE] * 20, [False] * 20, Version.V5),  # silence is never a refusal
        ([CLOSED, SILENT, PAUSE, CLOSED], [True, False, True], Version.V5),
        ([REFUSED, PAUSE], [True], Version.V5),  # tried again at each connect
    ],
)
def test_which_version_is_tried_next_and_whether_at_once(
    ends: list[tuple[int | None, bool] | None], at_once: list[bool], version: Version
) -> None:
    attempts = attempts_of(None)
    assert attempts.version is Version.V5
    found = []
    for end in ends:
        if end is PAUSE:
            attempts.pause_s()
        else:
            found.append(attempts.is_next_at_once(end[0], is_closed=end[1]))

    assert found == at_once
    assert attempts.version is version


@pytest.mark.parametrize("version", list(Version))
def test_a_configured_version_is_never_left(version: Version) -> None:
    attempts = attempts_of(version)

    assert not attempts.is_next_at_once(0x84, is_closed=True)
    assert not attempts.is_next_at_once(None, is_closed=True)
    attempts.pause_s()
    assert attempts.version is version
