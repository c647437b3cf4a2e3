"""Stops: at once, before everything, again and again until the motor is seen to stand."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

import pytest

from tests.rig import (
    RigPlant,
    clean_line,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    publish,
    result,
    results,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
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
    requested_at_most,
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


def case(
    name: str, said: str, at: dict[float, Any], *then: Expectation, until_s: float, **options: Any
) -> Any:
    """The newest result at `until_s` is as said; empty: whatever it is."""
    end = [result(said, starter=options.pop("of", "+"))] if said else []
    given = options.pop("given", SSW07 + ALICE)
    return row(name, given=given, at=at, then={until_s: [*end, *then]}, **options)


def stop_of(path: str) -> Action:
    """A stop with nothing but its topic."""
    return publish(f"command/{path}/stop", client=path.split("/")[1])


RUNNING, AT_REST = f"pump {RUNNING_07}", f"pump {READY_07}"
READY = msg("starter/pump/state", state="ready")
WATCHED = EIGHT.replace("every_s = 1.0", "every_s = 1.0\nwatchdog_s = 4.0") + ALICE

SCENARIOS = [
    case("a stop needs nothing but its topic, is written once and confirmed by what was read after it", "",
         {3.0: START, 6.0: STOP}, results(*(f"{verb} {each}" for verb in ("start", "stop") for each in OK)),
         frames("pump", START_07, STOP_07), final_text("read back from the starter"), READY, clean_line,
         until_s=9.0, sim=RUNS),
    case("a stop reaches the line within the worst time that is published, though seven others are asked", "",
         {5.0: stop_of("pump-8/alice")}, Paced("pump-8", 5.0, (0.0,), within_s=0.078),
         msg("gateway/line/pumps", stop_latency_s={"computed": pytest.approx(0.213, abs=0.001), "stops": 1},
             computed={"stop_latency_s": pytest.approx(0.213, abs=0.001)}),  # as `check` says
         clean_line, until_s=40.0, given=EIGHT.replace("every_s = 1.0", "every_s = 0") + ALICE),
    row(
        "a stop is repeated every half second while the motor runs on, and ends unconfirmed after ten",
        given=SSW07 + ALICE,
        at={3.0: RUNNING, 5.0: STOP},
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
    case("a stop is not confirmed by one reading of a motor at rest between two of a motor that runs",
         "stop written ok", {3.0: RUNNING, 5.0: STOP, 7.02: AT_REST, 7.06: RUNNING}, until_s=9.0),
    case("each stop message has a frame and a final result of its own, and joins the stop under way", "",
         {3.0: RUNNING, 5.0: command("pump/alice/stop"), 5.2: command("pump/bob/stop"),
          6.3: command("pump/alice/stop"), 8.0: "pump VB01 = -"},
         ended("stop", 3), results(*(f"stop {each}" for each in OK), client="bob"),
         Paced("pump", 5.0, (0.0, 0.2, 0.7, 1.2, 1.3, 1.8, 2.3, 2.8), within_s=0.15),
         until_s=10.0, given=SSW07 + ALICE + operator("bob")),
    row(
        "a motor that somebody starts between two stops keeps the second one going",
        given=SSW07 + ALICE,
        at={3.0: RUNNING, 5.0: STOP, 5.1: AT_REST, 7.0: [RUNNING, STOP], 9.2: AT_REST},
        then={
            6.9: ended("stop", 1),
            9.1: ended("stop", 1),
            11.0: [ended("stop", 2), Paced("pump", 7.0, (0.0, 0.5, 1.0, 1.5, 2.0))],
        },
    ),
    case("a stop whose id was used before is carried out again and says that it is a copy", "",
         {3.0: command("pump/alice/stop", id="one"), 6.0: START, 10.0: command("pump/alice/stop", id="one")},
         frames("pump", STOP_07, START_07, STOP_07), msg("result/pump/alice", id="one", duplicate=True),
         READY, until_s=13.0, sim=RUNS),
    case("a stop overtakes a start that waits for its starter: nothing is started", "",
         {3.0: [fault("delay", "pump", 0.08, for_s=0.2), START], 3.02: STOP},
         seen("result/pump/alice", verb="start", phase="rejected", code="stopped_first"),
         written("pump", STOP_07), until_s=8.0),
    case("a stop right after a jog takes the jog back, though no reading has shown it", "stop confirmed ok",
         {3.0: [AT_REST, command("pump/alice/jog", args={"value": True})], 3.2: STOP},
         frames("pump", "05 00 66 ff 00", STOP_07, "05 00 66 00 00"), until_s=9.0, sim=RUNS),
    case("a stop ends a start under way, and no start follows it", "stop confirmed ok",
         {3.0: START, 3.3: STOP}, READY, until_s=9.0, sim=RUNS),
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
    case("a stop of a starter that has gone silent is written until its time ends, and is no_answer",
         "stop unconfirmed no_answer", {5.0: fault("silent", "pump"), 20.0: STOP},
         seen("starter/pump/availability", state="offline"), final_text("may be turning"),
         requested_at_most(50, "pump", since=20.0), until_s=31.0),
    case("a stop of an offline starter is carried out when it comes back in time", "stop confirmed ok",
         {5.0: fault("silent", "pump", for_s=19.0), 20.0: STOP},
         msg("starter/pump/availability", state="online"), until_s=27.0),
    case("a stop that comes while the port is away goes out when it is back", "stop confirmed ok",
         {5.0: "line pumps unplug", 6.0: STOP, 9.0: "line pumps plug"}, event("port_away"), until_s=14.0),
    case("a stop on a line without a port ends after its time, and nothing was written",
         "stop rejected line_down", {5.0: "line pumps unplug", 6.0: STOP}, frames("pump"), until_s=18.0),
    case("a refused stop is repeated, and fails at its deadline with the exception",
         "stop failed server_device_failure", {3.0: fault("refuse", "pump", 4, (5,)), 5.0: STOP},
         repeated("pump", 5.0, count=20), until_s=17.0),
    case("a stop is confirmed over a line that flips bits", "stop confirmed ok",
         {3.0: START, 6.0: [lambda plant: plant.lines["pumps"].noise(0.002), STOP]}, READY, until_s=17.0,
         sim=RUNS),
    row(
        "a stop is written into a line that is never quiet, and its result says so",
        given=SSW07 + ALICE,
        at={3.0: RUNNING, 5.0: chatter(0.002, 20.0), 8.0: STOP},
        then={
            8.6: result("stop written ok"),
            20.0: [
                result("stop unconfirmed not_seen"),
                final_text("another device transmits on the line without a pause"),
                all_stops_sent,
            ],
        },
    ),
    case("nothing but a stop is written into a line that is never quiet", "",
         {5.0: chatter(0.002, 20.0), 8.0: START}, frames("pump"),
         seen("result/pump/alice", verb="start", phase="rejected"), until_s=20.0),
    case("a stop before the first reading is written all the same", "stop confirmed ok", {0.2: STOP},
         Paced("pump", 0.2, (0.0,), within_s=0.3), until_s=5.0, sim=RUNS),
    case("a stop needs no known identity, and says in whose words it was sent", "stop confirmed ok",
         {5.0: START, 6.0: STOP}, seen("result/pump/alice", verb="start", phase="rejected"),
         final_text("of no known family (FC43 names 'CFW-11 85.0A')"),
         final_text("the stop was sent in the ssw07 format, as configured"), frames("pump", STOP_07),
         until_s=9.0, sim={"pump": {"product": "CFW-11"}}),
    case("a stop leaves the watchdogs of the others their polls, though the motor ignores it", "",
         {3.0: f"pump-1 {RUNNING_07}", 5.0: stop_of("pump-1/alice")}, repeated("pump-1", 5.0, count=20),
         never("gateway/event", code="watchdog_unkept"), until_s=16.0, given=WATCHED),
    case("a stop in a flood of reads goes out before all that wait", "stop confirmed ok",
         {3.0: 19 * [READ], 3.1: [*5 * [READ], STOP]}, Paced("pump", 3.1, (0.0,), within_s=0.1),
         until_s=6.0, of="pump", given=TWO + ALICE),
]  # fmt: skip

PORT_LESS = {3.0: "line pumps unplug", 5.0: stop_of("hall/alice")}
GROUPS = [
    case("a group's stop stops every member at once; each has its result, the whole is confirmed with all",
         "stop confirmed ok",
         {3.0: [START, command("fan/alice/start")], 6.0: command("hall/alice/stop", id="all")},
         msg("result/hall/alice", id="all"), msg("result/pump/alice", id="all", phase="confirmed"),
         msg("result/fan/alice", id="all", verb="stop", phase="confirmed"), Paced("pump", 6.0, (0.0,)),
         Paced("fan", 6.0, (0.0,)), until_s=9.0, of="hall", given=GROUP,
         sim={"pump": QUICK, "fan": QUICK}),
    case("one member that runs on leaves the whole unconfirmed and is named", "stop unconfirmed not_all",
         {3.0: f"fan {RUNNING_07}", 5.0: stop_of("hall/alice")}, result("stop confirmed ok", starter="pump"),
         result("stop unconfirmed not_seen", starter="fan"),
         msg("result/hall/alice", text=re.compile("1 of 2 starters are not confirmed: fan$")),
         until_s=17.0, of="hall", given=GROUP),
    case("members that a client may not stop are refused, the others are stopped", "stop unconfirmed not_all",
         {3.0: stop_of("hall/carol")}, result("stop confirmed ok", starter="pump"),
         result("stop rejected not_allowed", starter="fan"), frames("pump", STOP_07), frames("fan"),
         until_s=6.0, of="hall", given=GROUP + operator("carol", starters=("pump",))),
    case("who may stop no member may not stop the group", "stop rejected not_allowed",
         {3.0: stop_of("hall/dave")}, frames("pump"), frames("fan"), until_s=6.0, of="hall",
         given=GROUP + operator("dave", may=("read",))),
    case("a group is stopped and nothing else", "start rejected group_only_stop",
         {3.0: command("hall/alice/start")}, frames("pump"), frames("fan"), until_s=6.0, given=GROUP),
    case("a group's stop ends the starts of its members", "stop confirmed ok",
         {3.0: START, 3.02: stop_of("hall/alice")}, READY, until_s=6.0, of="hall", given=GROUP),
    case("a group on a line without a port is not called stopped", "stop rejected not_all", PORT_LESS,
         frames("pump"), frames("fan"), until_s=17.0, of="hall", given=GROUP),
    case("a group's stop that is sent again is done again", "",
         {3.0: command("hall/alice/stop", id="all"), 6.0: command("hall/alice/stop", id="all")},
         frames("pump", STOP_07, STOP_07), frames("fan", STOP_07, STOP_07), until_s=9.0, given=GROUP),
]  # fmt: skip


test_stops = played(SCENARIOS + GROUPS)
