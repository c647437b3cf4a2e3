"""Which device answers: another family, another device of the family, one in the place of another."""

from __future__ import annotations

import re
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
    play,
    result,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SST, SSW06, SSW07, SSW900

SITES = {"ssw07": ("pump", SSW07), "ssw06": ("fan", SSW06), "ssw900": ("mill", SSW900), "sst": ("belt", SST)}


def swap(name: str, family: str, **options: Any) -> Action:
    return lambda plant: plant.do(lambda: plant.line_of(name).swap(name, family, **options))


def _nothing_was_written(name: str) -> Expectation:
    """Nothing was written to the device."""

    def check(plant: RigPlant) -> str:
        return str(plant.starter(name).writes or "")

    return check


def _wrong_from_the_start(configured: str, there: str) -> Any:
    name, site = SITES[configured]
    return row(
        f"an {there} where an {configured} is configured is named, its values are bad, it gets no start",
        given=site + ALICE,
        sim={name: {"family": there}},
        at={45: command(f"{name}/alice/start")},
        then={
            44: [
                event("identity_mismatch", f"starter/{name}/event", severity="error"),
                msg(f"starter/{name}/state", state="unknown", quality="bad", reason=...),
                never(f"starter/{name}/value/current", quality="good"),
                never(f"starter/{name}/value/running", quality="good"),
            ],
            50: [msg("result/+/alice", verb="start", phase="rejected"), _nothing_was_written(name)],
        },
    )


def _swapped(configured: str, there: str) -> Any:
    name, site = SITES[configured]
    return row(
        f"an {there} after a silence in the place of an {configured} is named; the right one is good again",
        given=site + ALICE,
        at={
            8: fault("silent", name),
            20: [swap(name, there), fault("heal", name)],
            155: command(f"{name}/alice/start"),
            160: fault("silent", name),
            175: [swap(name, configured), fault("heal", name)],
        },
        then={
            154: [
                event("identity_mismatch", f"starter/{name}/event", severity="error"),
                msg(f"starter/{name}/state", state="unknown"),
                never(f"starter/{name}/value/current", since=20, quality="good"),
            ],
            159: [msg("result/+/alice", verb="start", phase="rejected"), _nothing_was_written(name)],
            250: [
                msg(f"starter/{name}/state", quality="good"),
                msg(f"starter/{name}/value/running", value=False, quality="good"),
                seen(f"starter/{name}/event", times=1, code="identity_mismatch"),
            ],
        },
    )


PAIRS = [(one, other) for one in SITES for other in SITES if one != other]
ROWS = [
    *(_wrong_from_the_start(*pair) for pair in PAIRS),
    *(_swapped(*pair) for pair in PAIRS),
    row(
        "a stop goes to a device of another family, too",
        given=SSW07 + ALICE,
        sim={"pump": {"family": "ssw06"}},
        at={40: command("pump/alice/stop")},
        then={55: lambda plant: "" if plant.starter("pump").writes else "nothing was written"},
    ),
    row(
        "another device of the same family is named after a silence; commands wait for `accept`",
        given=SST + ALICE,
        sim={"belt": {"seed": 4, **QUICK}},
        at={
            8: fault("silent", "belt"),
            20: [swap("belt", "sst", seed=77, **QUICK), fault("heal", "belt")],
            60: command("belt/alice/start"),
            63: command("belt/alice/accept"),
        },
        then={
            59: [
                event("identity_changed", "starter/belt/event", severity="error"),
                msg("starter/belt/value/current", quality="good"),
            ],
            62: [result("start rejected identity_changed"), _nothing_was_written("belt")],
            70: [event("identity_accepted", "starter/belt/event"), result("accept confirmed ok")],
        },
    ),
    row(
        "what was known outlives a restart: another device is noticed by the next run",
        given=SST + ALICE,
        sim={"belt": {"seed": 4}},
        at={8: "end", 9: [swap("belt", "sst", seed=77), "start"]},
        then={30: event("identity_changed", "starter/belt/event")},
    ),
    row(
        "the same device after a silence is nothing to be told",
        given=SST,
        at={8: fault("silent", "belt", for_s=20)},
        then={
            80: [
                never("starter/belt/event", code="identity_changed"),
                msg("starter/belt/state", quality="good"),
            ]
        },
    ),
    row(
        "an SSW-06 of another size than configured holds commands",
        given=SSW06.replace('family = "ssw06"', 'family = "ssw06"\nmodel = "SSW-06 820A"') + ALICE,
        sim={"fan": {"model": "SSW-06 312A"}},
        at={20: command("fan/alice/start")},
        then={
            25: [
                event("identity_changed", "starter/fan/event"),
                result("start rejected identity_changed"),
                frames("fan"),
            ]
        },
    ),
    row(
        "an accessory in the other slot than configured holds commands",
        given=SSW900.replace('family = "ssw900"', 'family = "ssw900"\nslot = 1') + ALICE,
        sim={"mill": {"slot": 2}},
        at={20: command("mill/alice/start")},
        then={
            25: [
                event("slot_mismatch", "starter/mill/event", severity="error"),
                result("start rejected slot_mismatch"),
                frames("mill"),
            ]
        },
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
    row(
        "a start that comes while another family answers without a silence is not written",
        given=SSW06 + ALICE,
        sim={"fan": QUICK},
        at={8: [swap("fan", "ssw07", **QUICK), command("fan/alice/start")]},
        then={
            14: [
                never("result/+/alice", phase="written"),
                msg("result/+/alice", phase=re.compile("rejected|failed")),
                frames("fan"),
            ]
        },
    ),
    row(
        "an SSW900 in the place of an SST gets no start without a silence either",
        given=SST + ALICE,
        at={8: [swap("belt", "ssw900"), command("belt/alice/start")]},
        then={
            14: [
                never("result/+/alice", phase="written"),
                msg("result/+/alice", phase=re.compile("rejected|failed")),
                frames("belt"),
            ]
        },
    ),
]


@pytest.mark.parametrize("row", ROWS)
def test_who_answers(row: ScenarioRow) -> None:
    play(row)
