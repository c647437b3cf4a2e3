"""Which device answers: another family, another device of the family, one in the place of another."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    played,
    result,
    row,
    scene,
    seen,
)
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, QUICK, SST, SSW06, SSW07, SSW900
from tests.scenarios.values.words import (
    answers,
    is_deaf_after_fc43,
    is_silent_to_fc43,
    names_itself,
    nothing_written,
)

VB00 = (5000).to_bytes(2, "big")
SITES = {"ssw07": ("pump", SSW07), "ssw06": ("fan", SSW06), "ssw900": ("mill", SSW900), "sst": ("belt", SST)}


swap = partial(fault, "swap")


def named_as_another(name: str, there: str) -> Expectation:
    """One event says so; an SST's refusals may come too late to be one (100 ms, not 20)."""
    if there == "sst":
        return event(re.compile("identity_mismatch|identity_unknown"), f"starter/{name}/event")
    return seen(f"starter/{name}/event", times=1, code="identity_mismatch", severity="error")


def _swapped(configured: str, there: str) -> Any:
    name, site = SITES[configured]
    return row(
        f"an {there} after a silence in the place of an {configured} is named; the right one is good again",
        given=site + ALICE,
        at={
            8: fault("silent", name),
            20: [swap(name, there), fault("heal", name)],
            80: command(f"{name}/alice/start"),
            85: fault("silent", name),
            100: [swap(name, configured), fault("heal", name)],
        },
        then={
            79: [
                named_as_another(name, there),
                msg(f"starter/{name}/state", state="unknown", reason=...),
                never(f"starter/{name}/value/current", since=20, quality="good"),
            ],
            84: [msg("result/+/alice", verb="start", phase="rejected"), nothing_written(name)],
            130: [
                msg(f"starter/{name}/state", quality="good"),
                msg(f"starter/{name}/value/running", value=False, quality="good"),
            ],
        },
    )


def _swapped_at_once(configured: str, there: str) -> ScenarioRow:
    name, site = SITES[configured]
    start = command(f"{name}/alice/start")
    return scene(
        f"an {there} in the place of an {configured}, without a silence between, gets no start",
        site + ALICE,
        {8: [swap(name, there), start], 30: start},
        45,
        never("result/+/alice", phase="written"),
        seen("result/+/alice", times=2, phase=re.compile("rejected|failed")),
        nothing_written(name),
    )


def _another_of_its_family(family: str, ours: dict[str, Any], its: dict[str, Any], field: str) -> ScenarioRow:
    name, site = SITES[family]
    return row(
        f"another {family} than in the run before is known by its {field}: it is read and can be stopped",
        given=site + ALICE,
        sim={name: ours},
        at={
            8: ["end", swap(name, family, **its), "start"],
            20: command(f"{name}/alice/start"),
            30: command(f"{name}/alice/stop"),
        },
        then={
            19: seen(
                f"starter/{name}/event",
                times=1,
                code="identity_changed",
                severity="error",
                text=re.compile(f"{field} was"),
                data={"known": {field: ...}, "seen": {field: ...}},
            ),
            25: [result("start rejected identity_changed"), nothing_written(name)],
            45: [result("stop confirmed ok"), msg(f"starter/{name}/value/current", quality="good")],
        },
    )


def _not_as_configured(family: str, key: str, configured: str, its: dict[str, Any], code: str) -> ScenarioRow:
    name, site = SITES[family]
    return row(
        f"an {family} with another {key} than configured holds commands",
        given=site.replace(f'family = "{family}"', f'family = "{family}"\n{key} = {configured}') + ALICE,
        sim={name: its},
        at={20: command(f"{name}/alice/start")},
        then={25: [event(code, f"starter/{name}/event"), result(f"start rejected {code}"), frames(name)]},
    )


def asked_its_name(*at_s: float) -> Expectation:
    """FC43 was put to the pump at about these times and no others."""

    def check(plant: RigPlant) -> str:
        found = [at_s for at_s, pdu in plant.starter("pump").asked if pdu[0] == 0x2B]
        return "" if found == pytest.approx(at_s, abs=0.5) else str(found)

    return check


OTHERS: list[tuple[str, dict[str, Any], dict[str, Any], str]] = [
    ("ssw06", {"model": "SSW-06 85A"}, {"model": "SSW-06 130A"}, "rated_current"),
    ("ssw07", {"firmware": "1.60"}, {"firmware": "1.70"}, "firmware"),
    ("ssw07", {"model": "SSW-07 85A"}, {"model": "SSW-07 130A"}, "model"),
    ("ssw900", {"serial_number": 1}, {"serial_number": 2}, "serial"),
    ("ssw900", {"rated_current_a": 105.0}, {"rated_current_a": 950.0}, "rated_current"),
    ("ssw900", {"firmware": "1.20"}, {"firmware": "1.30"}, "firmware"),
    ("sst", {"serial_number": 1}, {"serial_number": 2}, "serial"),
]
PAIRS = [(one, other) for one in SITES for other in SITES if one != other]
ALIKE = ("ssw07", "ssw06")  # by the readings of a command: coil 100 means run on both
ROWS = [
    *(_swapped(*pair) for pair in PAIRS),
    *(_swapped_at_once(*pair) for pair in PAIRS if pair != ALIKE),
    *(_another_of_its_family(*each) for each in OTHERS),
    _not_as_configured("ssw06", "model", '"SSW-06 820A"', {"model": "SSW-06 312A"}, "identity_changed"),
    _not_as_configured("ssw900", "slot", "1", {"slot": 2}, "slot_mismatch"),
    *(
        row(
            f"a device with the registers of an SSW-08 that {said} is read, but takes no command but a stop",
            given=SSW07 + ALICE,
            at={0: habit, 20: command("pump/alice/start"), 30: command("pump/alice/stop")},
            then={
                29: [
                    event("identity_unknown", "starter/pump/event", severity="warning"),
                    msg("starter/pump/value/current", quality="good"),
                    result("start rejected identity_unknown"),
                    nothing_written("pump"),
                ],
                45: result("stop confirmed ok"),
            },
        )
        for habit, said in (
            (is_silent_to_fc43("pump"), "ignores FC43"),
            (fault("refuse", "pump", 1, (43,)), "refuses FC43"),
        )
    ),
    *(
        scene(
            f"an {there} behind a port that was opened again at once is named",
            SITES[configured][1] + ALICE,
            {
                8: ["line pumps unplug", swap(SITES[configured][0], there)],
                8.2: "line pumps plug",
            },
            60,
            event("identity_mismatch", f"starter/{SITES[configured][0]}/event"),
            never(f"starter/{SITES[configured][0]}/value/running", since=9, quality="good"),
        )
        for configured, there in (("ssw07", "ssw06"), ("ssw900", "ssw07"))
    ),
    row(
        "another device of the same family is named after a silence; the one that is accepted stays known",
        given=SST + ALICE,
        sim={"belt": {"seed": 4, **QUICK}},
        at={
            8: fault("silent", "belt"),
            20: [swap("belt", "sst", seed=77, **QUICK), fault("heal", "belt")],
            60: command("belt/alice/start"),
            63: command("belt/alice/accept"),
            72: "restart",
        },
        then={
            59: [
                event("identity_changed", "starter/belt/event", severity="error"),
                msg("starter/belt/value/current", quality="good"),
            ],
            62: [result("start rejected identity_changed"), nothing_written("belt")],
            70: [
                event("identity_accepted", "starter/belt/event"),
                result("accept confirmed ok"),
                seen("audit", verb="accept", before={"serial": ...}, after={"serial": ...}),
            ],
            90: seen("starter/belt/event", times=1, code="identity_changed"),
        },
    ),
    row(
        "the right one that comes back needs no `accept`",
        given=SSW07 + ALICE,
        sim={"pump": {"firmware": "1.60", **QUICK}},
        at={
            8: ["end", swap("pump", "ssw07", firmware="1.70", **QUICK), "start"],
            20: ["end", swap("pump", "ssw07", firmware="1.60", **QUICK), "start"],
            30: command("pump/alice/accept"),
            32: command("pump/alice/start"),
        },
        then={31: result("accept rejected nothing_to_accept"), 40: result("start confirmed ok")},
    ),
    scene(
        "a device of another family can be read raw, and says why its values mean nothing",
        SSW07 + ALICE,
        {20: command("pump/alice/read", args={"parameter": "P003"})},
        25,
        msg(
            "result/+/alice",
            verb="read",
            phase="confirmed",
            value=None,
            raw=[0],
            reason=re.compile("not ssw07"),
        ),
        msg("starter/pump/availability", state="degraded", reason=re.compile("it is ssw06")),
        sim={"pump": {"family": "ssw06"}},
    ),
    row(
        "a starter that refuses to say its name is asked three times, and again an hour later",
        given=SSW07.replace("every_s = 1.0", "every_s = 10.0"),
        at={0: fault("refuse", "pump", 1, (43,), for_s=60)},
        then={
            3600: [
                asked_its_name(0.2, 2.3, 6.3),
                seen("starter/pump/event", times=1, code="identity_unknown"),
            ],
            3700: msg("starter/pump/info", model=re.compile("SSW-07")),
        },
    ),
    scene(
        "one that goes offline after each question for its name is asked again, and is then read",
        SSW07,
        {0: is_deaf_after_fc43("pump", 15.0)},
        300,
        seen("starter/pump/availability", times=2, state="offline", reason=re.compile("no reply")),
        asked_its_name(0.2, 19.0),
        msg("starter/pump/state", quality="good"),
        msg("starter/pump/availability", state="online"),
    ),
    row(
        "one whose name was corrupted once is asked again 2 s later: its values are good, a start acts",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={0: names_itself("pump", "CFW-11", for_s=1.0), 5: command("pump/alice/start")},
        then={
            2: event("identity_mismatch", "starter/pump/event"),
            5: [msg("starter/pump/state", quality="good"), msg("starter/pump/availability", state="online")],
            10: result("start confirmed ok"),
        },
    ),
    *(
        row(
            f"an {family} that comes back without a silence is known after as long as it was away at most",
            given=SITES[family][1] + ALICE,
            sim={SITES[family][0]: {"family": there, **its}},
            at={25: swap(SITES[family][0], family, **QUICK), 52: command(f"{SITES[family][0]}/alice/start")},
            then={
                24: event("identity_mismatch", f"starter/{SITES[family][0]}/event"),
                52: msg(f"starter/{SITES[family][0]}/state", quality="good"),
                58: result("start confirmed ok"),
            },
        )
        for family, there, its in (
            ("ssw07", "ssw06", {}),
            ("ssw06", "ssw07", {}),
            ("ssw900", "ssw06", {}),
            ("sst", "ssw07", {}),
        )
    ),
    row(
        "one that comes back after a device without FC43 is asked its name before its values are good",
        given=SSW07 + ALICE,
        sim={"pump": {"family": "ssw900"}},
        at={0: fault("refuse", "pump", 1, (43,), for_s=25), 25: swap("pump", "ssw07", **QUICK)},
        then={
            24: event("identity_mismatch", "starter/pump/event"),
            60: [
                msg("starter/pump/state", quality="good"),
                msg("starter/pump/info", model=re.compile("SSW-07")),
                never("starter/pump/event", code="identity_unknown"),
            ],
        },
    ),
    scene(
        "one that is known for another family by its registers is asked its name once, though asked again",
        SSW07,
        {0: is_silent_to_fc43("pump")},
        300,
        asked_its_name(0.2),
        seen("starter/pump/event", times=1, code="identity_mismatch"),
        sim={"pump": {"family": "ssw06"}},
    ),
    scene(
        "one of another family that gives no answer when it is asked again stays known for it: a stop does",
        SSW07 + ALICE,
        {
            3: answers("pump", lambda pdu: None if pdu[0] == 0x2B or pdu[1:3] == VB00 else b"", for_s=60),
            30: command("pump/alice/stop"),
        },
        60,
        seen("starter/pump/event", times=1, code="identity_mismatch"),
        never("starter/pump/event", code="identity_unknown"),
        result("stop confirmed ok"),
        sim={"pump": {"family": "ssw06"}},
    ),
    row(
        "no value is good before it is known who answers",
        given=SSW07,
        at={0: fault("refuse", "pump", 1, (43,))},
        then={
            0.2: never("starter/pump/value/current", quality="good"),
            10: msg("starter/pump/state", quality="good"),
        },
    ),
]


test_who_answers = played(ROWS)
