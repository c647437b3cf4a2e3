"""What a hand at a simulated starter, its motor and its supply does, by words."""

from __future__ import annotations

import pytest

from gateway.errors import UsageError
from gateway.sim.controls import set_knob
from tests.sim.script import play, rules

# how a lost phase and a deep dip are read, and full speed
READ = {
    "ssw06": ("VB01 & 8000h = 8000h", "VB01 & 8000h = 8000h", "VB01 & 20h = 20h"),
    "ssw07": ("P014 = 74", "P014 = 2", "VB01 & 20h = 20h"),
    "ssw900": ("90 = 74", "90 = 2", "680 & 20h = 20h"),
    "sst": ("coil 17 = 1", "coil 14 = 1", "R19 = 2"),
}
ALL = {
    "at speed": "start; 30 s; {2}",
    "supplies": "power off; see is_powered False; power on; mains off; see motor.is_mains_present False",
    "a lost phase": "run; 10 s; phase s; 5 s; see motor.is_turned_on False; {0}",
    "a deep dip": "run; 10 s; voltage 70 2.5; 5 s; {1}",
    "wear": "wear 2.5; run; 20 s; load 50; see motor.friction_pct 2.5",
}
BY_HAND = [
    *(
        row
        for each, read in READ.items()
        for row in rules(each, {k: v.format(*read) for k, v in ALL.items()})
    ),
    *rules("ssw900", {"an alarm of its number": "alarm A063; see alarms 63; clear; see alarms"}),
    *rules("ssw06", {"an alarm bit": "alarm; see is_alarm True; clear; see is_alarm False"}),
    *rules(
        "sst",
        {
            "by its inputs": "control local; see control parallel; keypad start; see motor.is_turned_on True"
            "; keypad stop; see motor.is_turned_on False; control remote; see control modbus"
        },
    ),
    *rules("ssw07", {"three phases": "VB01 = 4102h; phase r; VB01 = 102h; phase on; VB01 = 4102h"}),
    *rules("ssw07", {"the thermal level, of 250 %": "run; 10 s; thermal 60; P050 = 150"}),
    *rules("ssw900", {"the thermal level, of 100.0 %": "run; 10 s; thermal 60; 50 = 600"}),
]


@pytest.mark.parametrize(("family", "script"), BY_HAND)
def test_a_hand_is_seen_at_the_starter_and_over_the_line(family: str, script: str) -> None:
    play(family, script)


@pytest.mark.parametrize(
    ("family", "knob", "setting", "why"),
    [
        ("ssw07", "explode", "", "no knob 'explode'"),
        ("ssw07", "trip", "E100", "no fault 'E100'"),
        ("ssw07", "trip", "0", "no number '0'"),
        ("sst", "trip", "COIL9", "COIL10 to COIL21"),
        ("sst", "alarm", "", "sst has no alarms"),
        ("ssw900", "power", "maybe", "on or off"),
        ("ssw07", "phase", "x", "r or s or t or on"),
        ("ssw07", "voltage", "500", "a number from 0 to 120"),
        ("ssw07", "voltage", "80 long", "in s"),
        ("ssw07", "load", "much", "a number from 0 to 1000"),
    ],
)
def test_what_a_starter_does_not_have_is_refused_with_what_it_has(
    family: str, knob: str, setting: str, why: str
) -> None:
    unit = play(family, "power on").unit

    with pytest.raises(UsageError, match=why):
        set_knob(unit, knob, setting)

    assert unit.trips == []
