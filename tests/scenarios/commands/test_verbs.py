"""Each verb of each family: the frames on the wire, as the manuals print the bits, and the results."""

from __future__ import annotations

import re
from typing import Any

from tests.rig import clean_line, event, frames, msg, played, result, results, row, seen
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SITES, SSW07
from tests.scenarios.commands import confirmed, do

SERIAL = 7  # the simulator's number of an output's function "Serial", which the manuals do not print


def verb_row(
    words: str,
    *pdus: str,
    args: dict[str, Any] | None = None,
    first: tuple[Action, ...] = (),
    **options: Any,
) -> Any:
    """`first` happens before; then the verb is sent, written with these frames, and confirmed."""
    name, verb = words.split()
    at_s = 6.0 if first else 2.5
    said = "".join(f" {key}={value}" for key, value in (args or {}).items())
    return row(
        f"{name}: {verb}{said}",
        given=SITES[name] + ALICE,
        sim={name: {**QUICK, **options}},
        at={2.0: first, at_s: do(words, **(args or {}))},
        then={at_s + 5.0: [result(f"{verb} confirmed ok"), frames(name, *pdus, since=at_s), clean_line]},
    )


def value(words: str, setting: Any, *pdus: str, first: tuple[Action, ...] = ()) -> Any:
    return verb_row(words, *pdus, args={"value": setting}, first=first)


def by_hand(name: str, pdu: str) -> Action:
    """Have another master write to a starter."""
    return lambda plant: plant.do(
        lambda: plant.starter(name).unit.handle(bytes.fromhex(pdu), plant.world.now_s())
    )


SSW07_ROWS = [  # coils 100 to 107 are the bits of VB03, 5.3.2 and 4.2.2; VB03 itself has no mask
    verb_row("pump start", "05 00 64 ff 00"),
    verb_row("pump stop", "05 00 64 00 00", first=(do("pump start"),)),
    verb_row(
        "pump reset", "05 00 64 00 00", "05 00 66 00 00", "05 00 6b 00 00", "05 00 6b ff 00",
        first=("pump trip E05",),
    ),
    value("pump general_enable", False, "05 00 65 00 00"),
    value(
        "pump general_enable", True, "05 00 64 00 00", "05 00 66 00 00", "05 00 65 ff 00",
        first=(do("pump general_enable", value=False),),
    ),
    value("pump jog", True, "05 00 66 ff 00"),
    value("pump jog", False, "05 00 66 00 00", first=(do("pump jog", value=True),)),
    value("pump direction", "reverse", "05 00 64 00 00", "05 00 66 00 00", "05 00 67 ff 00"),
    value(
        "pump direction", "forward", "05 00 64 00 00", "05 00 66 00 00", "05 00 67 00 00",
        first=(do("pump direction", value="reverse"),),
    ),
    value(
        "pump local_remote", "local", "05 00 64 00 00", "05 00 66 00 00", "05 00 68 00 00",
        "05 00 64 00 00", "05 00 66 00 00",  # once more: the first was perhaps of a source not active
    ),
    value(
        "pump local_remote", "remote", "05 00 64 00 00", "05 00 66 00 00", "05 00 68 ff 00",
        "05 00 64 00 00", "05 00 66 00 00",  # once more: the first was perhaps of a source not active
        first=(do("pump local_remote", value="local"),),
    ),
    verb_row("pump set", "06 01 3a 00 1e", args={"parameter": "P314", "value": 30}),
    verb_row("pump read", args={"parameter": "P314"}),
]  # fmt: skip

LOCAL_ROWS = [  # in local mode, where the starter's own setting gives the commands there to the serial line
    verb_row("pump start", "05 00 64 ff 00", first=("pump control local",), settings={229: 2}),  # 2.6
    verb_row("fan start", "06 13 8b 01 01", first=("fan control local",), settings={229: 2}),  # 2.6
    verb_row("mill start", "06 02 ad 00 03", first=("mill control local",), settings={229: 4}),  # bit 4 is 0
    verb_row("mill start", "06 02 ae 00 03", first=("mill control local",), settings={229: 5}, slot=2),
    verb_row("pump jog", "05 00 66 ff 00", args={"value": True}, first=("pump control local",),
             settings={229: 2}),
    verb_row("pump stop", "05 00 64 00 00", first=("pump control local", do("pump start")),
             settings={229: 2}),
    verb_row(
        "pump direction", "05 00 64 00 00", "05 00 66 00 00", "05 00 67 ff 00", args={"value": "reverse"},
        first=("pump control local",), settings={229: 2},
    ),
]  # fmt: skip

SSW06_ROWS = [  # VB03 is 138Bh; a bit counts only with its mask, eight places higher (4.2.3)
    verb_row("fan start", "06 13 8b 01 01"),
    verb_row("fan stop", "06 13 8b 01 00", first=(do("fan start"),)),
    verb_row(
        "fan reset", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 80 00", "06 13 8b 80 80",
        first=("fan trip E05",),
    ),
    verb_row(  # it restarts, and perhaps does not answer (4.3)
        "fan reset", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 80 00", "06 13 8b 80 80",
        first=("fan trip E05",), answers_before_restart=False,
    ),
    value("fan general_enable", False, "06 13 8b 02 00"),
    value(
        "fan general_enable", True, "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 02 02",
        first=(do("fan general_enable", value=False),),
    ),
    value("fan jog", True, "06 13 8b 04 04"),
    value("fan jog", False, "06 13 8b 04 00", first=(do("fan jog", value=True),)),
    value("fan direction", "reverse", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 08 08"),
    value("fan local_remote", "local", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 10 00",
          "06 13 8b 01 00", "06 13 8b 04 00"),
    value(
        "fan local_remote", "remote", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8b 10 10",
        "06 13 8b 01 00", "06 13 8b 04 00",
        first=(do("fan local_remote", value="local"),),
    ),
    verb_row("fan output", "06 13 90 00 04", args={"output": "RL3", "value": True}, settings={279: SERIAL}),
    verb_row("fan output", "06 13 91 3f ff", args={"output": "AO1", "value": 100.0}, settings={251: SERIAL}),
    verb_row("fan output", "06 13 90 00 00", args={"output": "RL3", "value": False}, settings={279: SERIAL},
             first=(do("fan output", output="RL3", value=True),)),
    verb_row("fan set", "06 01 3a 00 1e", args={"parameter": "P314", "value": 30}),
    verb_row("fan set", "10 01 39 00 02 04 00 01 00 1e", args={"parameters": {"P314": 30, "P313": 1}}),
    verb_row("fan configure", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8f 00 02", args={"leave": "P202"},
             first=(by_hand("fan", "06 00 ca 00 03"),)),
    verb_row("fan configure", "06 13 8b 01 00", "06 13 8b 04 00", "06 13 8f 00 01", args={"leave": "factory"},
             first=(by_hand("fan", "06 00 cc 00 05"),)),
]  # fmt: skip

SSW900_ROWS = [  # S5.2.5, register 685 (02ADh), the word of slot 1: bits 1 and 4 keep what is in force
    verb_row("mill start", "06 02 ad 00 13"),
    verb_row("mill start", "06 02 ae 00 13", slot=2),
    verb_row("mill stop", "06 02 ad 00 12", first=(do("mill start"),)),
    verb_row("mill reset", "06 02 ad 00 12", "06 02 ad 00 12", "06 02 ad 00 92", first=("mill trip",)),
    value("mill general_enable", False, "06 02 ad 00 10"),
    value(
        "mill general_enable", True, "06 02 ad 00 10", "06 02 ad 00 12",
        first=(do("mill general_enable", value=False),),
    ),
    value("mill jog", True, "06 02 ad 00 16"),
    value("mill jog", False, "06 02 ad 00 12", first=(do("mill jog", value=True),)),
    value("mill direction", "reverse", "06 02 ad 00 12", "06 02 ad 00 1a"),
    verb_row("mill output", "16 02 b7 ff fd 00 02", args={"output": "DO2", "value": True},
             settings={276: 12}),
    verb_row("mill set", "06 02 de 01 2c", args={"parameter": "C8.2.5.3", "value": 30}),
    verb_row("mill set", "10 04 56 00 04 08 ff fb ff ff 00 07 00 00",
             args={"parameters": {"C11.3.1": -5, "C11.3.2": 7}}),
    verb_row("mill set", "06 02 de 00 c8", "06 02 e4 00 02",  # the time first: never active at 0.0 s
             args={"parameters": {"C8.2.5.1": 2, "C8.2.5.3": 20.0}}),
]  # fmt: skip

SST_ROWS = [  # COIL1 is coil 0 on the wire; a register is written in configuration mode only, COIL2
    verb_row("belt start", "05 00 00 ff 00"),
    verb_row("belt stop", "05 00 00 00 00", first=(do("belt start"),)),
    verb_row("belt reset", "05 00 00 00 00", "05 00 02 ff 00", first=("belt trip",)),
    verb_row("belt reset", "05 00 00 00 00", "05 00 03 ff 00", args={"whole": True}),
    verb_row(
        "belt set", "05 00 00 00 00", "05 00 01 ff 00", "06 00 29 00 14", "05 00 01 00 00",
        args={"parameter": "R41", "value": 20},
    ),
    verb_row(
        "belt set", "05 00 00 00 00", "05 00 01 ff 00", "06 00 29 00 1e", "06 00 2a 00 3c", "05 00 01 00 00",
        args={"parameters": {"R41": 30, "R42": 60}},
    ),
    verb_row(  # nothing differs: nothing is written to the flash
        "belt configure", "05 00 00 00 00", "05 00 01 ff 00", "05 00 01 00 00",
    ),
    verb_row(
        "belt configure", "05 00 00 00 00", "05 00 01 ff 00", "06 00 29 00 14", "05 00 01 00 00",
        args={"R41": 20},
    ),
]  # fmt: skip


test_a_verb_writes_what_the_manual_prints_and_is_confirmed = played(
    SSW07_ROWS + LOCAL_ROWS + SSW06_ROWS + SSW900_ROWS + SST_ROWS
)


def asked(name: str, words: str, args: dict[str, Any], *then: Expectation, at: Any = None, **sim: Any) -> Any:
    """A verb is sent at 12 s, after what happens before; and what must be the case at 17 s."""
    starter = words.split()[0]
    given = SITES[starter] + ALICE
    return row(name, given=given, sim={starter: {**QUICK, **sim}}, at={**(at or {}), 12.0: do(words, **args)},
               then={17.0: then})  # fmt: skip


def ended(starter: str, phase: str, code: str = "ok", **fields: Any) -> Expectation:
    return msg(f"result/{starter}/alice", phase=phase, code=code, **fields)


SET_P314 = {"parameter": "P314", "value": 30}
REVERSED = ("06 02 ad 00 1b", "06 02 ad 00 1a", "06 02 ad 00 1a", "06 02 ad 00 1a", "06 02 ad 00 9a")
READS = [
    asked("several parameters are set with one command, in one frame where they are neighbours", "pump set",
          {"parameters": {"P314": 30, "P313": 2}}, frames("pump", "10 01 39 00 02 04 00 02 00 1e"),
          ended("pump", "confirmed", values={"P314": {"value": 30.0, "unit": "s", "raw": [30]},
                                             "P313": {"value": 2, "label": ..., "raw": [2]}})),
    asked("of several parameters one that has no such option lets none be set", "pump set",
          {"parameters": {"P314": 30, "P313": "Disable by ramp"}}, ended("pump", "rejected", "bad_value"),
          frames("pump")),
    asked("after a set of an SSW900 its text names what saves changed parameters", "mill set",
          {"parameter": "C8.2.5.3", "value": 30.0}, ended("mill", "confirmed", text=re.compile("C10.5.1"))),
    asked("an output of an SSW900 has nothing to save", "mill output", {"output": "DO1", "value": True},
          ended("mill", "confirmed", text=re.compile("^(?!.*C10)")), settings={275: 12}),
    row(
        "what is set too often would wear the starter's memory out; a start and a stop do not count",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            **{3.0 + n: do("pump set", parameter="P314", value=1 + n % 2) for n in range(121)},
            128.0: do("pump start"),
            131.0: do("pump stop"),
        },
        then={
            125.0: [result("set rejected wear_limit"), event("memory_written", topic="starter/pump/event")],
            130.0: result("start confirmed ok"),
            134.0: result("stop confirmed ok"),
        },
    ),
    asked("an output whose function is another does not follow, and the text says what it needs",
          "pump output", {"output": "RL1", "value": True},
          ended("pump", "unconfirmed", "not_followed", text=re.compile("P277"))),
    asked("an SST that was reset whole starts only after it was configured", "belt start", {},
          ended("belt", "confirmed"), seen("result/belt/alice", verb="start", code="not_configured", times=1),
          at={3.0: do("belt reset", whole=True), 7.0: do("belt start"), 8.0: do("belt configure")}),
    asked("an SST whose motor runs is not reset whole", "belt reset", {"whole": True},
          ended("belt", "rejected", "motor_running"), at={3.0: do("belt start")}),
    asked("a value that an SST has already is not written to its flash", "belt configure", {"R41": 20},
          ended("belt", "confirmed"),
          frames("belt", "05 00 00 00 00", "05 00 01 ff 00", "05 00 01 00 00", since=12.0),
          at={3.0: do("belt configure", R41=20)}),
    asked("a change of the direction stays through start, stop and reset", "mill reset", {},
          msg("starter/mill/state", state="ready", reverse=True, remote=True),
          frames("mill", *REVERSED, since=5.0),
          at={2.0: do("mill direction", value="reverse"), 5.0: do("mill start"), 8.0: do("mill stop"),
              10.0: "mill trip"}),
    asked("a read gives value, unit and the raw words, and writes nothing", "mill read",
          {"parameter": "S1.1.4"}, results("read accepted ok", "read confirmed ok"), frames("mill"),
          ended("mill", "confirmed", parameter="S1.1.4", value=0.0, unit="A", raw=[0, 0])),
    asked("a value of an enum comes with the manual's name of it", "belt read", {"parameter": "R0"},
          ended("belt", "confirmed", value=330, label="SST330i")),
    asked("several parameters are read with one command", "pump read", {"parameters": ["P003", "P314"]},
          ended("pump", "confirmed", values={"P003": {"value": 0.0}, "P314": {"unit": "s"}})),
    asked("a value that the starter holds already is not written again", "pump set", SET_P314,
          ended("pump", "confirmed", "unchanged"), frames("pump", "06 01 3a 00 1e"),
          results(*confirmed("set"), "set accepted ok", "set confirmed unchanged"),
          at={3.0: do("pump set", **SET_P314)}),
    asked("an SSW900 is not taken for one at rest between the accepted start and its ramp", "mill direction",
          {"value": "reverse"}, ended("mill", "rejected", "motor_running"), at={11.0: do("mill start")},
          settings={931: 50}),
    asked("an SST without that reading starts whatever its register of the capacitor reads", "belt start", {},
          ended("belt", "confirmed"), at={2.0: "belt R20 = 310"}),
]  # fmt: skip


test_parameters_are_read_and_set = played(READS)
