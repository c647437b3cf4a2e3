"""What comes of a command on a line that loses, refuses and is silent, and on a starter that does not act."""

from __future__ import annotations

import re
from typing import Any

from tests.rig import command, fault, frames, msg, never, played, result, row, seen
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, FOUR, QUICK, SITES, SSW07
from tests.scenarios.commands import LostWrites, do

SITE = SSW07 + ALICE
SIM = {"pump": QUICK}
START, RUN_OFF, JOG_OFF = "05 00 64 ff 00", "05 00 64 00 00", "05 00 66 00 00"
READY = "VB01 = 0x4102"
KEEPS = {**QUICK, "keeps_run_command": True}


def refuses_writes(starter: str, code: int, for_s: float) -> Action:
    return fault("refuse", starter, code, (5, 6, 15, 16), for_s=for_s)


def lose_writes(starter: str) -> Action:
    return lambda plant: plant.do(lambda: plant.line_of(starter).impair(starter, LostWrites()))


def written(starter: str, times: int) -> Expectation:
    return lambda plant: "" if len(plant.starter(starter).writes) == times else "written otherwise"


def ends(
    name: str, words: str, said: str, *then: Expectation, at: dict[float, Any] | None = None, **more: Any
) -> Any:
    """`words` is sent at 3 s, with what else happens then; its result at 10 s is as said."""
    options = {"given": SITES[words.split()[0]] + ALICE, "until_s": 10.0, "args": {}, "sim": {}, **more}
    given, until_s, args = (options.pop(each) for each in ("given", "until_s", "args"))
    happens = {**(at or {})}
    happens[3.0] = [*happens.pop(3.0, ()), do(words, **args)]
    end = result(f"{words.split()[1]} {said}")
    return row(name, given=given, at=happens, then={until_s: [end, *then]}, **options)


def says(text: str, starter: str = "pump", **fields: Any) -> Expectation:
    return msg(f"result/{starter}/alice", text=re.compile(text), **fields)


STARTED = frames("pump", START)
SETS = {"args": {"parameter": "P314", "value": 9}}
SET = frames("pump", "06 01 3a 00 09")

ONCE = [
    *(
        ends(f"a start of {name} whose answer is lost is written once, and confirmed by the readings",
             f"{name} start", "confirmed ok", written(name, 1), at={3.0: [lose_writes(name)]},
             sim={name: QUICK})
        for name in SITES
    ),
    row(
        "without a command nothing is written, at no beginning, no end and no return of the line",
        given=FOUR + ALICE,
        at={20.0: "line pumps unplug", 30.0: "line pumps plug", 60.0: "restart", 80.0: ["kill", "start"]},
        then={100.0: [frames(name) for name in SITES]},
    ),
    ends("after a start that nothing answers the motor may be turning", "pump start", "unconfirmed not_seen",
         says("may be turning"), STARTED, msg("starter/pump/state", state="running"), sim=SIM, until_s=40.0,
         at={3.08: fault("lose", "pump", for_s=30.0)}),
    ends("a start of a starter that is silent is refused, and not written when it answers again",
         "pump start", "rejected no_answer", frames("pump"), sim=SIM, until_s=20.0,
         at={3.0: [fault("silent", "pump", for_s=5.5)]}),
    ends("a start is confirmed by two readings, not by its acknowledgement", "pump start", "written ok",
         STARTED, until_s=5.0, at={2.0: f"pump {READY}"}),
    row(
        "the audit has each decision, with who claims to have decided, and what was read before and after",
        given=SITE,
        sim=SIM,
        at={3.0: command("pump/alice/start", operator="Alice A.", reason="shift 2", id="one")},
        then={
            6.0: [
                seen("audit", decision="accepted", times=1),
                msg("audit", starter="pump", client="alice", verb="start", id="one", decision="confirmed",
                    code="ok", operator="Alice A.", reason="shift 2", before={"running": False},
                    after={"running": True}),
            ]
        },
    ),
    ends("a setting whose answer is lost is read back", "pump set", "confirmed ok", SET, **SETS,
         at={3.12: fault("lose", "pump", count=1)}),
    ends("a motor that runs late but in time is confirmed", "pump start", "confirmed ok", STARTED,
         at={2.0: f"pump {READY}", 5.6: "pump VB01 = 0x5123"}),
    ends("a read that the starter refuses has failed", "pump read", "failed illegal_data_address",
         args={"parameter": "P314"}, at={3.0: [fault("refuse", "pump", 2, for_s=0.5)]}),
    ends("a setting that is refused as busy has failed at once", "pump set", "failed server_device_busy", SET,
         **SETS, until_s=4.0, at={3.0: [refuses_writes("pump", 6, 1.0)]}),
    ends("the end of a jog that is refused as busy has failed at once", "pump jog",
         "failed server_device_busy", frames("pump", JOG_OFF), args={"value": False}, until_s=4.0,
         at={3.0: [refuses_writes("pump", 6, 1.0)]}),
    ends("a start that is refused as busy and cannot be read then is unconfirmed", "pump start",
         "unconfirmed server_device_busy", STARTED,
         at={3.0: [refuses_writes("pump", 6, 30.0)], 3.12: fault("lose", "pump")}),
    ends("an end of the gateway cuts a start off before it is written", "pump start",
         "rejected shutting_down", frames("pump"), at={3.01: "end"}),
    ends("an end of the gateway leaves what is written unconfirmed, and writes nothing", "pump start",
         "unconfirmed shutting_down", says("act later: send a stop"), STARTED,
         at={2.0: f"pump {READY}", 3.5: "end"}),
]  # fmt: skip

NOT_SEEN = [
    *(
        ends(f"the refusal of a write by exception {code} names its causes on {name}", f"{name} start",
             f"failed {word}", says(cause, name), sim={name: QUICK},
             at={3.0: [refuses_writes(name, code, 3.0)]})
        for name, code, word, cause in (
            ("belt", 1, "illegal_function", "USB or the parallel input is in control"),
            ("belt", 2, "illegal_data_address", "a start came before the initialisation"),
            ("fan", 3, "illegal_data_value", "the command is not set to serial"),
            ("mill", 3, "illegal_data_value", "or the data are read-only$"),
        )
    ),
    ends("a start that an SSW-06 ignores is taken back by its masked bit", "fan start",
         "unconfirmed not_seen", frames("fan", "06 13 8b 01 01", "06 13 8b 01 00", "06 13 8b 04 00"),
         sim={"fan": {**QUICK, "settings": {230: 0}}}),
    ends("a start in local mode, where the starter obeys the serial line, is taken back alike", "mill start",
         "unconfirmed not_seen", says("cannot start later", "mill"),
         frames("mill", "06 02 ad 00 03", "06 02 ad 00 02"), sim={"mill": {**QUICK, "settings": {229: 4}}},
         at={2.0: ["mill control local", "mill mains off"]}),
    ends("an SSW900 without mains does not start when they return", "mill start", "unconfirmed not_seen",
         frames("mill", "06 02 ad 00 13", "06 02 ad 00 12"), never("starter/mill/state", state="running"),
         sim={"mill": QUICK}, until_s=20.0, at={2.0: "mill mains off", 12.0: "mill mains on"}),
    ends("a start that a hidden fault held back does not act once the fault is reset at the starter",
         "pump start", "unconfirmed not_seen", never("starter/pump/state", state="running"),
         sim={"pump": KEEPS}, until_s=20.0,
         at={2.0: [f"pump {READY}", "pump trip E05"], 12.0: ["pump VB01 = -", "pump clear"]}),
    ends("a jog that is seen not to act is taken back", "pump jog", "unconfirmed not_seen",
         says("so that it cannot start later"), frames("pump", "05 00 66 ff 00", RUN_OFF, JOG_OFF),
         args={"value": True}, at={2.0: f"pump {READY}"}),
    *(
        ends(f"a start that is refused with {code} but acts is confirmed", "pump start", "confirmed ok",
             STARTED, at={3.0: [refuses_writes("pump", code, 1.0)], 3.3: "pump VB01 = 0x5123"})
        for code in (5, 6, 10, 11)
    ),
    *(
        ends(f"a start that is refused with {code} and does not act is taken back", "pump start", said,
             frames("pump", START, RUN_OFF, JOG_OFF), at={3.0: [refuses_writes("pump", code, 1.0)]})
        for code, said in (
            (5, "unconfirmed not_seen"),
            (6, "failed server_device_busy"),
            (10, "failed gateway_path_unavailable"),
            (11, "failed gateway_target_device_failed_to_respond"),
        )
    ),
    *(
        ends(f"a start that is refused with {code} has failed at once", "pump start", f"failed {said}",
             STARTED, until_s=4.0, at={3.0: [refuses_writes("pump", code, 1.0)]})
        for code, said in (
            (1, "illegal_function"),
            (2, "illegal_data_address"),
            (3, "illegal_data_value"),
            (4, "server_device_failure"),
        )
    ),
]  # fmt: skip


def waking(verb: str, ended: list[Action], at_s: float = 9.0, **args: Any) -> Any:
    """S1: a motor that runs comes to rest at 6 s while its run command stands; the verb starts nothing."""
    return row(
        f"{verb} starts no motor whose run command still stands",
        given=SITE,
        sim={"pump": KEEPS},
        at={3.0: do("pump start"), 6.0: ended, at_s: do(f"pump {verb}", **args)},
        then={
            at_s + 5.0: [
                result(f"{verb} confirmed ok"),
                msg("starter/pump/state", state="ready"),
                never("starter/pump/state", since=at_s + 1.0, state="running"),
            ]
        },
    )


STANDING = [
    waking("reset", ["pump trip E05"]),
    waking("general_enable", [do("pump general_enable", value=False)], value=True),
    waking("local_remote", ["pump control local", "pump keypad stop"], value="remote"),
]


test_a_write_is_made_once_and_believed_by_its_readings = played(ONCE)
test_a_start_that_is_not_seen_or_refused = played(NOT_SEEN)
test_a_run_command_that_stands_does_not_act = played(STANDING)
