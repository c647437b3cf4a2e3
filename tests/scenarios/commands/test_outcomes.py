"""What comes of a command on a line that loses, refuses and is silent, and on a starter that does not act."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.rig import (
    ScenarioRow,
    fault,
    frames,
    msg,
    never,
    play,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, FOUR, QUICK, SST, SSW06, SSW07, SSW900
from tests.scenarios.commands import do

SITE = SSW07 + ALICE
FAMILIES = {"pump": SSW07, "fan": SSW06, "mill": SSW900, "belt": SST}
SIM = {"pump": QUICK}
START, RUN_OFF, JOG_OFF = "05 00 64 ff 00", "05 00 64 00 00", "05 00 66 00 00"
READY = "VB01 = 0x4102"


def refuses_writes(starter: str, code: int, for_s: float) -> Action:
    return fault("refuse", starter, code, (5, 6, 15, 16), for_s=for_s)


def lose_writes(starter: str) -> Action:
    """Lose the answers of its writes, not of reads."""

    class LostWrites:
        def apply(self, reply: Any, dice: Any) -> tuple[Any, ...]:
            return () if reply.adu[1] in (5, 6, 15, 16) else (reply,)

    return lambda plant: plant.do(lambda: plant.line_of(starter).impair(starter, LostWrites()))


def written(starter: str, times: int) -> Expectation:
    return lambda plant: "" if len(plant.starter(starter).writes) == times else "written otherwise"


ONCE = [
    *(
        row(
            f"a start of {name} whose answer is lost is written once, and confirmed by the readings",
            given=given + ALICE,
            sim={name: QUICK},
            at={3.0: [lose_writes(name), do(f"{name} start")]},
            then={9.0: [result("start confirmed ok"), written(name, 1)]},
        )
        for name, given in FAMILIES.items()
    ),
    row(
        "without a command nothing is written, at no beginning, no end and no return of the line",
        given=FOUR + ALICE,
        at={20.0: "line pumps unplug", 30.0: "line pumps plug", 60.0: "restart", 80.0: ["kill", "start"]},
        then={100.0: [frames(name) for name in FAMILIES]},
    ),
    row(
        "after a start that nothing answers the motor may be turning",
        given=SITE,
        sim=SIM,
        at={3.0: do("pump start"), 3.08: fault("lose", "pump", for_s=30.0)},
        then={
            10.0: [
                msg("result/pump/alice", phase="unconfirmed", text=re.compile("may be turning")),
                frames("pump", START),
            ],
            40.0: [frames("pump", START), seen("starter/pump/state", state="running")],
        },
    ),
    row(
        "a start of a starter that is silent is refused, and not written when it answers again",
        given=SITE,
        sim=SIM,
        at={3.0: [fault("silent", "pump", for_s=5.5), do("pump start")]},
        then={
            9.0: [never("result/pump/alice", phase="written"), result("start rejected no_answer")],
            20.0: frames("pump"),
        },
    ),
    row(
        "a start is confirmed by two readings, not by its acknowledgement",
        given=SITE,
        at={3.0: [f"pump {READY}", do("pump start")]},
        then={5.0: [result("start written ok"), frames("pump", START)]},
    ),
    row(
        "a setting whose answer is lost is read back",
        given=SITE,
        at={3.0: do("pump set", parameter="P314", value=9), 3.12: fault("lose", "pump", count=1)},
        then={8.0: [result("set confirmed ok"), frames("pump", "06 01 3a 00 09")]},
    ),
    row(
        "a motor that runs late but in time is confirmed",
        given=SITE,
        at={2.0: f"pump {READY}", 3.0: do("pump start"), 5.6: "pump VB01 = 0x5123"},
        then={7.0: [result("start confirmed ok"), frames("pump", START)]},
    ),
    row(
        "a read that the starter refuses has failed",
        given=SITE,
        at={3.0: [fault("refuse", "pump", 2, for_s=0.5), do("pump read", parameter="P314")]},
        then={5.0: result("read failed illegal_data_address")},
    ),
    *(
        row(
            f"{what} that is refused as busy has failed at once",
            given=SITE,
            at={3.0: [refuses_writes("pump", 6, 1.0), do(f"pump {verb}", **args)]},
            then={4.0: [result(f"{verb} failed server_device_busy"), frames("pump", pdu)]},
        )
        for what, verb, args, pdu in (
            ("a setting", "set", {"parameter": "P314", "value": 9}, "06 01 3a 00 09"),
            ("the end of a jog", "jog", {"value": False}, JOG_OFF),
        )
    ),
    row(
        "a start that is refused as busy and cannot be read then is unconfirmed",
        given=SITE,
        at={3.0: [refuses_writes("pump", 6, 30.0), do("pump start")], 3.12: fault("lose", "pump")},
        then={
            12.0: [
                msg("result/pump/alice", phase="unconfirmed", code="server_device_busy"),
                frames("pump", START),
            ]
        },
    ),
    row(
        "an end of the gateway cuts a start off before it is written",
        given=SITE,
        at={3.0: do("pump start"), 3.01: "end"},
        then={3.1: [results("start accepted ok", "start rejected shutting_down"), frames("pump")]},
    ),
    row(
        "an end of the gateway leaves what is written unconfirmed, and writes nothing",
        given=SITE,
        at={2.0: f"pump {READY}", 3.0: do("pump start"), 3.5: "end"},
        then={
            3.6: [
                msg(
                    "result/pump/alice",
                    phase="unconfirmed",
                    code="shutting_down",
                    text=re.compile("act later: send a stop"),
                ),
                frames("pump", START),
            ]
        },
    ),
]

NOT_SEEN = [
    *[
        row(
            f"the refusal of a write by exception {code} names its causes on {name}",
            given=FAMILIES[name] + ALICE,
            sim={name: QUICK},
            at={3.0: [refuses_writes(name, code, 3.0), do(f"{name} start")]},
            then={8.0: msg(f"result/{name}/alice", phase="failed", code=word, text=re.compile(cause))},
        )
        for name, code, word, cause in (
            ("belt", 1, "illegal_function", "USB or the parallel input is in control"),
            ("belt", 2, "illegal_data_address", "a start came before the initialisation"),
            ("fan", 3, "illegal_data_value", "the command is not set to serial"),
            ("mill", 3, "illegal_data_value", "or the data are read-only$"),
        )
    ],
    row(
        "a start that an SSW-06 ignores is taken back by its masked bit",
        given=SSW06 + ALICE,
        sim={"fan": {**QUICK, "settings": {230: 0}}},
        at={3.0: do("fan start")},
        then={
            10.0: [
                result("start unconfirmed not_seen"),
                frames("fan", "06 13 8b 01 01", "06 13 8b 01 00", "06 13 8b 04 00"),
            ]
        },
    ),
    row(
        "a start in local mode, where the starter obeys the serial line, is taken back alike",
        given=SSW900 + ALICE,
        sim={"mill": {**QUICK, "settings": {229: 4}}},
        at={2.0: ["mill control local", "mill mains off"], 3.0: do("mill start")},
        then={
            9.5: [
                msg("result/mill/alice", phase="unconfirmed", text=re.compile("cannot start later")),
                frames("mill", "06 02 ad 00 03", "06 02 ad 00 02"),
            ]
        },
    ),
    row(
        "an SSW900 without mains does not start when they return",
        given=SSW900 + ALICE,
        sim={"mill": QUICK},
        at={2.0: "mill mains off", 3.0: do("mill start"), 12.0: "mill mains on"},
        then={
            11.0: [result("start unconfirmed not_seen"), frames("mill", "06 02 ad 00 13", "06 02 ad 00 12")],
            20.0: never("starter/mill/state", state="running"),
        },
    ),
    row(
        "a start that a hidden fault held back does not act once the fault is reset at the starter",
        given=SITE,
        sim={"pump": {**QUICK, "keeps_run_command": True}},
        at={
            2.0: [f"pump {READY}", "pump trip E05"],
            3.0: do("pump start"),
            12.0: ["pump VB01 = -", "pump clear"],
        },
        then={11.0: result("start unconfirmed not_seen"), 20.0: never("starter/pump/state", state="running")},
    ),
    row(
        "a jog that is seen not to act is taken back",
        given=SITE,
        at={2.0: f"pump {READY}", 3.0: do("pump jog", value=True)},
        then={
            12.0: [
                result("jog unconfirmed not_seen"),
                seen("result/pump/alice", verb="jog", text=re.compile("taken back|was written")),
                lambda plant: (
                    "" if JOG_OFF in [pdu for _, pdu in plant.starter("pump").writes] else "no jog = 0"
                ),
            ]
        },
    ),
    *(
        row(
            f"a start that is refused with {code} but acts is confirmed",
            given=SITE,
            at={
                3.0: [refuses_writes("pump", code, 1.0), do("pump start")],
                3.3: "pump VB01 = 0x5123",
            },
            then={8.0: [result("start confirmed ok"), frames("pump", START)]},
        )
        for code in (5, 6, 10, 11)
    ),
    *(
        row(
            f"a start that is refused with {code} and does not act is taken back and has failed",
            given=SITE,
            at={3.0: [refuses_writes("pump", code, 1.0), do("pump start")]},
            then={10.0: [result(f"start {said}"), frames("pump", START, RUN_OFF, JOG_OFF)]},
        )
        for code, said in (
            (5, "unconfirmed not_seen"),
            (6, "failed server_device_busy"),
            (10, "failed gateway_path_unavailable"),
            (11, "failed gateway_target_device_failed_to_respond"),
        )
    ),
    *(
        row(
            f"a start that is refused with {code} has failed at once",
            given=SITE,
            at={3.0: [refuses_writes("pump", code, 1.0), do("pump start")]},
            then={4.0: [result(f"start failed {said}"), frames("pump", START)]},
        )
        for code, said in (
            (1, "illegal_function"),
            (2, "illegal_data_address"),
            (3, "illegal_data_value"),
            (4, "server_device_failure"),
        )
    ),
]

STANDING = [  # S1: after a fault, a general disable or local mode a run command may stand in the starter
    row(
        "a reset starts no motor whose run command still stands",
        given=SITE,
        sim={"pump": {**QUICK, "keeps_run_command": True}},
        at={3.0: do("pump start"), 6.0: "pump trip E05", 9.0: do("pump reset")},
        then={
            14.0: [
                result("reset confirmed ok"),
                msg("starter/pump/state", state="ready"),
                never("starter/pump/state", since=9.0, state="running"),
            ]
        },
    ),
    row(
        "general enable starts no motor whose run command still stands",
        given=SITE,
        sim={"pump": {**QUICK, "keeps_run_command": True}},
        at={
            3.0: do("pump start"),
            6.0: do("pump general_enable", value=False),
            9.0: do("pump general_enable", value=True),
        },
        then={
            14.0: [
                result("general_enable confirmed ok"),
                never("starter/pump/state", since=9.0, state="running"),
            ]
        },
    ),
    row(
        "the way back to remote starts no motor whose run command still stands",
        given=SITE,
        sim={"pump": {**QUICK, "keeps_run_command": True}},
        at={
            3.0: do("pump start"),
            6.0: ["pump control local", "pump keypad stop"],
            9.0: do("pump local_remote", value="remote"),
        },
        then={
            14.0: [
                result("local_remote confirmed ok"),
                never("starter/pump/state", since=10.0, state="running"),
            ]
        },
    ),
]


@pytest.mark.parametrize("row", ONCE)
def test_a_write_is_made_once_and_believed_by_its_readings(row: ScenarioRow) -> None:
    play(row)


@pytest.mark.parametrize("row", NOT_SEEN)
def test_a_start_that_is_not_seen_or_refused(row: ScenarioRow) -> None:
    play(row)


@pytest.mark.parametrize("row", STANDING)
def test_a_run_command_that_stands_does_not_act(row: ScenarioRow) -> None:
    play(row)
