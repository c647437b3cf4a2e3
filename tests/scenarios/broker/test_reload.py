"""A reload: what it changes, what it leaves alone, and what it refuses."""

from __future__ import annotations

import re
from itertools import cycle

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
    reload,
    result,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.rows import Action
from tests.rig.sites import ALICE, QUICK, SSW07, line, operator, starter, table
from tests.scenarios.values.words import answers

START, STOP = "05 00 64 ff 00", "05 00 64 00 00"
FAN = starter("fan", 2, "ssw06")
HALL = SSW07 + FAN
RULE = table("[rules]", starters=["*"], starts_per_hour=1)
YARD = line("yard") + starter("mill", 3, "ssw900")
BELT = starter("belt", 4, "sst")
SHARED_S = 0.02  # what lines share is when their events are handed over, after which a period may change


def untouched(plant: RigPlant) -> str:
    """The first starter and its line have noticed nothing since second 5."""
    for topic in ("starter/pump/availability", "starter/pump/info"):
        if said := [each for each in plant.messages(topic, 5.05) if not each.retain or each.payload]:
            return str(said[0])
    bad = [each for each in plant.messages("starter/pump/value/+", 5.05) if each.json["quality"] == "stale"]
    return str(bad[0]) if bad else clean_line(plant)


def poor_line(name: str, for_s: float) -> Action:
    """Let one request of three be answered, so that the starter stays online."""
    habits = cycle((None, None, b""))
    return answers(name, lambda _: next(habits), for_s=for_s)


CHANGES = [
    row(
        "a starter that comes to an over-full line is known within 5 s, and stays known",
        given=HALL,
        at={
            30.0: reload(
                line()
                + starter("pump", 1, "ssw07", every_s=0.002)
                + starter("blower", 5, "ssw06", every_s=2.0)
            ),
            60.0: "blower control local",
            61.0: "blower keypad start",
        },
        then={
            35.0: retained("starter/blower/state", state="ready"),
            90.0: that(lambda plant: plant.last("gateway/line/pumps")["stretch"] > 5.0),
            100.0: [
                never("starter/blower/state", since=35.0, state="unknown"),
                seen("starter/blower/state", since=61.0, state="running"),
            ],
        },
    ),
    row(
        "a line and starters that are added are polled and named, those that are taken out cleared",
        given=SSW07,
        at={5.0: reload(HALL + YARD), 12.0: reload(SSW07)},
        then={
            11.0: [
                event("reloaded", data={"lines_added": ["yard"], "starters_added": ...}),
                retained("gateway/line/yard", is_open=True),
                retained("starter/fan/availability", state="online"),
                retained("starter/mill/state", quality="good"),
                retained("gateway/info", starters=["pump", "fan", "mill"]),
                untouched,
            ],
            16.0: [
                event("reloaded", data={"lines_removed": ["yard"], "starters_removed": ...}),
                retained("gateway/line/yard"),
                retained("starter/fan/#"),
                retained("starter/mill/#"),
                retained("gateway/info", starters=["pump"]),
                untouched,
            ],
        },
    ),
    row(
        "rights and rules that a reload changes count for the next command, and earlier starts are counted",
        given=SSW07 + operator("bob", may=("stop",)),
        sim={"pump": QUICK},
        at={
            4.0: command("pump/bob/start"),
            5.0: reload(SSW07 + operator("bob")),
            6.0: command("pump/bob/start"),
            9.0: command("pump/bob/stop"),
            12.0: reload(SSW07 + operator("bob", may=("start", "stop")) + RULE),
            13.0: command("pump/bob/reset"),
            14.0: command("pump/bob/start"),
        },
        then={
            4.5: result("start rejected not_allowed"),
            8.0: [result("start confirmed ok"), retained("gateway/info", operators=...)],
            13.5: result("reset rejected not_allowed"),
            15.0: [result("start rejected too_many_starts"), frames("pump", START, STOP), untouched],
        },
    ),
    row(
        "another period of a starter is nothing but another period",
        given=SSW07,
        at={5.0: reload(line() + starter("pump", 1, "ssw07", every_s=0.5))},
        then={9.0: [event("reloaded", data={"starters_paced": ["pump"]}), untouched]},
    ),
    scene(
        "a reload while a start is under way lets it end, and is in force then",
        SSW07 + ALICE,
        {
            5.0: command("pump/alice/start"),
            5.3: reload(line() + starter("pump", 1, "ssw07", model="SSW-07 30.0A") + ALICE),
        },
        25.0,
        seen("result/pump/alice", phase="confirmed", times=1),
        frames("pump", START),
        event("reloaded"),
    ),
    row(
        "a stop goes to where its starter is since a reload, however many have not ended before",
        given=SSW07 + ALICE,
        at={
            4.0: [fault("silent", "pump"), lambda plant: plant.lines["pumps"].add("moved", "ssw07", 5)],
            **{
                at_s: command("pump/alice/stop", fresh=False)
                for at_s in (5.0, 8.0, 11.0, 14.0, 17.0, 20.0, 23.0)
            },
            6.0: reload(line() + starter("pump", 5, "ssw07") + ALICE),
        },
        then={
            22.0: [seen("result/pump/alice", phase="unconfirmed", code="busy"), frames("moved")],
            24.5: [result("stop confirmed ok"), frames("moved", STOP)],
        },
    ),
    row(
        "a start that has waited for longer than a reload does starts no other motor",
        given=line() + starter("pump", 1, "ssw07") + starter("fan", 2, "ssw07") + ALICE,
        at={
            4.0: [poor_line("pump", for_s=16.0), command("pump/alice/start", ttl_s=60)],
            4.5: reload(line() + starter("pump", 2, "ssw07") + starter("fan", 1, "ssw07") + ALICE),
        },
        then={30.0: [event("reloaded"), result("start rejected busy"), frames("1"), frames("2")]},
    ),
    scene(
        "another refresh_s counts for every value at once, on the same connection",
        SSW07,
        {5.0: reload(SSW07 + table("mqtt", url="mqtt://127.0.0.1", refresh_s=10))},
        40.0,
        that(lambda plant: 2 <= len(plant.messages("starter/pump/value/current", 6.0)) <= 4),
        that(lambda plant: len(plant.broker.logins), 1),
    ),
]

LINES = [
    scene(
        "a lost port makes only its own starters offline",
        SSW07 + line("hall") + FAN,
        {5.0: "line hall unplug"},
        12.0,
        event("port_away", severity="error", data={"line": "hall"}),
        msg("starter/fan/availability", state="offline"),
        msg("starter/fan/value/current", quality="stale"),
        retained("gateway/status", state="degraded"),
        untouched,
    ),
    scene(
        "a starter that moves to another line is read there",
        SSW07 + FAN + line("hall") + starter("mill", 3, "ssw900"),
        {5.0: reload(SSW07 + line("hall") + starter("mill", 3, "ssw900") + FAN)},
        15.0,
        retained("starter/fan/info", line="hall"),
        msg("starter/fan/availability", state="online"),
        msg("starter/fan/state", quality="good"),
        untouched,
    ),
]

REFUSALS = [
    scene(
        f"a reload with {what} is refused, says what is wrong, and changes nothing",
        SSW07 + ALICE,
        {5.0: reload(toml), 7.0: command("pump/alice/stop", fresh=False)},
        9.0,
        seen("gateway/event", code="reload_refused", severity="error", times=1),
        seen("gateway/event", code="reload_refused", data={"mistakes": ...}, text=re.compile(word)),
        never("gateway/event", code="reloaded"),
        untouched,
        result("stop confirmed ok"),
    )
    for what, toml, word in (
        ("an unknown key", SSW07 + "wrong = 1\n" + ALICE, "wrong"),
        ("two starters at one address", SSW07 + starter("fan", 1, "ssw06") + ALICE, "address"),
        ("another base", SSW07 + table("mqtt", url="mqtt://127.0.0.1", base="plant/two") + ALICE, "base"),
        (
            "a watchdog that the line cannot keep",
            line() + starter("pump", 1, "ssw900", watchdog_s=0.1) + ALICE,
            "watchdog",
        ),
    )
]


test_a_reload = played(CHANGES + LINES + REFUSALS)


def asked_s(*reloads: str) -> dict[str, list[float]]:
    """Return when each starter of two lines was asked, with these reloads from second 30 on."""
    with RigPlant(HALL + YARD + BELT) as plant:
        plant.run(until=30.0)
        for number, toml in enumerate(reloads, 1):
            plant.reload(toml)
            plant.run(until=30.0 + 3.0 * number)
        plant.run(until=60.0)
        starters = {name: plant.starter(name) for name in ("pump", "fan", "belt")}
        return {name: [at_s for at_s, _ in each.asked] for name, each in starters.items()}


@pytest.mark.parametrize(
    "other",
    [
        HALL + YARD,
        HALL + YARD.replace("baud = 19200", "baud = 19200\nadapter_allowance_s = 0.05") + BELT,
        HALL,
    ],
    ids=["starter gone", "line reopened", "line gone"],
)
def test_a_line_that_stays_is_polled_at_the_same_instants_as_without_a_reload(other: str) -> None:
    undisturbed = asked_s()
    reloaded = asked_s(*3 * (other, HALL + YARD + BELT))

    for name in ("pump", "fan"):
        assert reloaded[name] == pytest.approx(undisturbed[name], abs=SHARED_S)
    assert reloaded["belt"] != undisturbed["belt"]


def test_another_broker_gets_everything_and_the_former_one_the_end() -> None:
    with RigPlant(SSW07 + ALICE) as plant:
        second = plant.other_broker("10.0.0.2")
        plant.run(until=5.0)
        plant.reload(SSW07 + ALICE + table("mqtt", url="mqtt://10.0.0.2", allow_plaintext=True))
        plant.run(until=15.0)

        now = {topic.removeprefix("starters/plant/"): each for topic, each in second.retained.items()}
        assert plant.broker.retained[plant.topic("gateway/status")].json["state"] == "offline"
        assert now["gateway/status"].json["state"] == "online"
        assert now["starter/pump/state"].json["quality"] == "good"
        assert clean_line(plant) == ""
