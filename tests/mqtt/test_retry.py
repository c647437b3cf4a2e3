"""In which version of MQTT a client connects, and how soon it tries again."""

from __future__ import annotations

import pytest

from gateway.errors import BrokerError
from gateway.mqtt import BrokerSettings, Version, connected
from gateway.system.rate_limits import Backoff
from tests.mqtt.fake_broker import (
    ACCEPT_5,
    ACCEPT_311,
    HANG_UP,
    LEVEL_5,
    LEVEL_311,
    REFUSE_VERSION,
    FakeBroker,
)


def test_the_pauses_double_to_their_ceiling_and_are_short_again_after_a_connection_that_held() -> None:
    backoff = Backoff(0.5, 30.0, seed=1)

    pauses_s = [backoff.next_s() for _ in range(10)]
    backoff.reset()

    for pause_s, longest_s in zip(pauses_s, [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30], strict=True):
        assert max(0.5, 0.75 * longest_s) <= pause_s <= longest_s
    assert backoff.next_s() == 0.5


class Successive(dict[int, bytes | None]):
    """The answers to one CONNECT after the other, whatever its version."""

    def __init__(self, answers: list[bytes | None]) -> None:
        self._left = iter(answers)

    def __getitem__(self, _: int) -> bytes | None:
        return next(self._left)


SILENCE = None


@pytest.mark.parametrize(
    ("answers", "version", "levels"),
    [
        ([ACCEPT_5], None, [LEVEL_5]),
        ([REFUSE_VERSION, ACCEPT_311], None, [LEVEL_5, LEVEL_311]),
        ([HANG_UP, ACCEPT_5], None, [LEVEL_5, LEVEL_5]),
        ([HANG_UP, REFUSE_VERSION, ACCEPT_311], None, [LEVEL_5, LEVEL_5, LEVEL_311]),
        ([HANG_UP, HANG_UP, ACCEPT_311], None, [LEVEL_5, LEVEL_5, LEVEL_311]),
        ([HANG_UP, HANG_UP, HANG_UP], None, [LEVEL_5, LEVEL_5, LEVEL_311]),
        ([SILENCE], None, [LEVEL_5]),  # silence is never a refusal
        ([HANG_UP, SILENCE], None, [LEVEL_5, LEVEL_5]),
        ([REFUSE_VERSION], Version.V5, [LEVEL_5]),  # a configured version is never left
        ([HANG_UP], Version.V311, [LEVEL_311]),
    ],
)
async def test_a_broker_that_refuses_mqtt_5_and_no_other_is_asked_in_3_1_1(
    answers: list[bytes | None],
    version: Version | None,
    levels: list[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if SILENCE in answers:
        monkeypatch.setattr("gateway.mqtt.connection.session.ANSWER_S", 0.5)
    async with FakeBroker(Successive(answers)) as broker:
        settings = BrokerSettings("127.0.0.1", broker.port, "g", version=version)
        if answers[-1] in (ACCEPT_5, ACCEPT_311):
            session = await connected(settings)
            session.abort()
            assert (session.version is Version.V311) == (answers[-1] == ACCEPT_311)
        else:
            with pytest.raises(BrokerError):
                await connected(settings)

    assert broker.levels == levels
