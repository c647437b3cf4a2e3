"""The words of a stop by family, also where its state, its family or its functions are not known."""

from __future__ import annotations

from typing import Any

import pytest

from tests.rig import RigPlant, ScenarioRow, command, fault, frames, never, play, publish, result, row, seen
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SSW07, SSW900, line, starter
from tests.scenarios.line.wires import STOP_07, final_text, without, written

MILL_1 = line() + starter("mill", 3, "ssw900", slot=1)
MILL_2 = line() + starter("mill", 3, "ssw900", slot=2)
MASK_1, MASK_2 = "16 02 ad ff fa 00 00", "16 02 ae ff fa 00 00"  # 685, 686: run and jog to 0, nothing else
OWN = {"ssw06": ["06 13 8b 01 00"], "ssw07": [STOP_07], "ssw900": [MASK_1, MASK_2]}
FAMILY_NAMES = (*OWN, "sst")
SILENT_READS = without(1, 2, 3, 4)


def stop(name: str) -> Action:
    return publish(f"command/{name}/alice/stop", client="alice")


def stands(name: str, *, is_enabled: bool = True, is_remote: bool = True) -> Expectation:
    """The motor is not driven; general enable and remote are as they were."""

    def check(plant: RigPlant) -> str:
        unit: Any = plant.starter(name).unit
        is_right = not unit.motor.is_turned_on and (unit.is_enabled, unit.is_remote) == (
            is_enabled,
            is_remote,
        )
        return "" if is_right else f"driven {unit.motor.is_turned_on}, {unit.is_enabled}, {unit.is_remote}"

    return check


def is_not_driven(name: str) -> Expectation:
    return lambda plant: "it is driven" if plant.starter(name).unit.motor.is_turned_on else ""


def swapped(name: str, family: str) -> Action:
    return lambda plant: plant.do(lambda: plant.line_of(name).swap(name, family))


SCENARIOS = [
    row(
        "an SSW900 in slot 2 gets the word of slot 2",
        given=MILL_2 + ALICE,
        sim={"mill": {"slot": 2, **QUICK}},
        at={3.0: command("mill/alice/start"), 7.0: stop("mill")},
        then={10.0: [result("stop confirmed ok"), frames("mill", "06 02 ae 00 13", "06 02 ae 00 12")]},
    ),
    row(
        "before the first reading an SSW900 of slot 1 is stopped by clearing run and jog in its word",
        given=MILL_1 + ALICE,
        sim={"mill": QUICK},
        at={0.05: stop("mill")},
        then={3.0: [result("stop confirmed ok"), lambda plant: _first(plant, MASK_1)]},
    ),
    row(
        "of slot 2 in the other one",
        given=MILL_2 + ALICE,
        sim={"mill": {"slot": 2, **QUICK}},
        at={0.05: stop("mill")},
        then={3.0: [result("stop confirmed ok"), lambda plant: _first(plant, MASK_2)]},
    ),
    row(
        "of an SSW900 whose slot is unknown the words of both slots are cleared",
        given=SSW900 + ALICE,
        at={0.01: [SILENT_READS, stop("mill")]},
        then={12.0: [written("mill", MASK_1, MASK_2), stands("mill"), result("stop unconfirmed not_seen")]},
    ),
    row(
        "a word that was read more than 2 s ago is not written again: a running SSW900 is stopped by mask",
        given=MILL_1 + ALICE,
        sim={"mill": QUICK},
        at={3.0: command("mill/alice/start"), 7.0: SILENT_READS, 12.0: stop("mill")},
        then={24.0: [written("mill", "06 02 ad 00 13", MASK_1), stands("mill")]},
    ),
    row(
        "an SSW900 without function 22 gets the word that was read last, however old, without run",
        given=MILL_1 + ALICE,
        sim={"mill": QUICK},
        at={
            3.0: command("mill/alice/start"),
            7.0: [SILENT_READS, fault("refuse", "mill", 1, (22,))],
            12.0: stop("mill"),
        },
        then={
            24.0: [
                written("mill", "06 02 ad 00 13", MASK_1, "06 02 ad 00 12"),
                stands("mill"),
            ]
        },
    ),
    row(
        "an SSW900 without function 22 that was never read is not said to be stopped",
        given=MILL_1 + ALICE,
        at={0.01: [SILENT_READS, fault("refuse", "mill", 1, (22,)), stop("mill")]},
        then={12.0: [written("mill", MASK_1), lambda plant: _phase(plant, "unconfirmed")]},
    ),
    row(
        "a stop takes an SST out of its configuration mode, and what configures it ends",
        given=line() + starter("belt", 4, "sst") + ALICE,
        at={3.0: command("belt/alice/configure"), 3.6: stop("belt")},
        then={
            9.0: [
                lambda plant: "" if "05 00 01 ff 00" in _written(plant, "belt") else "it was not in it",
                lambda plant: "" if _written(plant, "belt")[-1] != "05 00 01 ff 00" else "it is still in it",
                seen("result/belt/alice", verb="configure", code="stopped_first"),
                result("stop confirmed ok"),
            ]
        },
    ),
]
WRONG = (
    [
        row(
            f"an {found} in the place of an {family} is stopped in its own words, and the result says so",
            given=line() + starter("pump", 1, family) + ALICE,
            sim={"pump": {"family": found, **QUICK}},
            at={5.0: stop("pump")},
            then={
                9.0: [
                    result("stop confirmed ok"),
                    final_text(f"proved to be {found}, not {family}"),
                    frames("pump", *OWN[found]),
                ]
            },
        )
        for family in OWN
        for found in OWN
        if found != family
    ]
    + [
        row(
            f"an {found} in the place of an {family} does not name itself: no stop of it is confirmed",
            given=line() + starter("pump", 1, family) + ALICE,
            sim={"pump": {"family": found}},
            at={5.0: stop("pump")},
            then={
                17.0: [
                    never("result/pump/alice", phase="confirmed"),
                ]
            },
        )
        for family, found in (("ssw06", "sst"), ("ssw07", "sst"), ("ssw900", "sst"), ("sst", "ssw07"))
    ]
    + [
        row(
            f"no word of a stop for an {family} drives the motor of an {found} that is not named yet",
            given=line() + starter("pump", 1, family) + ALICE,
            sim={"pump": {"family": found, **QUICK}},
            at={0.01: stop("pump")},
            then={4.0: [is_not_driven("pump"), lambda plant: "" if _written(plant, "pump") else "no stop"]},
        )
        for family in FAMILY_NAMES
        for found in FAMILY_NAMES
        if found != family
    ]
    + [
        row(
            "what a device proved to be is of no account once its port was lost",
            given=SSW07 + ALICE,
            sim={"pump": {"family": "ssw06"}},
            at={
                5.0: ["line pumps unplug", swapped("pump", "ssw07"), "line pumps plug", stop("pump")],
            },
            then={8.0: [result("stop confirmed ok"), frames("pump", STOP_07, since=5.0)]},
        )
    ]
)


def _written(plant: RigPlant, name: str) -> list[str]:
    return [pdu for _, pdu in plant.starter(name).writes]


def _first(plant: RigPlant, pdu: str, name: str = "mill") -> str:
    found = [each for _, each in plant.starter(name).writes]
    return "" if found and found[0] == pdu else str(found[:4])


def _phase(plant: RigPlant, phase: str) -> str:
    body = plant.messages("result/+/+")[-1].json
    return "" if body["phase"] == phase else str(body)


@pytest.mark.parametrize("row", SCENARIOS + WRONG)
def test_words_of_a_stop(row: ScenarioRow) -> None:
    play(row)
