"""What the rig itself promises: the same scenario says the same, to the byte."""

from __future__ import annotations

from tests.rig import RigPlant
from tests.rig.sites import ALICE, FOUR, HOME_ASSISTANT, SPARKPLUG, WEB


def test_the_same_scenario_gives_the_same_bytes() -> None:
    def day() -> str:
        with RigPlant(FOUR + ALICE + SPARKPLUG + HOME_ASSISTANT + WEB) as plant:
            plant.run(until=5.0)
            plant.command("pump/alice/start")
            plant.run(until=8.0)
            plant.broker.drop()
            plant.lines["pumps"].garble("fan", for_s=2.0)
            plant.run(until=30.0)
            plant.restart()
            plant.run(until=40.0)
            plant.end()
            return plant.transcript()

    day()  # what a process makes once takes a part of the first day's chance

    assert day() == day()
