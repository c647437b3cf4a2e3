"""Every verb of every family, carried out on the simulated starter by the requests that the gateway sends."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import CommandError
from gateway.families.command.procedures import build
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.modbus.writes import WriteRegister
from gateway.sim.core.power import MotorState
from tests.rules.acting import Actor

WEG = ("ssw06", "ssw07", "ssw900")
ON, OFF = {"value": True}, {"value": False}


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
