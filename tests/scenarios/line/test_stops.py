"""Stops: at once, before everything, again and again until the motor is seen to stand."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    clean_line,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    play,
    publish,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, QUICK, SSW07, operator, table
from tests.scenarios.line.wires import (
    EIGHT,
    READY_07,
    RUNNING_07,
    START_07,
    STOP_07,
    TWO,
    Paced,
    chatter,
    final_text,
    repeated,
    requests_on_wires,
    written,
)

RUNS = {"pump": QUICK}
GROUP = TWO + ALICE + table("[group]", name="hall", starters=["pump", "fan"])
READ = command("fan/alice/read", args={"parameter": "P202"})
START, STOP = command("pump/alice/start"), publish("command/pump/alice/stop", client="alice")
OK = ("accepted ok", "written ok", "confirmed ok")


def ended(verb: str, count: int, words: str = "confirmed ok") -> Expectation:
    """So many commands of a verb have ended, all of them so."""

    def check(plant: RigPlant) -> str:
        found = [each for each in plant.results() if each.startswith(verb) and not each.endswith(OK[:2])]
        return "" if found == count * [f"{verb} {words}"] else str(found)

    return check


def all_stops_sent(plant: RigPlant) -> str:
    """From 8 s on stops went out over the bytes of another, the first at once, then every 0.85 s at least."""
    sent = [at_s - 8.0 for at_s, pdu in requests_on_wires(plant, "pump", 8.0) if pdu.hex(" ") == STOP_07]
    apart = [after - before for before, after in pairwise(sent)]
    return "" if sent and sent[0] < 0.4 and len(sent) >= 17 and max(apart) < 0.85 else f"sent at {sent}"


SCENARIOS = [
    row(
        "a stop needs nothing but its topic, is written once and confirmed by what was read after it",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={3.0: START, 6.0: STOP},
        then={
            9.0: [
                results(*(f"{verb} {each}" for verb in ("start", "stop") for each in OK)),
                frames("pump", START_07, STOP_07),
                final_text("read back from the starter"),
                msg("starter/pump/state", state="ready"),
                clean_line,
            ]
        },
    ),
    row(
        "a stop reaches the line within the worst time that is published, though seven others are asked",
        given=EIGHT.replace("every_s = 1.0", "every_s = 0") + ALICE,
        at={5.0: publish("command/pump-8/alice/stop", client="alice")},
        then={
            40.0: [
                Paced("pump-8", 5.0, (0.0,), within_s=0.078),
                msg(
                    "gateway/line/pumps",
                    stop_latency_s={"computed": pytest.approx(0.213, abs=0.001), "stops": 1},
                    computed={"stop_latency_s": pytest.approx(0.213, abs=0.001)},  # as `check` says
                ),
                clean_line,
            ]
        },
    ),
    row(
        "a stop is repeated every half second while the motor runs on, and ends unconfirmed after ten",
        given=SSW07 + ALICE,
        at={3.0: f"pump {RUNNING_07}", 5.0: STOP},
        then={
            14.9: result("stop written ok"),
            20.0: [
                result("stop unconfirmed not_seen"),
                final_text("may be turning"),
                event("stop_unconfirmed", "starter/pump/event", severity="error"),
                repeated("pump", 5.0, count=20),
            ],
        },
    ),
    row(
        "a stop is not confirmed by one reading of a motor at rest between two of a motor that runs",
        given=SSW07 + ALICE,
        at={3.0: f"pump {RUNNING_07}", 5.0: STOP, 7.02: f"pump {READY_07}", 7.06: f"pump {RUNNING_07}"},
        then={9.0: result("stop written ok")},
    ),
    row(
        "each stop message has a frame and a final result of its own, and joins the stop under way",
        given=SSW07 + ALICE + operator("bob"),
        at={
            3.0: f"pump {RUNNING_07}",
            5.0: command("pump/alice/stop"),
            5.2: command("pump/bob/stop"),
            6.3: command("pump/alice/stop"),
            8.0: "pump VB01 = -",
        },
        then={
            10.0: [
                ended("stop", 3),
                results("stop accepted ok", "stop written ok", "stop confirmed ok", client="bob"),
                Paced("pump", 5.0, (0.0, 0.2, 0.7, 1.2, 1.3, 1.8, 2.3, 2.8), within_s=0.15),
            ]
        },
    ),
    row(
        "a motor that somebody starts between two stops keeps the second one going",
        given=SSW07 + ALICE,
        at={
            3.0: f"pump {RUNNING_07}",
            5.0: STOP,
            5.1: f"pump {READY_07}",
            7.0: [f"pump {RUNNING_07}", STOP],
            9.2: f"pump {READY_07}",
        },
        then={
            6.9: ended("stop", 1),
            9.1: ended("stop", 1),
            11.0: [ended("stop", 2), Paced("pump", 7.0, (0.0, 0.5, 1.0, 1.5, 2.0))],
        },
    ),
    row(
        "a stop whose id was used before is carried out again and says that it is a copy",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={
            3.0: command("pump/alice/stop", id="one"),
            6.0: START,
            10.0: command("pump/alice/stop", id="one"),
        },
        then={
            13.0: [
                frames("pump", STOP_07, START_07, STOP_07),
                msg("result/pump/alice", id="one", duplicate=True),
                msg("starter/pump/state", state="ready"),
            ]
        },
    ),
    row(
        "a stop overtakes a start that waits for its starter: nothing is started",
        given=SSW07 + ALICE,
        at={3.0: [fault("delay", "pump", 0.08, for_s=0.2), START], 3.02: STOP},
        then={
            8.0: [
                seen("result/pump/alice", verb="start", phase="rejected", code="stopped_first"),
                written("pump", STOP_07),
            ]
        },
    ),
    row(
        "a stop right after a jog takes the jog back, though no reading has shown it",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={3.0: [f"pump {READY_07}", command("pump/alice/jog", args={"value": True})], 3.2: STOP},
        then={
            9.0: [result("stop confirmed ok"), frames("pump", "05 00 66 ff 00", STOP_07, "05 00 66 00 00")]
        },
    ),
    row(
        "a stop ends a start under way, and no start follows it",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={3.0: START, 3.3: STOP},
        then={
            9.0: [
                result("stop confirmed ok"),
                msg("starter/pump/state", state="ready"),
                lambda plant: "" if plant.starter("pump").writes[-1][1] == STOP_07 else "no stop at the end",
            ]
        },
    ),
    row(
        "a stop is confirmed although its first acknowledgements were lost",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={3.0: START, 6.0: [fault("lose", "pump", for_s=1.2), STOP]},
        then={
            7.1: result("stop written ok"),
            10.0: [result("stop confirmed ok"), Paced("pump", 6.0, (0.0, 0.5, 1.0, 1.5))],
        },
    ),
    row(
        "a stop of a starter that has gone silent is written until its time ends, and is no_answer",
        given=SSW07 + ALICE,
        at={5.0: fault("silent", "pump"), 20.0: STOP},
        then={
            19.0: msg("starter/pump/availability", state="offline"),
            31.0: [result("stop unconfirmed no_answer"), final_text("may be turning")],
        },
    ),
    row(
        "a stop of an offline starter is carried out when it comes back in time",
        given=SSW07 + ALICE,
        at={5.0: fault("silent", "pump", for_s=19.0), 20.0: STOP},
        then={27.0: [result("stop confirmed ok"), msg("starter/pump/availability", state="online")]},
    ),
    row(
        "a stop that comes while the port is away goes out when it is back",
        given=SSW07 + ALICE,
        at={5.0: "line pumps unplug", 6.0: STOP, 9.0: "line pumps plug"},
        then={14.0: [result("stop confirmed ok"), event("port_away")]},
    ),
    row(
        "a stop on a line without a port ends after its time, and nothing was written",
        given=SSW07 + ALICE,
        at={5.0: "line pumps unplug", 6.0: STOP},
        then={18.0: [result("stop rejected line_down"), frames("pump")]},
    ),
    row(
        "a refused stop is repeated, and fails at its deadline with the exception",
        given=SSW07 + ALICE,
        at={3.0: fault("refuse", "pump", 4, (5,)), 5.0: STOP},
        then={17.0: [result("stop failed server_device_failure"), repeated("pump", 5.0, count=20)]},
    ),
    row(
        "a stop is confirmed over a line that flips bits",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={3.0: START, 6.0: [lambda plant: plant.lines["pumps"].noise(0.002), STOP]},
        then={17.0: [result("stop confirmed ok"), msg("starter/pump/state", state="ready")]},
    ),
    row(
        "a stop is written into a line that is never quiet, and its result says so",
        given=SSW07 + ALICE,
        at={3.0: f"pump {RUNNING_07}", 5.0: chatter(0.002, 20.0), 8.0: STOP},
        then={
            8.6: result("stop written ok"),
            20.0: [
                result("stop unconfirmed not_seen"),
                final_text("another device transmits on the line without a pause"),
                all_stops_sent,
            ],
        },
    ),
    row(
        "nothing but a stop is written into a line that is never quiet",
        given=SSW07 + ALICE,
        at={5.0: chatter(0.002, 20.0), 8.0: START},
        then={20.0: [frames("pump"), seen("result/pump/alice", verb="start", phase="rejected")]},
    ),
    row(
        "a stop before the first reading is written all the same",
        given=SSW07 + ALICE,
        sim=RUNS,
        at={0.2: STOP},
        then={5.0: [result("stop confirmed ok"), Paced("pump", 0.2, (0.0,), within_s=0.3)]},
    ),
    row(
        "a stop needs no known identity, and says in whose words it was sent",
        given=SSW07 + ALICE,
        sim={"pump": {"product": "CFW-11"}},
        at={5.0: START, 6.0: STOP},
        then={
            9.0: [
                seen("result/pump/alice", verb="start", phase="rejected"),
                result("stop confirmed ok"),
                final_text("of no known family (FC43 names 'CFW-11 85.0A')"),
                final_text("the stop was sent in the ssw07 format, as configured"),
                frames("pump", STOP_07),
            ]
        },
    ),
    row(
        "a stop leaves the watchdogs of the others their polls, though the motor ignores it",
        given=EIGHT.replace("every_s = 1.0", "every_s = 1.0\nwatchdog_s = 4.0") + ALICE,
        at={3.0: f"pump-1 {RUNNING_07}", 5.0: publish("command/pump-1/alice/stop", client="alice")},
        then={
            16.0: [
                repeated("pump-1", 5.0, count=20),
                never("gateway/event", code="watchdog_unkept"),
            ]
        },
    ),
    row(
        "a stop in a flood of reads goes out before all that wait",
        given=TWO + ALICE,
        at={
            3.0: 19 * [READ],
            3.1: [*5 * [READ], STOP],
        },
        then={6.0: [Paced("pump", 3.1, (0.0,), within_s=0.1), result("stop confirmed ok", starter="pump")]},
    ),
]

GROUPS = [
    row(
        "a group's stop stops every member at once; each has its result, the whole is confirmed with all",
        given=GROUP,
        sim={"pump": QUICK, "fan": QUICK},
        at={3.0: [START, command("fan/alice/start")], 6.0: command("hall/alice/stop", id="all")},
        then={
            9.0: [
                result("stop confirmed ok", starter="hall"),
                msg("result/hall/alice", id="all"),
                msg("result/pump/alice", id="all", verb="stop", phase="confirmed"),
                msg("result/fan/alice", id="all", verb="stop", phase="confirmed"),
                Paced("pump", 6.0, (0.0,)),
                Paced("fan", 6.0, (0.0,)),
            ]
        },
    ),
    row(
        "one member that runs on leaves the whole unconfirmed and is named",
        given=GROUP,
        at={3.0: f"fan {RUNNING_07}", 5.0: publish("command/hall/alice/stop", client="alice")},
        then={
            17.0: [
                result("stop confirmed ok", starter="pump"),
                result("stop unconfirmed not_seen", starter="fan"),
                seen("result/hall/alice", verb="stop", phase="unconfirmed"),
                lambda plant: "" if "fan" in plant.last("result/hall/alice")["text"] else "fan is not named",
            ]
        },
    ),
    row(
        "members that a client may not stop are refused, the others are stopped",
        given=GROUP + operator("carol", starters=("pump",)),
        at={3.0: publish("command/hall/carol/stop", client="carol")},
        then={
            6.0: [
                result("stop confirmed ok", starter="pump"),
                result("stop rejected not_allowed", starter="fan"),
                lambda plant: "" if plant.last("result/hall/carol")["phase"] != "confirmed" else "confirmed",
                frames("pump", STOP_07),
                frames("fan"),
            ]
        },
    ),
    row(
        "who may stop no member may not stop the group",
        given=GROUP + operator("dave", may=("read",)),
        at={3.0: publish("command/hall/dave/stop", client="dave")},
        then={6.0: [result("stop rejected not_allowed", starter="hall"), frames("pump"), frames("fan")]},
    ),
    row(
        "a group is stopped and nothing else",
        given=GROUP,
        at={3.0: command("hall/alice/start")},
        then={6.0: [result("start rejected group_only_stop"), frames("pump"), frames("fan")]},
    ),
    row(
        "a group's stop ends the starts of its members",
        given=GROUP,
        at={3.0: START, 3.02: publish("command/hall/alice/stop", client="alice")},
        then={6.0: [result("stop confirmed ok", starter="hall"), msg("starter/pump/state", state="ready")]},
    ),
    row(
        "a group on a line without a port is not called stopped",
        given=GROUP,
        at={3.0: "line pumps unplug", 5.0: publish("command/hall/alice/stop", client="alice")},
        then={17.0: [never("result/hall/alice", phase="confirmed"), frames("pump"), frames("fan")]},
    ),
    row(
        "a group's stop that is sent again is done again",
        given=GROUP,
        at={3.0: command("hall/alice/stop", id="all"), 6.0: command("hall/alice/stop", id="all")},
        then={9.0: [frames("pump", STOP_07, STOP_07), frames("fan", STOP_07, STOP_07)]},
    ),
]


@pytest.mark.parametrize("row", SCENARIOS + GROUPS)
def test_stops(row: ScenarioRow) -> None:
    play(row)
