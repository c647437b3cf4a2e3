"""Starters that go silent and come back, and what that costs the others; watchdogs; the line's statistics."""

from __future__ import annotations

import itertools

import pytest

from gateway.sim.bus.faults import NoReply
from tests.rig import (
    RigPlant,
    apart,
    clean_line,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    reload,
    result,
    row,
    scene,
    seen,
)
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, FOUR, SSW07
from tests.scenarios.line.wires import (
    EIGHT,
    TWO,
    asked_within,
    healed,
    impaired,
    requests_on_wires,
    true_values,
)

WATCHED = EIGHT.replace("every_s = 1.0", "every_s = 5.0\nwatchdog_s = 3.0")
FULL = EIGHT.replace("baud = 19200", "baud = 9600").replace("every_s = 1.0", "every_s = 0.2")


def probed(name: str, since: float, until: float, least_s: float, most_s: float) -> Expectation:
    """The requests to a starter on the wires are as far apart, each of them."""

    def check(plant: RigPlant) -> str:
        found = [at_s for at_s, _ in requests_on_wires(plant, name, since) if at_s <= until]
        apart = [after - before for before, after in itertools.pairwise(found)]
        is_right = len(apart) > 1 and least_s <= min(apart) and max(apart) <= most_s
        return "" if is_right else f"{name} was asked every {[round(each, 2) for each in apart]} s"

    return check


def one_in_four(plant: RigPlant) -> None:
    """Choose replies by chance 1: with one in four a starter whose replies are lost rests for too long."""
    plant.lines["pumps"].bus.impairments.dice.seed(5)


def line_says(**within: tuple[float, float]) -> Expectation:
    """The line's statistics lie within bounds."""

    def check(plant: RigPlant) -> str:
        said = plant.last("gateway/line/pumps")
        wrong = {name: said[name] for name, (low, high) in within.items() if not low <= said[name] <= high}
        return str(wrong or "")

    return check


OFFLINE = [
    row(
        "a starter that is away for long is asked ever less often, in the end every 16 s, but for a tenth",
        given=TWO,
        at={5.0: fault("silent", "pump")},
        then={
            60.0: probed("pump", 10.25, 60.0, 4.0, 17.7),
            200.0: probed("pump", 80.0, 200.0, 13.0, 17.7),
        },
    ),
    row(
        "when it comes back it is online within its back-off, and all its values are good again",
        given=TWO,
        at={5.0: fault("silent", "pump", for_s=100.0)},
        then={
            104.0: msg("starter/pump/availability", state="offline"),
            124.0: [
                msg("starter/pump/availability", state="online"),
                msg("starter/pump/value/current", quality="good"),
                msg("starter/pump/state", state="ready"),
                event("answers_again", "starter/pump/event"),
                true_values,
            ],
        },
    ),
    scene(
        "a starter that was never there is offline, and costs the others nothing",
        TWO,
        {},
        30.0,
        msg("starter/pump/availability", state="offline"),
        msg("starter/fan/availability", state="online"),
        asked_within(1.1, "fan", since=5.0, until=30.0),
        absent=("pump",),
    ),
    row(
        "of a group that lost its supply all are asked at once when the first answers",
        given=EIGHT,
        at={
            5.0: [fault("silent", f"pump-{n}") for n in range(2, 9)],
            100.0: healed,
        },
        then={
            99.0: msg("starter/pump-8/availability", state="offline"),
            120.0: [msg(f"starter/pump-{n}/availability", state="online") for n in range(1, 9)],
        },
    ),
    row(
        "a read of a starter that is away ends within its own time",
        given=TWO + ALICE,
        at={5.0: fault("silent", "pump"), 20.0: command("pump/alice/read", args={"parameter": "P202"})},
        then={27.0: seen("result/pump/alice", verb="read", phase="rejected")},
    ),
]

WATCHDOGS = [
    row(
        "watchdogs do not act where a twentieth of the replies is lost",
        given=WATCHED,
        at={3.1: [one_in_four, impaired(NoReply(), chance=0.05)]},
        then={120.0: asked_within(3.0, since=1.0, until=120.0)},
    ),
    row(
        "a watchdog does not act while a starter receives everything and none of its replies arrives",
        given=WATCHED,
        at={3.1: [fault("lose", f"pump-{n}") for n in (2, 5)]},
        then={60.0: asked_within(3.0, since=1.0, until=60.0)},
    ),
    row(
        "a watchdog that is found in the starter is served, though nothing of it is configured",
        given=SSW07.replace("every_s = 1.0", "every_s = 20.0"),
        sim={"pump": {"settings": {314: 4}}},
        then={60.0: [asked_within(4.0, "pump", since=1.0, until=60.0), frames("pump")]},
    ),
    row(
        "a watchdog that is set through the gateway is served from then on",
        given=SSW07.replace("every_s = 1.0", "every_s = 20.0") + ALICE,
        at={5.0: command("pump/alice/set", args={"parameter": "P314", "value": 3})},
        then={60.0: [result("set confirmed ok"), asked_within(3.0, "pump", since=6.0, until=60.0)]},
    ),
    row(
        "a watchdog that was left for too long is an event",
        given=SSW07.replace("every_s = 1.0", "every_s = 1.0\nwatchdog_s = 2.0"),
        at={10.0: lambda plant: plant.stand_still(5.0)},
        then={30.0: event("watchdog_unkept")},
    ),
    scene(
        "the line says how much its watchdogs need, and who was left longest",
        WATCHED,
        {},
        40.0,
        msg(
            "gateway/line/pumps",
            watchdogs={"longest_share": pytest.approx(0.5, abs=0.15)},
        ),
    ),
]

STATISTICS = [
    scene(
        "a line that is left alone counts answers and nothing else",
        FOUR,
        {},
        65.0,
        line_says(silent=(0, 0), garbled=(0, 0), stray_bytes=(0, 0), utilisation=(0.1, 1.0)),
        lambda plant: _adds_up(plant),
        msg("gateway/line/pumps", is_open=True, stretch=1.0, crashes=0),
    ),
    row(
        "the line's statistics come every 30 s",
        given=SSW07,
        then={100.0: apart("gateway/line/pumps", 29.0, 31.0, since=35.0)},
    ),
    scene(
        "misses, refusals and late replies are counted for their starter",
        EIGHT,
        {
            10.0: [fault("lose", "pump-1", count=3), fault("silent", "pump-4")],
            11.0: [fault("refuse", "pump-2", 4, for_s=0.5), fault("delay", "pump-3", 0.2, count=1)],
        },
        65.0,
        msg(
            "gateway/line/pumps",
            units={
                "1": {"silent": 3, "late": 0, "state": "answering"},
                "2": {"silent": 0, "refused": pytest.approx(3, abs=2)},
                "3": {"late": 1, "response_time_s": {"p50": pytest.approx(0.0125, abs=0.007)}},
                "4": {"state": "silent"},
            },
        ),
    ),
    row(
        "a line that is asked without a pause is full, which is no event",
        given=SSW07.replace("every_s = 1.0", "every_s = 0"),
        then={65.0: [line_says(utilisation=(0.9, 1.0)), never("gateway/event", code="line_saturated")]},
    ),
    row(
        "a line that is full says so once, and again when it has time",
        given=FULL,
        at={90.0: reload(FULL.replace("every_s = 0.2", "every_s = 5.0"))},
        then={
            89.0: seen("gateway/event", code="line_saturated", times=1),
            200.0: event("line_relieved"),
        },
    ),
    row(
        "while a motor ramps it is asked faster, and the line's silences are observed",
        given=TWO,
        at={5.0: "pump VB01 = 0x010B"},
        then={15.0: [asked_within(0.6, "pump", since=6.0, until=15.0), clean_line]},
    ),
]


def _adds_up(plant: RigPlant) -> str:
    said = plant.last("gateway/line/pumps")
    asked = sum(unit["asked"] for unit in said["units"].values())
    counted = said["answered"] + said["silent"] + said["garbled"] + said["refused"]
    is_right = asked == counted == said["polls"] + said["jobs"]
    return "" if is_right else f"{asked} asked, {counted} counted: {said}"


test_a_line_and_its_starters = played(OFFLINE + WATCHDOGS + STATISTICS)
