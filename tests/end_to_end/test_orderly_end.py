"""What a gateway says when it is ended in order, and how long it takes."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.end_to_end.plant import STARTERS, plant
from tests.mosquitto import StartMosquitto

MUST_END_WITHIN_S = 10.0


async def test_after_an_orderly_end_every_starter_is_offline_and_everything_stale_before_the_last_word(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, gateway, _):
        gateway.signal(signal.SIGTERM)
        code = await gateway.exit_code(within_s=MUST_END_WITHIN_S)
        await scada.until("gateway/status", state="offline")  # everything before it has been read then
        latest = scada.latest

    assert code == 0
    for starter in STARTERS:
        availability = latest[f"starter/{starter}/availability"]
        assert (availability["state"], availability["reason"]) == (
            "offline",
            "the gateway ended: ended by SIGTERM",
        )
        assert latest[f"starter/{starter}/state"]["quality"] == "stale"
    qualities = {topic: each["quality"] for topic, each in latest.items() if "/value/" in topic}
    assert len(qualities) > len(STARTERS)
    assert set(qualities.values()) <= {"stale", "bad"}


async def test_an_orderly_end_waits_for_no_broker_that_is_away(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with plant(broker, tmp_path) as (_, gateway, _):
        broker.kill()
        await gateway.says("connection lost")
        gateway.signal(signal.SIGTERM)

        assert await gateway.exit_code(within_s=MUST_END_WITHIN_S) == 0
