"""What can go wrong on a line, and what answers it: requests, replies, noise, strangers, the port."""

from __future__ import annotations

from gateway.sim.bus.faults import Late, Noisy, NoReply
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
    row,
    scene,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, FOUR, QUICK, SSW07
from tests.scenarios.line.wires import (
    EIGHT,
    READY_07,
    RUNNING_07,
    START_07,
    STOP_07,
    TWO,
    InOrder,
    asked_within,
    asked_within_sweeps,
    chatter,
    faults_together,
    healed,
    impaired,
    requests_on_wires,
    states_only,
    true_values,
    twin,
    without,
)

GUARDED = EIGHT.replace("every_s = 1.0", "every_s = 1.0\nwatchdog_s = 3.0")
OUTSIDE = "socket://10.0.0.5:4001"
SOCKET = TWO.replace("/dev/pumps", OUTSIDE)
CALM = [never("starter/+/availability", since=3.1), never("starter/+/event", since=3.1)]


def opened(count: int) -> Expectation:
    """The port was opened so often."""
    return lambda plant: "" if (n := plant.lines["pumps"].bus.opened) == count else f"opened {n} times"


def asked_its_name(count: int) -> Expectation:
    """FC43 was put to the pump so often."""
    return lambda plant: (
        "" if (n := sum(pdu[0] == 0x2B for _, pdu in plant.starter("pump").asked)) == count else f"{n} times"
    )


def delivers_late(plant: RigPlant) -> None:
    """Let the way to the line be a connection, whose bytes may arrive late and that can be reset."""
    port = plant.lines["pumps"].bus._port
    port.reset = lambda: port.lose("reset")  # type: ignore[attr-defined, union-attr]


def late_by(count: int, seconds: float, name: str = "pump") -> Action:
    """So many replies come later."""
    return fault("delay", name, seconds, count=count)


LOST = [
    *(
        row(
            f"lost replies, {count} in a row, are no lost starter: the next poll comes as planned",
            given=SSW07,
            at={3.1: fault("lose", "pump", count=count)},
            then={30.0: [*CALM, asked_within(gap_s, "pump", since=3.1, until=30.0), true_values, clean_line]},
        )
        for count, gap_s in ((1, 1.1), (3, 2.5))
    ),
    *(
        row(
            f"where {share:.0%} of the replies are lost no value is wrong, and none is left for {most_s} s",
            given=FOUR,
            at={3.1: impaired(NoReply(), chance=share)},
            then={120.0: [asked_within(most_s, since=3.1, until=120.0), true_values, clean_line, *also]},
        )
        for share, most_s, also in (
            (0.05, 4.0, [never("starter/+/availability", since=3.1, state="offline")]),
            (0.3, 20.0, []),
        )
    ),
    row(
        "a read is repeated once when its reply is corrupted, not twice",
        given=SSW07,
        at={3.1: fault("cut", "pump", count=2)},
        then={
            3.28: lambda plant: (
                "" if (sent := len(requests_on_wires(plant, "pump", 3.1))) == 2 else f"{sent} requests"
            ),
            35.0: [*CALM, true_values, clean_line, msg("gateway/line/pumps", garbled=2)],
        },
    ),
    row(
        "a write is not repeated when its acknowledgement is corrupted: what is read decides",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 3.05: fault("cut", "pump", count=2)},
        then={12.0: [result("start confirmed ok"), frames("pump", START_07)]},
    ),
    scene(
        "of corrupted frames in both directions no value, state or command comes out wrong",
        FOUR,
        {3.1: lambda plant: plant.lines["pumps"].noise(0.001)},
        120.0,
        true_values,
        states_only("ready", "not_ready", "unknown"),
        *[frames(name) for name in ("pump", "fan", "mill", "belt")],
        lambda p: _counted(p, "garbled"),
    ),
]

LATE = [
    row(
        "a state is as old as the delay and two periods, and never wrong, while replies come 0.3 s late",
        given=SSW07,
        at={3.0: f"pump {READY_07}", 4.0: [f"pump {RUNNING_07}", impaired(Late(15.0), chance=0.2)]},
        then={3.9: msg("starter/pump/state", state="ready"), 9.0: msg("starter/pump/state", state="running")},
    ),
    row(
        "an old acknowledgement of a stop does not confirm a later one",
        given=SSW07 + ALICE,
        at={
            3.0: f"pump {RUNNING_07}",
            5.0: [late_by(1, 3.0), publish("command/pump/alice/stop", client="alice")],
        },
        then={14.9: result("stop written ok"), 20.0: result("stop unconfirmed not_seen")},
    ),
    row(
        "a starter that was asked often while it was away is believed again at once",
        given=TWO.replace("every_s = 1.0", "every_s = 1.0\nwatchdog_s = 3.0"),
        at={5.0: fault("silent", "pump", for_s=30.0)},
        then={
            34.0: msg("starter/pump/availability", state="offline"),
            38.0: [
                msg("starter/pump/availability", state="online"),
                msg("starter/pump/value/current", quality="good"),
            ],
        },
    ),
    row(
        "a reply that comes after its port was lost and opened again is no answer either",
        given=FOUR,
        at={3.1: impaired(Late(40.0)), 3.3: "line pumps unplug", 3.8: [healed, "line pumps plug"]},
        then={30.0: [true_values, msg("starter/pump/availability", state="online")]},
    ),
    row(
        "a starter that answers later than its manual says for half a minute is not lost",
        given=SSW07,
        at={3.1: fault("delay", "pump", 0.25, for_s=15.0)},
        then={40.0: [never("starter/pump/availability", since=3.1, state="offline"), true_values]},
    ),
    row(
        "a starter that always answers too late is offline in the end, and the event says so",
        given=SSW07,
        at={3.1: fault("delay", "pump", 0.25)},
        then={60.0: [msg("starter/pump/availability", state="offline"), event("late_replies"), true_values]},
    ),
]

NOISE = [
    *(
        row(
            f"stray bytes at every reply cost nothing: {before.hex()} before it, {after.hex()} after it",
            given=FOUR,
            at={3.1: lambda plant, at=(before, after): stray_at_replies(plant, *at)},
            then={20.0: [*CALM, true_values, asked_within(1.1, "pump", since=3.1, until=20.0)]},
        )
        for before, after in ((b"\x00", b""), (b"\xff\x00", b""), (b"", b"\x00"))
    ),
    row(
        "a start and a stop are confirmed though a stray byte comes before every acknowledgement",
        given=FOUR + ALICE,
        sim={"pump": QUICK},
        at={
            3.1: lambda plant: stray_at_replies(plant, b"\x00"),
            4.0: command("pump/alice/start"),
            7.0: publish("command/pump/alice/stop", client="alice"),
        },
        then={
            6.9: result("start confirmed ok"),
            12.0: [result("stop confirmed ok"), frames("pump", START_07, STOP_07)],
        },
    ),
    scene(
        "stray bytes between the frames are counted and dropped",
        SSW07,
        {3.1: chatter(0.9, 20.0, "00")},
        60.0,
        never("starter/+/availability", since=3.1),
        true_values,
        lambda p: _counted(p, "stray_bytes"),
    ),
    scene(
        "an adapter that echoes is found out: starters are online, starts and stops are confirmed",
        FOUR + ALICE,
        {
            0.001: "line pumps echo",
            4.0: command("pump/alice/start"),
            7.0: publish("command/pump/alice/stop", client="alice"),
        },
        12.0,
        *[msg(f"starter/{name}/availability", state="online") for name in ("pump", "fan", "mill", "belt")],
        frames("pump", START_07, STOP_07),
        result("stop confirmed ok"),
        sim={"pump": QUICK},
    ),
    row(
        "a device that sends without end keeps polls waiting, and is named; nothing wrong is read",
        given=TWO,
        at={5.0: chatter(0.002, 30.0)},
        then={
            20.0: [event("foreign_traffic"), msg("starter/pump/availability", state="offline"), true_values],
            60.0: [
                msg("starter/pump/availability", state="online"),
                msg("starter/pump/value/current", quality="good"),
            ],
        },
    ),
    row(
        "noise on a whole line is named by the cable, and no address is accused",
        given=FOUR,
        at={3.1: impaired(Noisy(0.004))},
        then={300.0: [event("cable"), never("gateway/event", code="address_conflict"), true_values]},
    ),
]

STRANGERS = [
    scene(
        "two starters with one address are named, once",
        TWO,
        {5.0: twin(1)},
        60.0,
        seen("gateway/event", code="address_conflict", times=1),
        never("starter/fan/availability", since=3.1),
    ),
    scene(
        "a second master is named once, and what it reads of others is no value of a starter",
        TWO,
        {5.0: chatter(0.45, 60.0, "03 02 51 23", unit=7)},
        60.0,
        seen("gateway/event", code="foreign_traffic", times=1),
        true_values,
        states_only("ready", "not_ready", "unknown"),
    ),
    scene(
        "replies of one starter that are late, lost or corrupted are no conflict of addresses",
        TWO,
        {5.0: lambda plant: plant.lines["pumps"].bus.impair(1, InOrder(*[0.03] * 5))},
        120.0,
        never("gateway/event", code="address_conflict"),
        never("gateway/event", code="foreign_traffic"),
    ),
    scene(
        "a starter that answers in another's name gives that one no value",
        TWO,
        {5.0: [f"fan {RUNNING_07}", fault("impersonate", "fan", 1)]},
        60.0,
        states_only("ready", "not_ready", "unknown", name="pump"),
        msg("starter/fan/availability", state="offline"),
    ),
]

PORT = [
    row(
        "an adapter that is pulled out leaves nothing good; when it is back all is read again",
        given=TWO,
        at={5.0: "line pumps unplug", 30.0: "line pumps plug"},
        then={
            20.0: [
                event("port_away"),
                msg("starter/pump/value/current", quality="stale"),
                msg("gateway/line/pumps", is_open=False),
            ],
            40.0: [
                msg("starter/pump/availability", state="online"),
                msg("starter/fan/value/current", quality="good"),
                msg("gateway/line/pumps", is_open=True),
                true_values,
            ],
        },
    ),
    row(
        "a port on which no starter answers is closed and opened again, and named once",
        given=TWO,
        at={5.0: [fault("silent", "pump"), fault("silent", "fan")]},
        then={
            19.0: opened(1),
            24.0: [
                event("port_deaf"),
                lambda p: "" if p.lines["pumps"].bus.opened > 1 else "not opened again",
            ],
            120.0: [seen("gateway/event", code="port_deaf", times=1), opened(4)],  # ever less often
        },
    ),
    scene(
        "a port is not opened again while one starter answers",
        TWO,
        {5.0: fault("silent", "pump")},
        60.0,
        opened(1),
        never("gateway/event", code="port_deaf"),
        never("starter/fan/availability", since=3.1),
    ),
    scene(
        "the way to a serial server is reset at once when a start is not answered, so it cannot act later",
        SOCKET + ALICE,
        {2.0: delivers_late, 3.0: [without(5), command("pump/alice/start")]},
        10.0,
        opened(2),
        never("result/pump/alice", phase="confirmed"),
        never("gateway/event", code="port_away"),
        asked_its_name(2),  # another starter may be behind the new connection
        msg("starter/pump/state", quality="good"),
        never("starter/+/availability", since=2.9, state="offline"),
    ),
    *(
        row(
            f"it is reset too for any other write that is not answered in time: {words}",
            given=SOCKET + ALICE,
            at={2.0: delivers_late, 3.0: [without(5, 6), command(f"pump/alice/{verb}", **fields)]},
            then={15.0: [opened(2), never("result/pump/alice", phase="confirmed")]},
        )
        for words, verb, fields in (
            ("a setting", "set", {"args": {"parameter": "P314", "value": 20}}),
            ("a jog", "jog", {"args": {"value": True}}),
        )
    ),
    row(
        "it is not reset for a read that is not answered",
        given=SOCKET,
        at={2.0: delivers_late, 5.0: fault("lose", "pump", count=3)},
        then={12.0: [opened(1), never("starter/+/availability", since=3.1)]},
    ),
    row(
        "it is not reset for a stop, which may act at any time",
        given=SOCKET + ALICE,
        at={
            2.0: delivers_late,
            5.0: [fault("lose", "pump", for_s=1.0), publish("command/pump/alice/stop", client="alice")],
        },
        then={10.0: [opened(1), result("stop confirmed ok")]},
    ),
]

REFUSED = [
    row(
        f"exception {code}, now and then, changes nothing",
        given=SSW07,
        at={3.1: fault("refuse", "pump", code, for_s=0.3), 20.0: fault("refuse", "pump", code, for_s=0.3)},
        then={40.0: [never("starter/pump/availability", since=3.1), true_values]},
    )
    for code in (1, 2, 3, 4, 5, 6, 8, 10, 11)
] + [
    row(
        f"refusals by exception {code} that come late give no row up",
        given=FOUR,
        at={
            second: [fault("refuse", name, code, for_s=0.2), fault("delay", name, 0.6, count=1)]
            for name, first in (("pump", 5.1), ("fan", 20.1), ("mill", 35.1), ("belt", 50.1))
            for second in (first, first + 1.0, first + 2.0)
        },
        then={90.0: [never("starter/+/value/+", since=3.1, quality="bad"), true_values]},
    )
    for code in (1, 2, 3)
]

TOGETHER = [
    scene(
        f"where all goes wrong now and then no starter waits longer than three sweeps and 1 s, {words}",
        site,
        {3.1: faults_together(0.025, seed)},
        45.0,
        asked_within_sweeps(3.0, 1.0, since=3.1, until=45.0),
        asked_within(most_s, since=3.1, until=45.0),
        true_values,
        never("gateway/event", code="address_conflict"),
        never("gateway/event", code="watchdog_unkept"),
    )
    for seed in range(1, 11)
    for words, site, most_s in (
        (f"without watchdogs, chance {seed}", EIGHT, 16.0),
        (f"with watchdogs of 3 s, chance {seed}", GUARDED, 3.0),
    )
]


def stray_at_replies(plant: RigPlant, before: bytes = b"", after: bytes = b"") -> None:
    """Put bytes at each reply, as a driver does when its transmitter is switched."""
    bus = plant.lines["pumps"].bus
    transmit = bus._transmit
    bus._transmit = lambda address, data: transmit(address, before + data + after)  # type: ignore[method-assign]


def _counted(plant: RigPlant, what: str) -> str:
    return "" if plant.last("gateway/line/pumps")[what] else f"{what} is 0"


test_faults_of_a_line = played(LOST + LATE + NOISE + STRANGERS + PORT + REFUSED + TOGETHER)
