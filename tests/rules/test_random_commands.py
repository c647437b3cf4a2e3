"""Whatever is commanded in whatever order: no motor starts without a start, none stops by a stray write.

2,000 commands a family at random, with faults and other people's hands in between, to a simulated starter.
"""

from __future__ import annotations

import random
from functools import cache
from typing import Any

import pytest

from gateway.families.command.procedures import verbs
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.sim.core.power import MotorState
from gateway.sim.sst.unit import Sst
from gateway.sim.weg.common import Commanded
from tests.rules.acting import Actor
from tests.sim.script import START, step

COMMANDS = 2_000
LIFE = 100  # commands that a starter gets before a new one takes its place
STARTS = ("start", "jog on")
STOPS = ("stop", "jog off", "general_enable off")
DEADLY = ("R42",)  # shorter than the starter's own start-up it restarts without end, whatever is commanded
VALUES = (0, 1, 2, 5, 10, 50, 0.5, True, "on", "Serial", "nonsense", None, -1, 70000)

HAPPENINGS = ("trip", "lost mains", "another master", "people", *["time"] * 4)


def is_driven(actor: Actor) -> bool:
    motor = actor.unit.motor
    return motor.is_turned_on or motor.state is MotorState.JOG or bool(getattr(actor.unit, "phase", ""))


@cache
def some_codes(family: str) -> list[str]:
    """Return the rows to choose from, those that can be written twice as often as the others."""
    profile = load_profile(family)
    writable = [row.code for row in profile.parameters.values() if row.is_writable and row.code not in DEADLY]
    return [*writable, *writable, *profile.command_word, "VB07", "COIL1", "COIL2", "P220", "P500"]


def some_args(actor: Actor, verb: str, dice: random.Random) -> dict[str, Any]:
    profile = actor.profile
    code = dice.choice(some_codes(profile.family))
    match verb:
        case "general_enable" | "jog":
            return {"value": dice.random() < 0.6}
        case "direction" | "local_remote":
            return {"value": dice.choice(profile.commands[verb].values)}
        case "output":
            return {"output": dice.choice(list(profile.outputs)), "value": dice.choice(VALUES)}
        case "reset":
            return {"whole": True} if profile.family == "sst" and dice.random() < 0.1 else {}
        case "configure" if profile.family == "ssw06":
            return {"leave": dice.choice(["P202", "factory"])}
        case "configure":
            return {f"R{dice.randint(30, 41)}": dice.choice(VALUES) for _ in range(dice.randint(0, 3))}
        case "read":
            return {"parameters": [code, dice.choice(list(profile.parameters))]}
        case "set" if dice.random() < 0.3:
            return {"parameters": {code: dice.choice(VALUES), "P314": dice.choice(VALUES)}}
        case "set":
            return {"parameter": code, "value": dice.choice(VALUES)}
    return {}


def happen(actor: Actor, dice: random.Random) -> None:
    """Let something happen besides: mostly time passes."""
    unit, talk = actor.unit, actor.talk
    match dice.choice(HAPPENINGS):
        case "trip":
            actor.trip()
        case "lost mains":
            unit.set_mains(is_present=False)
            talk.wait(1.0)
            unit.set_mains(is_present=True)
        case "another master":  # whose run command may stand without the gateway's doing
            step(talk, f"{START[unit.family]} sent")
        case "people" if isinstance(unit, Sst):
            unit.set_control(dice.choice(["modbus", "modbus", "modbus", "usb", "parallel"]))
        case "people" if isinstance(unit, Commanded):
            unit.set_enable_input(is_on=dice.random() < 0.8)
            unit.set_remote(is_remote=dice.random() < 0.8)  # type: ignore[attr-defined]  # every WEG family has it
        case _:
            talk.wait(dice.choice([0.05, 1.0, 5.0, 30.0]))


def label(verb: str, args: dict[str, Any]) -> str:
    if verb == "jog":
        return f"jog {'on' if args['value'] else 'off'}"
    return "general_enable off" if verb == "general_enable" and not args["value"] else verb


SERIAL_IN_LOCAL = {"ssw06": {229: 2}, "ssw07": {229: 2}, "ssw900": {229: 4}}  # P229, C3.2


def send_at_random(
    family: str, count: int, *, keeps_run_command: bool, obeys_in_local: bool = False
) -> dict[str, int]:
    """Send so many commands and return how often each had which end; AssertionError when one is wrong."""
    dice = random.Random(f"{family} {keeps_run_command} 1")
    options: dict[str, Any] = {"hides_command_bits": keeps_run_command}
    if obeys_in_local:
        options["settings"] = SERIAL_IN_LOCAL[family]
    ends: dict[str, int] = {}
    for number in range(count):
        if number % LIFE == 0:  # one whose settings no command has corrupted yet
            actor = Actor(family, **options)
            actor.unit.quirks.keeps_run_command = keeps_run_command
        end = _send_one(actor, dice)
        ends[end] = ends.get(end, 0) + 1
    return ends


def _send_one(actor: Actor, dice: random.Random) -> str:
    if dice.random() < 0.3:
        happen(actor, dice)
    verb = dice.choice([*verbs(actor.profile), "start", "stop"])
    args = some_args(actor, verb, dice)
    actor.talk.wait(0.2)
    was_driven, trips = is_driven(actor), len(actor.unit.trips)
    done = actor.act(verb, args, seen=dict(actor.rows) if verb == "stop" else None)
    what = label(verb, args)
    has_tripped = len(actor.unit.trips) > trips  # a watchdog or protection, not the command
    is_meant = what in STARTS if is_driven(actor) else what in STOPS or has_tripped
    assert was_driven is is_driven(actor) or is_meant, f"{actor.profile.family}: {what} {args}: {done}"
    return f"{what} {done.end}" + ("" if getattr(actor.unit, "is_remote", True) else " in local")


@pytest.mark.parametrize("keeps_run_command", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_no_random_sequence_of_commands_starts_a_motor_unasked_or_stops_one_by_a_stray_write(
    family: str, *, keeps_run_command: bool
) -> None:
    ends = send_at_random(family, COMMANDS // 2, keeps_run_command=keeps_run_command)

    assert ends["start confirmed"] > COMMANDS / 200
    assert ends["stop confirmed"] > COMMANDS / 200
    assert "start confirmed in local" not in ends


@pytest.mark.parametrize("family", SERIAL_IN_LOCAL)
def test_nor_does_one_where_the_starter_obeys_the_line_in_local_mode(family: str) -> None:
    ends = send_at_random(family, COMMANDS // 2, keeps_run_command=True, obeys_in_local=True)

    assert ends["start confirmed in local"] > 0
    assert ends["stop confirmed in local"] > 0
