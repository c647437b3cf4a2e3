"""What a gateway says when it is ended in order, and how long it takes."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.end_to_end.plant import plant
from tests.mosquitto import StartMosquitto

MUST_END_WITHIN_S = 10.0


async def test_an_orderly_end_waits_for_no_broker_that_is_away(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with plant(broker, tmp_path) as (_, gateway, _):
        broker.kill()
        await gateway.says("connection lost")
        gateway.signal(signal.SIGTERM)

        assert await gateway.exit_code(within_s=MUST_END_WITHIN_S) == 0
