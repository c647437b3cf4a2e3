"""No command but a start starts a motor whose starter retained a run command, even if its bits read 0.

Simulated starters keep the run command over whatever stopped the motor; nothing is known of it from readings.
"""

from __future__ import annotations

from typing import Any

import pytest

from gateway.sim.weg.ssw07 import Ssw07
from tests.rules.acting import Actor
from tests.sim.script import step

WEG = ("ssw06", "ssw07", "ssw900")
TO_REMOTE, TO_LOCAL = ("local_remote", {"value": "remote"}), ("local_remote", {"value": "local"})
RESET = ("reset", {})
BARE_RESET = {  # an SSW-06 restarts, and forgets
    "ssw07": ("coil 107 := 0", "coil 107 := 1"),
    "ssw900": ("685 := 13h", "685 := 93h"),
    "sst": ("coil 3 := 1",),
}


def disable(actor: Actor) -> None:
    actor.act("general_enable", {"value": False})


def open_enable_input(actor: Actor) -> None:
    step(actor.talk, "do set_enable_input is_on=False")


def adjust(actor: Actor) -> None:
    step(actor.talk, "P202 := 3")


def take_source_away(actor: Actor) -> None:
    """Give the commands to another source, and end the motion; what was commanded stands."""
    unit: Any = actor.unit
    step(actor.talk, "P230 := 0")
    unit.motor.cut()
    unit.command |= 0x01


def change(code: str, value: int) -> tuple[str, dict[str, Any]]:
    return "set", {"parameter": code, "value": value}


OF_SSW = [change("P220", 5), change("P229", 2), change("P230", 2)]
SOURCES = {
    "ssw06": OF_SSW,
    "ssw07": OF_SSW,
    "ssw900": [change("C3.1", 9), change("C3.2", 4), change("C3.3", 5), change("C4.1.1", 4)],
}
CASES = [  # the family, what ends the motion, what is commanded then
    *((family, Actor.trip, RESET) for family in (*WEG, "sst")),
    *((family, disable, ("general_enable", {"value": True})) for family in WEG),
    *((family, Actor.trip, TO_LOCAL, RESET, TO_REMOTE) for family in WEG),
    *((family, open_enable_input, command) for family in WEG for command in SOURCES[family]),
    *((family, open_enable_input, ("direction", {"value": "reverse"})) for family in WEG),
    *((family, take_source_away, change("P230", 2)) for family in ("ssw06", "ssw07")),
    ("ssw06", adjust, ("configure", {"leave": "P202"})),
    ("sst", Actor.trip, ("reset", {"whole": True})),
    ("sst", Actor.trip, ("configure", {})),
]


def standing(family: str) -> Actor:
    """Return a starter whose motor runs, and that keeps and hides its run command."""
    actor = Actor(family, hides_command_bits=True)
    actor.unit.quirks.keeps_run_command = True
    assert actor.act("start").end == "confirmed"
    return actor


def rest(actor: Actor) -> None:
    actor.talk.wait(60.0)
    actor.unit.starts.clear()
    actor.unit.start_frames.clear()
    assert not actor.unit.motor.is_turning


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]} {case[1].__name__} {case[2:]}")
def test_what_takes_a_hindrance_away_starts_no_motor_whose_run_command_still_stands(case: Any) -> None:
    family, end_motion, *commands = case
    actor = standing(family)
    end_motion(actor)
    rest(actor)

    for verb, args in commands:
        done = actor.act(verb, args)
        assert done.end in ("confirmed", "unchanged")
        assert "run = 0 was written first" in done.text or verb != "reset"
        actor.talk.wait(30.0)

    if done.end == "confirmed" and family != "sst":
        actor.unit.set_enable_input(is_on=True)  # type: ignore[attr-defined]  # every WEG family has it
    before_s = actor.unit.motor.standstill_s
    actor.talk.wait(30.0)
    assert not actor.unit.motor.is_turning
    assert actor.unit.motor.standstill_s >= before_s + 30.0
    assert actor.unit.start_frames == []


@pytest.mark.parametrize("family", BARE_RESET)
def test_without_run_0_these_simulated_starters_would_start(family: str) -> None:
    """The bare reset of the manual starts the motor: what the tests above are worth."""
    actor = standing(family)
    actor.trip()
    rest(actor)

    for line in BARE_RESET[family]:
        step(actor.talk, line)
    actor.talk.wait(30.0)

    assert actor.unit.motor.is_turning


class Deaf(Ssw07):
    """An SSW-07 that ignores every command of a source that is not active, a stop included (4.2.2)."""

    def _obey(self, values: int, mask: int) -> None:
        retained = self.command & 0x01
        super()._obey(values, mask)
        if not self.is_in_control:
            self.command |= retained


def test_a_run_command_that_was_deaf_to_the_first_run_0_is_taken_back_at_once() -> None:
    actor = standing("ssw07")
    unit: Any = actor.unit
    unit.__class__ = Deaf
    actor.act("stop", seen=dict(actor.rows))
    rest(actor)
    actor.act(*TO_LOCAL)
    unit.command |= 0x01

    done = actor.act(*TO_REMOTE)
    actor.talk.wait(30.0)

    assert done.end in ("confirmed", "unconfirmed")
    assert not unit.motor.is_turning
    assert "050064ff00" not in done.written  # a start
