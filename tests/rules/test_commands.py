"""Every verb of every family, carried out on the simulated starter by the requests that the gateway sends."""

from __future__ import annotations

import re
from typing import Any

import pytest

from gateway.errors import CommandError
from gateway.families.command.build import build
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.writes import WriteRegister
from gateway.sim.core.power import MotorState
from gateway.sim.sst.unit import Sst
from gateway.sim.ssw900.unit import Ssw900
from gateway.sim.weg.command_sources import OUTPUT_BY_SERIAL
from gateway.sim.weg.ssw06 import Ssw06
from tests.rules.acting import Actor

WEG = ("ssw06", "ssw07", "ssw900")
ON, OFF = {"value": True}, {"value": False}


@pytest.mark.parametrize("family", WEG)
def test_a_jog_runs_the_motor_until_it_is_taken_back(family: str) -> None:
    actor = Actor(family)

    assert actor.act("jog", ON).end == "confirmed"
    assert actor.unit.motor.state is MotorState.JOG

    assert actor.act("jog", OFF).end == "confirmed"
    assert actor.unit.motor.state is not MotorState.JOG


@pytest.mark.parametrize("family", WEG)
def test_a_stop_ends_a_jog_even_if_the_last_reading_did_not_show_it(family: str) -> None:
    actor = Actor(family)
    actor.act("start")
    actor.act("stop", seen=dict(actor.rows))
    actor.talk.wait(30.0)
    before = dict(actor.rows)
    actor.act("jog", ON)

    first = actor.act("stop", seen=before)
    second = actor.act("stop", seen=dict(actor.rows))

    assert (first.end, second.end) == ("unconfirmed" if family != "ssw900" else "confirmed", "confirmed")
    assert actor.unit.motor.state is not MotorState.JOG


@pytest.mark.parametrize("family", WEG)
@pytest.mark.parametrize("verb", ["start", "jog"])
def test_a_motor_that_jogs_is_neither_started_nor_jogged_again(family: str, verb: str) -> None:
    actor = Actor(family)
    actor.act("jog", ON)

    assert actor.act(verb, ON if verb == "jog" else {}).end == "motor_running"


@pytest.mark.parametrize("family", WEG)
def test_the_direction_changes_at_standstill_and_not_while_the_motor_runs(family: str) -> None:
    actor = Actor(family)

    assert actor.act("direction", {"value": "reverse"}).end == "confirmed"
    assert actor.act("start").end == "confirmed"
    assert actor.act("direction", {"value": "forward"}).end == "motor_running"

    points = actor.points(actor.rows)
    assert points["reverse"] is True


@pytest.mark.parametrize("family", WEG)
def test_local_and_remote_are_switched_and_in_local_nothing_starts(family: str) -> None:
    actor = Actor(family)

    assert actor.act("local_remote", {"value": "local"}).end == "confirmed"
    assert actor.act("start").end == "in_local"
    assert actor.act("local_remote", {"value": "remote"}).end == "confirmed"
    assert actor.act("start").end == "confirmed"


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_a_run_command_that_stands_does_not_start_the_motor_when_it_becomes_remote(family: str) -> None:
    actor = Actor(family, keeps_run_command=True)
    actor.act("start")
    actor.unit.trip(3)
    actor.talk.wait(30.0)
    actor.act("local_remote", {"value": "local"})

    assert actor.act("reset").end == "confirmed"
    actor.talk.wait(10.0)
    assert actor.act("local_remote", {"value": "remote"}).end == "confirmed"

    assert not actor.unit.motor.is_turned_on


def test_relays_and_analog_outputs_of_an_ssw06_follow() -> None:
    settings = dict.fromkeys((251, 253, 277, 278, 279), OUTPUT_BY_SERIAL)
    actor = Actor("ssw06", settings={**settings, 252: 1000, 254: 1000})
    unit = actor.unit
    assert isinstance(unit, Ssw06)

    ends = [
        actor.act("output", {"output": name, "value": value}).end
        for name, value in (("RL1", True), ("RL3", True), ("RL1", False), ("AO1", 50), ("AO2", 25))
    ]

    assert ends == ["confirmed"] * 5
    assert unit.relays == 0b100
    assert unit.analog_pct == pytest.approx((50.0, 25.0), abs=0.01)


def test_an_output_that_is_not_set_to_serial_is_not_confirmed() -> None:
    done = Actor("ssw07").act("output", {"output": "RL1", "value": True})

    assert done.end == "unconfirmed"
    assert "P277" in done.text


def test_digital_outputs_of_an_ssw900_change_bit_by_bit() -> None:
    actor = Actor("ssw900", settings={275: 12, 276: 12, 277: 12, 251: 9})
    unit = actor.unit
    assert isinstance(unit, Ssw900)

    for name, value in (("DO1", True), ("DO2", True), ("DO1", False), ("AO1", 50)):
        assert actor.act("output", {"output": name, "value": value}).end == "confirmed"

    assert (unit.setting(695), unit.setting(696)) == (0b010, 511)
    assert actor.act("output", {"output": "DO2", "value": True}).end == "unchanged"


@pytest.mark.parametrize(
    ("register", "value", "mode", "other"), [(202, 3, "P202", "factory"), (204, 5, "factory", "P202")]
)
def test_an_ssw06_leaves_the_adjusting_mode_that_it_is_in_and_no_other(
    register: int, value: int, mode: str, other: str
) -> None:
    actor = Actor("ssw06")
    actor.talk.ask(WriteRegister(register, value))

    assert actor.act("start").end in ("not_ready", "in_local")
    assert actor.act("configure", {"leave": other}).end == "not_in_that_mode"
    assert actor.act("configure", {"leave": mode}).end == "confirmed"
    assert actor.act("configure", {"leave": mode}).end == "not_in_that_mode"


def test_an_sst_that_was_reset_whole_must_be_initialised_before_it_starts() -> None:
    actor = Actor("sst")

    assert actor.act("reset", {"whole": True}).end == "confirmed"
    assert actor.act("start").end == "not_configured"
    assert actor.act("configure").end == "confirmed"
    assert actor.act("start").end == "confirmed"
    assert actor.act("reset", {"whole": True}).end == "motor_running"


def test_only_what_differs_goes_to_the_flash_of_an_sst() -> None:
    actor = Actor("sst")
    unit = actor.unit
    assert isinstance(unit, Sst)

    for values in ({"R41": 30, "R33": 2.0}, {"R41": 30, "R33": 2.0}, {"R41": 30}):
        assert actor.act("configure", values).end == "confirmed"

    assert unit.flash_writes == 1


@pytest.mark.parametrize(
    ("family", "values", "reads"),
    [
        ("ssw06", {"P314": 30, "P313": 1}, {"P313": (1,), "P314": (30,)}),
        ("ssw07", {"P314": 30, "P313": "Disable by ramp"}, None),
        ("ssw900", {"C11.3.1": -5, "C11.3.2": 7}, {"C11.3.1": (0xFFFB, 0xFFFF), "C11.3.2": (7, 0)}),
        ("ssw900", {"C8.2.5.1": 2, "C8.2.5.3": 20.0}, {"C8.2.5.1": (2,), "C8.2.5.3": (200,)}),
        ("sst", {"R41": 30, "R42": 60}, {"R41": (30,), "R42": (60,)}),
    ],
)
def test_several_rows_are_set_at_once_and_read_back(
    family: str, values: dict[str, Any], reads: dict[str, tuple[int, ...]] | None
) -> None:
    actor = Actor(family)

    done = actor.act("set", {"parameters": values})

    if reads is None:  # no such option
        assert done.end == "bad_value"
        return
    assert done.end == "confirmed"
    assert {code: actor.rows[code] for code in reads} == reads
    assert actor.act("set", {"parameters": values}).end == "unchanged"
    assert actor.act("read", {"parameters": list(values)}).end == "confirmed"


def test_an_ssw900_between_the_accepted_start_and_its_ramp_is_not_taken_for_one_at_rest() -> None:
    actor = Actor("ssw900", settings={931: 50})  # C5.7.1: 5 s before the ramp
    actor.talk.ask(WriteRegister(685, 0x0013))

    assert actor.act("direction", {"value": "reverse"}).end == "motor_running"
    assert actor.act("start").end == "motor_running"


def test_an_sst130i_whose_start_capacitor_is_charged_is_not_started_late_but_refused_with_the_reading() -> (
    None
):
    actor = Actor("sst", model="SST130i-75-M", variant=Variant(model="SST130i-75-M", firmware="2.21"))
    assert actor.act("start").end == "confirmed"
    actor.act("stop", seen=dict(actor.rows))
    actor.talk.wait(1.0)

    done = actor.act("start")

    assert (done.end, done.written) == ("capacitor_charged", [])
    assert re.search(r"R20 reads \d+ V, more than 30 V; wait until", done.text)
    actor.talk.wait(8.0)
    assert not actor.unit.motor.is_turning
    assert actor.act("start").end == "confirmed"


@pytest.mark.parametrize(
    "variant",
    [Variant(model="SST330i-M"), Variant(model="SST130i-75-M", firmware="1.90")],
    ids=["three phases", "firmware before 2.00"],
)
def test_the_register_of_the_capacitor_counts_only_where_it_exists(variant: Variant) -> None:
    profile = load_profile("sst")

    assert build(profile, variant, "start", {}, seen={"R20": (310,)}).steps
    with pytest.raises(CommandError, match="capacitor_charged"):
        build(profile, Variant(), "start", {}, seen={"R20": (310,)})
