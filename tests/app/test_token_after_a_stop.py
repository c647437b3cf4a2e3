"""A stop makes the tokens of before useless for a start, so a new one is published with it."""

from __future__ import annotations

import asyncio
from pathlib import Path

from gateway.app.site import Site
from gateway.app.uplink import RENEWED_EVERY_S, Uplink
from gateway.config.load import parse
from gateway.mqtt.contract.freshness import RunToken, Tokens
from tests.config.sites import SITE
from tests.starters.plant import Plant
from tests.starters.rig import virtually
from tests.virtual_time import VirtualClock


class Beats:
    """A connection of which only its pulse is there."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self.times: list[float] = []

    def beat(self) -> None:
        self.times.append(self._clock.now_s())


def uplink(clock: VirtualClock, folder: Path) -> tuple[Uplink, Beats]:
    up = Uplink(
        Site(parse(SITE, "site.toml"), folder, None, ()),
        Tokens(RunToken("run")),
        clock=clock,
        publish_event=lambda *_: None,
    )
    beats = Beats(clock)
    up._connection = beats  # type: ignore[assignment]  # nothing else of it is used
    return up, beats


def test_a_stop_has_a_token_published_at_once_and_a_flood_of_stops_a_few_a_second(tmp_path: Path) -> None:
    @virtually
    async def scenario() -> None:
        clock = VirtualClock(asyncio.get_running_loop())
        up, beats = uplink(clock, tmp_path)

        up.renew_token()
        assert beats.times == [clock.now_s()]
        for _ in range(1000):
            await asyncio.sleep(0.001)
            up.renew_token()
        last_s = clock.now_s()
        await asyncio.sleep(1.0)

        assert len(beats.times) <= 2 + 1.0 / RENEWED_EVERY_S
        assert last_s <= beats.times[-1] <= last_s + RENEWED_EVERY_S

    scenario()


@virtually
async def test_every_stop_is_followed_by_the_call_that_has_a_token_published() -> None:
    plant = await Plant().online()
    frames: list[int] = []
    plant.dispatcher._on_stop = lambda: frames.append(plant.stops())

    plant.submit("stop", "1")
    plant.submit("stop", "1")  # a repetition, which gets a frame too
    plant.submit("stop", "2", starter="pump-2", client="carol")  # who may not
    await plant.wait(3.0)

    assert len(frames) == 2
