"""Commands whose starter or line changes, refuses or hides something between two of their own steps."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import count
from typing import Any

import pytest

from tests.rig import RigPlant, command, event, fault, frames, msg, never, played, result, row, scene, seen
from tests.rig.rows import Action, Expectation, act
from tests.rig.sites import ALICE, QUICK, SITES, SSW07, SSW900, line, operator, starter, table
from tests.rig.state import fail_disk, heal_disk, with_document
from tests.scenarios.commands import do
from tests.scenarios.line.wires import chatter
from tests.scenarios.values.words import refuse_rows

SITE = SSW07 + ALICE
START, RUN_OFF, JOG_OFF = "05 00 64 ff 00", "05 00 64 00 00", "05 00 66 00 00"
RESET_0, RESET_1 = "05 00 6b 00 00", "05 00 6b ff 00"
WHOLE = RUN_OFF, JOG_OFF, RESET_0, RESET_1
READY, RUNS = "pump VB01 = 0x4102", "pump VB01 = 0x5123"
READS, WRITES = ("01", "02", "03", "04"), ("05", "06", "0f", "10")
TAKEN, NOT_TAKEN = re.compile("so that it cannot start later"), re.compile("did not confirm run = 0")

Answer = int | str | None  # an exception code, `unheard`, `lost`; None: as usual
Rule = Callable[[str, Callable[..., None]], Answer]


def answers(name: str, rule: Rule) -> Action:
    """Have a rule say what becomes of each request (PDU in hex); it may do something by words, too."""

    def begin(plant: RigPlant) -> None:
        found = plant.starter(name)
        own = found._own

        def do_these(*actions: Action) -> None:
            for each in actions:
                act(plant, each)

        def answer(pdu: bytes, now_s: float) -> bytes | None:
            said = rule(pdu.hex(" "), do_these)
            if isinstance(said, int):
                return bytes((pdu[0] | 0x80, said))
            reply = None if said == "unheard" else own(pdu, now_s)
            return None if said == "lost" else reply

        found._own = answer

    return begin


def when(start: str, said: Answer, *, first: int = 10_000) -> Rule:
    """Say so of the first requests that begin with these bytes."""
    numbers = count()
    return lambda pdu, _: said if pdu.startswith(start) and next(numbers) < first else None


def after(pdu: str, *actions: Action, said: Answer = None) -> Rule:
    """Do something as a request comes, once."""
    left = [1]

    def rule(found: str, do_these: Callable[..., None]) -> Answer:
        if found != pdu or not left:
            return None
        left.clear()
        do_these(*actions)
        return said

    return rule


def following(pdu: str, said: Answer, *functions: str, first: int = 10_000) -> Rule:
    """Say so of the first requests with these function codes that come after this one."""
    begun: list[str] = []
    numbers = count()

    def rule(found: str, _: object) -> Answer:
        if found == pdu:
            begun.append(pdu)
            return None
        return said if begun and found[:2] in functions and next(numbers) < first else None

    return rule


def hides_run(pdu: str, _: object) -> Answer:
    """Refuse every read that contains the run command: coil 100 or one above it, or VB03."""
    first, length = (int(part.replace(" ", ""), 16) for part in (pdu[3:8], pdu[-5:]))
    end = first + length
    return 2 if (pdu[:2] == "01" and end > 100) or (pdu[:2] == "03" and first <= 5003 < end) else None


def once_written(name: str, pdu: str, action: Action) -> Action:
    """Do something right after a write has reached a starter."""

    def wait(plant: RigPlant) -> None:
        while pdu not in [each for _, each in plant.starter(name).writes]:
            plant.run(until=plant.world.now_s() + 0.001)
        act(plant, action)

    return wait


def hindered(
    name: str, words: str, said: str, rule: Rule | None, *then: Expectation, at: Any = None, **more: Any
) -> Any:
    """`words` is sent at 4 s, from when on the rule holds; its result at 16 s is as said."""
    starter_name, verb = words.split()
    begin = [answers(starter_name, rule)] if rule else []
    happens = {4.0: [*begin, do(words, **more.pop("args", {}))], **(at or {})}
    end = result(f"{verb} {said}", starter=starter_name)
    given, until_s = SITES[starter_name] + ALICE, more.pop("until_s", 16.0)
    return row(name, **{"given": given, **more}, at=happens, then={until_s: [end, *then]})


def reset(name: str, rule: Rule, said: str, *pdus: str, text: str = "") -> Any:
    """A reset after a trip, while a rule holds; the end of it, and what was written."""
    text_of_it = msg("result/pump/alice", text=re.compile(text))
    trip: dict[float, Action] = {2.0: "pump trip E05"}
    return hindered(name, "pump reset", said, rule, frames("pump", *pdus), text_of_it, at=trip)


CLEARED = [  # S1: run = 0 before all else, and nothing after it when it is not taken
    reset("a jog that is not set up may be refused", when(JOG_OFF, 3), "confirmed ok", *WHOLE),
    reset("where run = 0 is refused nothing else is written", when(RUN_OFF, 3), "failed run_not_cleared",
          RUN_OFF, text="nothing else was written"),
    reset("where run = 0 is not answered nothing else is written", when("05", "unheard"),
          "unconfirmed no_answer", RUN_OFF),
    hindered("where run = 0 is acknowledged and still reads 1 nothing else is written", "pump reset",
             "failed run_not_cleared", None, frames("pump", RUN_OFF),
             at={2.0: ["pump trip E05", "pump VB03 = 0x0001"]}),
    reset("where reading run is refused the acknowledgement and a motor at rest suffice", hides_run,
          "confirmed ok", *WHOLE),
    reset("a reset that is refused has failed", when(RESET_1, 3), "failed illegal_data_value", *WHOLE),
    reset("a motor that somebody starts during a reset is not stopped; it may be turning, says the result",
          after(RESET_1, RUNS), "unconfirmed not_seen", *WHOLE,
          text="the motor may be turning; run = 0 was written first"),
    hindered("a later write that would wait for the starter's earlier replies is handed over again",
             "pump reset", "confirmed ok", following(JOG_OFF, "lost", *READS, first=4),
             frames("pump", *WHOLE), given=SITE.replace("every_s = 1.0", "every_s = 0"),
             at={2.0: "pump trip E05"}),
    hindered("after run = 0 that an SST does not answer nothing is written, nor its configuration ended",
             "belt configure", "unconfirmed no_answer", when("05 00 00 00 00", "unheard", first=1),
             frames("belt", "05 00 00 00 00"), args={"R41": 30}),
]  # fmt: skip


TAKE_BACK = RUN_OFF, JOG_OFF  # one frame
NO_EVENT = never("starter/pump/event", code="stop_unconfirmed")
EVENT = event("stop_unconfirmed", "starter/pump/event")


def to_local() -> Rule:
    """Switch to local mode as a start comes."""
    return after(START, "pump VB01 = 0x4002")


def not_acting(
    name: str, text: re.Pattern[str], rule: Rule | None, *then: Expectation, at: Any = None, **more: Any
) -> Any:
    """A start that does not act: the text of its end within 3 s of its deadline, and the outcome."""
    begin = [answers("pump", rule)] if rule else []
    happens = {2.0: READY, 3.0: [*begin, command("pump/alice/start", id="1")], **(at or {})}
    end = [result("start unconfirmed not_seen"), msg("result/pump/alice", text=text)]
    return row(name, given=SITE, at=happens, then={9.5: end, 18.0: list(then)}, **more)


def taken_back_for(seconds: float) -> Expectation:
    """After the start, run = 0 and jog = 0 went out every half second for so long, and nothing else."""

    def check(plant: RigPlant) -> str:
        (_, start), *frames = plant.starter("pump").writes
        found = [pdu for _, pdu in frames]
        is_whole = start == START and found == (len(found) * [*TAKE_BACK])[: len(found)]
        lasted_s = frames[-1][0] - frames[0][0]
        is_paced = len(found) // 2 == pytest.approx(2 * seconds + 1, abs=1)
        return "" if is_whole and is_paced and abs(lasted_s - seconds) < 0.7 else f"{found} in {lasted_s} s"

    return check


def no_write_after(at_s: float) -> Expectation:
    return lambda plant: "" if plant.starter("pump").writes[-1][0] < at_s else "it was written"


TAKING_BACK = [  # S2
    not_acting("it is audited as the gateway's, makes no token, and leaves the starter free", TAKEN, None,
               seen("audit", times=2, verb="stop", source="gateway", client="alice", id="1"),
               seen("gateway/fresh", since=7.0, times=12), NO_EVENT,
               result("reset rejected no_fault_to_reset"), frames("pump", START, *TAKE_BACK),
               at={10.0: do("pump reset")}),
    not_acting("run = 0 is written again while it is lost", TAKEN,
               following(START, "unheard", *WRITES, first=2),
               frames("pump", START, *TAKE_BACK, *TAKE_BACK), NO_EVENT),
    not_acting("a lost acknowledgement of run = 0 is made up for by what is read", TAKEN,
               following(START, "lost", *WRITES), taken_back_for(10.0), NO_EVENT),
    not_acting("in local mode nothing says that run = 0 was taken, and an event says so at the end",
               NOT_TAKEN, to_local(), taken_back_for(10.0), EVENT),
    not_acting("a jog = 0 that is refused takes nothing from it", TAKEN, when(JOG_OFF, 2),
               frames("pump", START, *TAKE_BACK), NO_EVENT),
    not_acting("a motor that begins to run meanwhile is stopped", NOT_TAKEN,
               after(RUN_OFF, RUNS, said="unheard"), taken_back_for(3.0), NO_EVENT,
               msg("starter/pump/state", state="ready"), at={9.3: READY}),
    not_acting("a newer command ends it", NOT_TAKEN, to_local(), taken_back_for(4.0), NO_EVENT,
               result("reset rejected no_fault_to_reset"),
               seen("audit", verb="stop", source="gateway", decision="unconfirmed", code="busy", times=1),
               at={10.5: do("pump reset")}),
    not_acting("until its end the starter is busy", NOT_TAKEN, to_local(),
               seen("result/pump/alice", verb="reset", code="busy"), at={7.5: do("pump reset")}),
    not_acting("a starter that cannot be read is left alone", re.compile("act later: send a stop"), None,
               frames("pump", START), at={3.2: fault("lose", "pump")}),
    row(
        "a stop meanwhile has a frame and an end of its own, and ends the start",
        given=SITE,
        at={2.0: READY, 3.0: [answers("pump", to_local()), do("pump start")],
            7.5: command("pump/alice/stop", id="2", fresh=False)},
        then={
            10.0: [
                seen("result/pump/alice", verb="start", phase="unconfirmed", code="stopped_first"),
                seen("result/pump/alice", verb="stop", id="2", phase="confirmed"),
                seen("gateway/fresh", since=7.49, times=3),
            ]
        },
    ),
    hindered("the end of the gateway ends it, and nothing more is written", "pump start",
             "unconfirmed shutting_down", to_local(), no_write_after(8.7),
             at={2.0: READY, 8.6: "end"}),
    hindered("a general disable of an SSW900 stands when a start is taken back", "mill start",
             "unconfirmed not_seen", after("06 02 ad 00 13", "mill S5.1.1 = 0x0100"),
             msg("result/mill/alice", text=TAKEN), frames("mill", "06 02 ad 00 13", "06 02 ad 00 10"),
             at={2.0: "mill S5.1.1 = 0x0102"}),
]  # fmt: skip


def turning_about() -> Rule:
    """Show another direction after each reading of a command, in which the slots come last."""
    words = [0x0902, 0x0102]

    def rule(pdu: str, do_these: Callable[..., None]) -> Answer:
        if pdu.startswith("03 01 4f 00 02"):
            words.reverse()
            do_these(f"mill S5.1.1 = {words[0]}")
        return None

    return rule


IN_CONFIGURATION = "05 00 01 ff 00"
DECIDED = [
    hindered("a read of a starter that falls silent ends at once, and gives no value", "pump read",
             "rejected no_answer", None, never("result/pump/alice", phase="confirmed"),
             args={"parameter": "P003"}, at={3.99: fault("lose", "pump", count=5)}),
    *(
        hindered(f"a start of {name} outlasts two lost replies in a row", f"{name} start", "confirmed ok",
                 None, sim={name: QUICK}, at={3.99: fault("lose", name, count=2)})
        for name in SITES
    ),
    hindered("what no two readings in a row agree on is not decided", "mill start",
             "rejected readings_disagree", turning_about(), frames("mill"),
             at={3.9: "mill S5.1.1 = 0x0902"}),
    row(
        "what was read before a standstill decides nothing",
        given=SITE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start", ttl_s=30),
            3.035: ["pump control local", lambda plant: plant.stand_still(7.0)],  # read, not yet written
        },
        then={20.0: [result("start rejected in_local"), frames("pump")]},
    ),
    row(
        "a reading of before a standstill is not the first of the two that decide",
        given=SSW900 + ALICE,
        at={
            3.9: "mill S5.1.1 = 0x0902",
            4.0: command("mill/alice/start", ttl_s=60),
            4.06: [answers("mill", turning_about()), lambda plant: plant.stand_still(8.0)],
        },
        then={16.0: [result("start rejected readings_disagree"), frames("mill")]},
    ),
    row(
        "a start whose starter does not answer before its time is over is expired",
        given=SITE,
        at={3.0: [fault("lose", "pump", for_s=2.2), command("pump/alice/start", ttl_s=0.2)]},
        then={5.0: [result("start rejected expired"), frames("pump")]},
    ),
    row(
        "a lock ends a start that is not yet written",
        given=SITE + operator("bob"),
        at={3.0: command("pump/bob/start"), 3.01: do("pump lock", reason="belt is off")},
        then={
            6.0: [
                result("start rejected locked", client="bob"),
                result("lock confirmed ok", client="alice"),
                frames("pump"),
            ]
        },
    ),
    row(
        "a start whose line is lost before the write is rejected",
        given=SITE,
        at={3.0: do("pump start"), 3.01: "line pumps unplug"},
        then={8.0: [msg("result/pump/alice", phase="rejected", code=re.compile("line_down|no_answer")),
                    frames("pump")]},
    ),
    hindered("a stop that comes while the frame of a start is on its way ends the start as unconfirmed",
             "pump start", "unconfirmed stopped_first", None, sim={"pump": QUICK}, until_s=4.07,
             at={4.05: command("pump/alice/stop", id=None, fresh=False)}),
    hindered("a line that is never quiet from the second of four writes on leaves a command unconfirmed",
             "pump reset", "unconfirmed no_answer", None, frames("pump", RUN_OFF, JOG_OFF),
             at={2.0: "pump trip E05", 4.001: once_written("pump", JOG_OFF, chatter(0.002, 20.0))}),
    hindered("an SST that refuses a register is taken out of its configuration mode", "belt configure",
             "failed illegal_data_value", when("06", 3),
             lambda plant: "it is still in it" if plant.starter("belt").unit.is_configuring else "",
             args={"R41": 60}),
    hindered("an SST that does not enter its configuration mode is left as it was", "belt configure",
             "unconfirmed not_seen", when(IN_CONFIGURATION, "unheard"),
             frames("belt", "05 00 00 00 00", IN_CONFIGURATION, "05 00 01 00 00")),
]  # fmt: skip


def stops_in(plant: RigPlant, begin_s: float, end_s: float) -> int:
    """Return how many frames of a stop came in that time."""
    return sum(pdu == RUN_OFF and begin_s < at_s < end_s for at_s, pdu in plant.starter("pump").writes)


def stop(id_: str | None = None) -> Action:
    return command("pump/alice/stop", id=id_, fresh=False)


STOPS = [
    row(
        "without its status a command word is not known whole: a stop clears its bits alone",
        given=SSW900 + ALICE,
        at={6.0: refuse_rows("mill", {680}), 12.0: do("mill stop")},
        then={12.4: frames("mill", "16 02 ad ff fa 00 00")},
    ),
    row(
        "a stop that is sent again under its id while it is under way has one end, and each copy a frame",
        given=SITE,
        sim={"pump": QUICK},
        at={3.0: [do("pump start")], 5.0: [RUNS, *[stop("1")] * 3], 6.0: [stop("1")] * 3},
        then={
            6.5: [
                seen("result/pump/alice", id="1", duplicate=True),
                lambda plant: "" if stops_in(plant, 5.0, 5.2) == 3 else "not 3 frames at 5 s",
                lambda plant: "" if stops_in(plant, 6.0, 6.2) >= 3 else "not 3 frames at 6 s",
            ],
            17.0: [
                seen("result/pump/alice", times=1, id="1", phase="unconfirmed"),
                seen("result/pump/alice", times=1, id="1", phase="accepted", duplicate=False),
            ],
        },
    ),
    row(
        "a stop that is never acknowledged is confirmed at its deadline by what was read",
        given=SITE,
        at={3.0: [answers("pump", when("05", "lost")), stop("1")]},
        then={
            12.5: [
                result("stop written ok"),
                lambda plant: "" if len(plant.starter("pump").writes) > 15 else "not again",
            ],
            14.5: result("stop confirmed ok"),
        },
    ),
    row(
        "a starter that is silent for long before the end of a stop was not seen to stop",
        given=SITE,
        at={3.0: [answers("pump", when("05", "lost")), stop("1")], 9.0: fault("silent", "pump")},
        then={15.0: result("stop unconfirmed not_seen")},
    ),
    scene(
        "the end of the gateway ends a stop under way, of a group too, and writes nothing more",
        SITE + table("[group]", name="hall", starters=["*"]),
        {3.0: RUNS, 4.0: [stop("1"), command("hall/alice/stop")], 4.6: "end"},
        5.5,
        seen("result/pump/alice", verb="stop", phase="unconfirmed", code="shutting_down"),
        seen("result/hall/alice", phase="unconfirmed"),
        lambda plant: "" if all(at_s < 4.7 for at_s, _ in plant.starter("pump").writes) else "late",
    ),
    row(
        "a disabled starter is stopped, and stays disabled",
        given=SSW07.replace("every_s", "enabled = false\nevery_s") + ALICE,
        at={3.0: stop("1")},
        then={
            6.0: [result("stop confirmed ok"), frames("pump", RUN_OFF)],
            30.0: never("starter/pump/availability", state="online"),
        },
    ),
]


DISK = [
    row(
        "a lock that cannot be stored holds, and an unlocking that cannot be stored does not",
        given=SITE,
        at={
            3.0: [fail_disk, do("pump lock", reason="belt")],
            6.0: heal_disk,
            15.0: do("pump start"),
            17.0: [fail_disk, do("pump unlock")],
            20.0: heal_disk,
            30.0: do("pump start"),
        },
        then={
            5.9: [result("lock failed not_kept"), event("store_unavailable")],
            16.9: [event("store_available"), result("start rejected locked")],
            19.9: result("unlock failed not_kept"),
            32.0: [result("start rejected locked"), frames("pump")],
        },
    ),
    row(
        "an acceptance that cannot be stored counts for this run",
        given=SITE.replace('"ssw07"', '"ssw07"\nmodel = "SSW-07 130A"'),
        sim={"pump": QUICK},
        at={15.0: [fail_disk, do("pump accept")], 18.0: heal_disk, 30.0: do("pump start")},
        then={19.0: result("accept failed not_kept"), 34.0: result("start confirmed ok")},
    ),
    scene(
        "with a damaged document of fingerprints every starter counts as new, and an event says so",
        SITE,
        {10.0: ["end", with_document("fingerprints", '{"pump": 7}'), "start"]},
        20.0,
        event("memory_damaged", text=re.compile("of the fingerprints is damaged")),
        never("starter/pump/event", code="identity_changed"),
    ),
]


LIMITS = [
    row(
        "of more starts than a line can serve while they are fresh the first act and the others expire",
        given=line() + "".join(starter(f"p{n}", n, "ssw07") for n in range(1, 53)) + ALICE,
        sim={f"p{n}": QUICK for n in range(1, 53)},
        at={9.0: [command(f"p{n}/alice/start") for n in range(1, 53)]},
        then={20.0: lambda plant: some_expired(plant.results()[-156:])},
    ),
]


def some_expired(results: list[str]) -> str:
    """Most were confirmed; what was not written in its time has expired, and all have an end."""
    ends = [
        results.count(f"start {end}") for end in ("confirmed ok", "rejected expired", "unconfirmed not_seen")
    ]
    return "" if ends[0] >= 25 and ends[1] >= 10 and sum(ends) == 52 else str(ends)


test_a_command_that_is_hindered = played(LIMITS + CLEARED + TAKING_BACK + DECIDED + STOPS + DISK)
