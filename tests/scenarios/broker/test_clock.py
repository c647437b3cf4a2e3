"""Clocks and standstills: what proves a command fresh, and what a step, a sleep or a stall does to it."""

from __future__ import annotations

from collections.abc import Callable

from tests.rig import (
    RigPlant,
    command,
    event,
    frames,
    msg,
    never,
    played,
    result,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.sites import ALICE, QUICK, SSW07, operator, table
from tests.scenarios.broker.support import count
from tests.scenarios.commands import issued, old_token

START = "05 00 64 ff 00"
BRIDGE = operator("dispatch", freshness="issued_at")
AUTO = table("gateway", name="plant", state_dir="state", clock="auto")


def step(by_s: float) -> Callable[[RigPlant], None]:
    """Set the wall clock ahead, or back."""

    def act(plant: RigPlant) -> None:
        plant.world.stepped_s += by_s

    return act


def asleep(for_s: float) -> Callable[[RigPlant], None]:
    """Let the machine have slept; no clock but that of the boot knows."""

    def act(plant: RigPlant) -> None:
        plant.world.slept_s += for_s

    return act


def synchronised(is_it: bool) -> Callable[[RigPlant], None]:
    return lambda plant: setattr(plant, "is_clock_synchronised", is_it)


DATED = [
    row(
        f"a command that is dated {ago_s} s ago, with {ttl_s} s to live, is {code}",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={70.0: issued(ago_s, ttl_s=ttl_s)},
        then={74.0: [result(f"start {code}"), frames("pump", *([START] if code == "confirmed ok" else []))]},
    )
    for ago_s, ttl_s, code in (
        (0.0, 5, "confirmed ok"),
        (3.0, 5, "confirmed ok"),
        (6.0, 5, "rejected expired"),
        (50.0, 60, "confirmed ok"),
        (75.0, 60, "rejected expired"),
        (-1.0, 5, "confirmed ok"),  # a sender's clock may be a little ahead
        (-30.0, 5, "rejected not_fresh"),
    )
]

PROOFS = [
    row(
        "a command that nothing dates is refused, but a read",
        given=SSW07 + ALICE,
        at={
            4.0: command("pump/alice/start", fresh=False),
            6.0: command("pump/alice/read", fresh=False, args={"parameter": "P003"}),
        },
        then={5.0: result("start rejected not_fresh"), 8.0: [result("read confirmed ok"), frames("pump")]},
    ),
    row(
        "a token is too old after five seconds, or after what the command says",
        given=SSW07 + ALICE,
        at={
            10.0: old_token("pump/alice/start", of_s=4.0),
            11.0: old_token("pump/alice/start", of_s=4.0, ttl_s=60),
        },
        then={10.5: [result("start rejected expired"), frames("pump")], 14.0: [result("start confirmed ok")]},
    ),
    row(
        "an expired proof is saved by no other",
        given=SSW07 + ALICE,
        at={70.0: lambda plant: issued(20.0, token=plant.token())(plant)},  # type: ignore[operator]
        then={72.0: [result("start rejected expired"), frames("pump")]},
    ),
    row(
        "who has freshness by issued_at is refused with a token alone, and taken with a date",
        given=SSW07 + BRIDGE,
        sim={"pump": QUICK},
        at={68.0: command("pump/dispatch/start"), 70.0: issued(1.0, "pump/dispatch/start")},
        then={
            69.0: result("start rejected not_fresh", client="dispatch"),
            74.0: [result("start confirmed ok", client="dispatch"), frames("pump", START)],
        },
    ),
    *(
        row(
            f"a date of before this {what} is refused, however long it may live",
            given=SSW07 + ALICE,
            at={70.0: ends, 76.0: issued(30.0, ttl_s=60)},
            then={78.0: [result("start rejected before_connection"), frames("pump")]},
        )
        for what, ends in (("run", "restart"), ("connection", "broker drops"))
    ),
]

STEPS = [
    row(
        f"after the clock was set {by_s:+.0f} s no date counts for a minute, but a token does",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            70.0: step(by_s),
            75.0: issued(0.0),
            80.0: command("pump/alice/start"),
            84.0: command("pump/alice/stop"),
            150.0: issued(0.0),
        },
        then={
            76.0: [result("start rejected not_fresh"), event("clock_stepped", severity="warning")],
            84.0: result("start confirmed ok"),
            155.0: [event("clock_trusted"), result("start confirmed ok")],
        },
    )
    for by_s in (3600.0, -3.0)
]

CLOCKS = [
    row(
        "while the kernel does not call the clock synchronised no date counts, but a token does",
        given=AUTO + SSW07 + ALICE,
        sim={"pump": QUICK},
        before=synchronised(False),
        at={70.0: issued(0.0), 72.0: command("pump/alice/start")},
        then={71.0: result("start rejected not_fresh"), 76.0: result("start confirmed ok")},
    ),
    row(
        "a clock that was set between two runs makes no id unknown",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            4.0: command("pump/alice/start", id="one"),
            8.0: ["end", step(-86400.0), "start"],
            14.0: command("pump/alice/start", id="one"),
        },
        then={15.0: [msg("result/pump/alice", duplicate=True, phase="confirmed"), frames("pump", START)]},
    ),
    scene(
        "a step of the clock changes no token, no poll and no watch over the starter",
        SSW07 + ALICE,
        {10.0: step(7200.0), 20.0: step(-7200.0)},
        40.0,
        never("starter/pump/availability", since=5.0),
        never("starter/pump/value/current", since=5.0, quality="stale"),
        msg("gateway/status", state="online"),
    ),
]

STANDSTILLS = [
    scene(
        "after the machine slept no token of before counts, and the status has another boot",
        SSW07 + ALICE,
        {5.0: asleep(60.0), 7.0: old_token("pump/alice/start", of_s=4.0, ttl_s=60)},
        8.0,
        event("stood_still", severity="warning"),
        result("start rejected not_fresh"),
        frames("pump"),
        that(lambda plant: len({m.json["boot"] for m in plant.messages("gateway/status")}) > 1),
    ),
    row(
        "a start that came while the process stood still is refused, a stop stops; the next token starts",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            5.0: [
                lambda plant: plant.stand_still(8.0),
                command("pump/alice/start", ttl_s=60),
                command("pump/alice/stop", fresh=False),
            ],
            20.0: command("pump/alice/start"),
        },
        then={
            20.0: [
                seen("result/pump/alice", verb="start", phase="rejected"),
                seen("result/pump/alice", verb="stop", phase="confirmed"),
                that(lambda plant: START not in [pdu for _, pdu in plant.starter("pump").writes]),
            ],
            24.0: [result("start confirmed ok"), frames("pump", START, since=20.0)],
        },
    ),
]

HEARTBEAT = [
    scene(
        "a token comes each second, retained with QoS 0",
        SSW07,
        {},
        20.0,
        count("gateway/fresh", 21, at_least=18),
        retained("gateway/fresh", token=..., time=..., qos=0),
    ),
]


test_freshness = played(DATED + PROOFS + STEPS + CLOCKS + STANDSTILLS + HEARTBEAT)
