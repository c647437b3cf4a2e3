"""No command but a start starts a motor whose starter retained a run command, even if its bits read 0.

Simulated starters keep the run command over whatever stopped the motor; nothing is known of it from readings.
"""

from __future__ import annotations

from typing import Any

import pytest

from gateway.modbus.writes import WriteCoil, WriteRegister
from gateway.sim.sst.unit import Sst
from gateway.sim.weg.common import REMOTE_SOURCE
from gateway.sim.weg.ssw07 import Ssw07
from tests.rules.acting import RAW_START, Actor

WEG = ("ssw06", "ssw07", "ssw900")
ON = {"value": True}
TO_REMOTE, TO_LOCAL = {"value": "remote"}, {"value": "local"}
SOURCES = {
    "ssw06": [("P220", 5), ("P229", 2), ("P230", 2)],
    "ssw07": [("P220", 5), ("P229", 2), ("P230", 2)],
    "ssw900": [("C3.1", 9), ("C3.2", 4), ("C3.3", 5), ("C4.1.1", 4)],
}
BARE_RESET = {
    "ssw07": (WriteCoil(107, is_on=False), WriteCoil(107, is_on=True)),
    "ssw900": (WriteRegister(685, 0x0013), WriteRegister(685, 0x0093)),
    "sst": (WriteCoil(2, is_on=True),),
}


def standing(family: str, **options: Any) -> Actor:
    """Return a starter whose motor runs, and that keeps and hides its run command."""
    actor = Actor(family, keeps_run_command=True, hides_command_bits=True, **options)
    assert actor.act("start").end == "confirmed"
    return actor


def rest(actor: Actor) -> None:
    actor.talk.wait(60.0)
    actor.unit.starts.clear()
    actor.unit.start_frames.clear()
    assert not actor.unit.motor.is_turning


def assert_standing_still(actor: Actor) -> None:
    """Nothing turned since `rest`: not now, not a while later."""
    before_s = actor.unit.motor.standstill_s
    actor.talk.wait(30.0)
    assert not actor.unit.motor.is_turning
    assert actor.unit.motor.standstill_s >= before_s + 30.0
    assert actor.unit.start_frames == []


@pytest.mark.parametrize("family", WEG)
def test_a_reset_after_a_fault_starts_nothing(family: str) -> None:
    actor = standing(family)
    actor.unit.trip(3)
    rest(actor)

    done = actor.act("reset")

    assert done.end == "confirmed"
    assert "run = 0 was written first" in done.text
    assert_standing_still(actor)


@pytest.mark.parametrize("family", WEG)
def test_a_general_enable_after_a_general_disable_starts_nothing(family: str) -> None:
    actor = standing(family)
    actor.act("general_enable", {"value": False})
    rest(actor)

    assert actor.act("general_enable", ON).end == "confirmed"
    assert_standing_still(actor)


@pytest.mark.parametrize("family", WEG)
def test_a_time_in_local_and_the_way_back_start_nothing(family: str) -> None:
    actor = standing(family)
    actor.unit.trip(3)
    rest(actor)

    assert actor.act("local_remote", TO_LOCAL).end == "confirmed"
    assert actor.act("reset").end == "confirmed"
    actor.talk.wait(30.0)
    assert actor.act("local_remote", TO_REMOTE).end == "confirmed"
    assert_standing_still(actor)


@pytest.mark.parametrize(("family", "code", "value"), [(f, c, v) for f in WEG for c, v in SOURCES[f]])
def test_another_command_source_starts_nothing(family: str, code: str, value: int) -> None:
    actor = standing(family)
    actor.unit.set_enable_input(is_on=False)
    rest(actor)

    done = actor.act("set", {"parameter": code, "value": value})
    actor.unit.set_enable_input(is_on=True)

    assert done.end in ("confirmed", "unchanged")
    if done.end == "confirmed":
        assert_standing_still(actor)


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_serial_as_the_source_again_starts_nothing(family: str) -> None:
    actor = standing(family)
    unit = actor.unit
    actor.talk.ask(WriteRegister(REMOTE_SOURCE, 0))
    unit.motor.cut()
    rest(actor)
    unit.command |= 0x01  # what was given stands

    assert actor.act("set", {"parameter": "P230", "value": 2}).end == "confirmed"
    assert_standing_still(actor)


@pytest.mark.parametrize("family", WEG)
def test_a_change_of_the_direction_at_standstill_starts_nothing(family: str) -> None:
    actor = standing(family)
    actor.unit.set_enable_input(is_on=False)
    rest(actor)

    assert actor.act("direction", {"value": "reverse"}).end == "confirmed"
    actor.unit.set_enable_input(is_on=True)
    assert_standing_still(actor)


def test_the_way_out_of_an_adjusting_mode_starts_nothing() -> None:
    actor = standing("ssw06")
    actor.talk.ask(WriteRegister(202, 3))
    rest(actor)

    assert actor.act("configure", {"leave": "P202"}).end == "confirmed"
    assert_standing_still(actor)


@pytest.mark.parametrize(("verb", "args"), [("reset", {}), ("reset", {"whole": True}), ("configure", {})])
def test_an_sst_is_reset_and_initialised_without_a_start(verb: str, args: dict[str, Any]) -> None:
    actor = Actor("sst", hides_command_bits=True)
    unit = actor.unit
    assert isinstance(unit, Sst)
    unit.quirks.keeps_run_command = True
    assert actor.act("start").end == "confirmed"
    unit.trip(12)
    rest(actor)
    assert unit.is_start_set

    done = actor.act(verb, args)

    assert done.end == "confirmed"
    assert "run = 0 was written first" in done.text
    assert_standing_still(actor)


@pytest.mark.parametrize("family", ["ssw07", "ssw900", "sst"])  # an SSW-06 restarts, and forgets
def test_without_run_0_these_simulated_starters_would_start(family: str) -> None:
    """The bare reset of the manual starts the motor: what the tests above are worth."""
    actor = Actor(family, hides_command_bits=True)
    actor.unit.quirks.keeps_run_command = True
    actor.act("start")
    actor.unit.trip(12)
    rest(actor)

    for request in BARE_RESET[family]:
        actor.talk.ask(request)
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
    actor = Actor("ssw07", keeps_run_command=True, hides_command_bits=True)
    actor.act("start")
    unit = actor.unit
    unit.__class__ = Deaf
    actor.act("stop", seen=dict(actor.rows))
    rest(actor)
    actor.act("local_remote", TO_LOCAL)
    unit.command |= 0x01

    done = actor.act("local_remote", TO_REMOTE)
    actor.talk.wait(30.0)

    assert done.end in ("confirmed", "unconfirmed")
    assert not unit.motor.is_turning
    assert RAW_START["ssw07"].encode().hex() not in done.written
