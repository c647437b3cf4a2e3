"""The words of a stop by family, also where its state, its family or its functions are not known."""

from __future__ import annotations

from typing import Any

from tests.rig import (
    RigPlant,
    command,
    fault,
    frames,
    msg,
    never,
    played,
    publish,
    result,
    row,
    seen,
)
from tests.rig.rows import Action, Expectation
from tests.rig.sites import ALICE, QUICK, SST, SSW07, SSW900, line, starter
from tests.scenarios.line.wires import STOP_07, final_text, without, written

MILL_1 = line() + starter("mill", 3, "ssw900", slot=1)
MILL_2 = line() + starter("mill", 3, "ssw900", slot=2)
MASK_1, MASK_2 = "16 02 ad ff fa 00 00", "16 02 ae ff fa 00 00"  # 685, 686: run and jog to 0, nothing else
OWN = {"ssw06": ["06 13 8b 01 00"], "ssw07": [STOP_07], "ssw900": [MASK_1, MASK_2]}
SILENT_READS = without(1, 2, 3, 4)


def stop(name: str) -> Action:
    return publish(f"command/{name}/alice/stop", client="alice")


def begins_with(pdu: str) -> Expectation:
    return lambda plant: "" if _written(plant, "mill")[:1] == [pdu] else str(_written(plant, "mill")[:4])


def in_and_out_of_configuration(plant: RigPlant) -> str:
    found = _written(plant, "belt")
    return "" if "05 00 01 ff 00" in found[:-1] and found[-1] != "05 00 01 ff 00" else str(found)


def _written(plant: RigPlant, name: str) -> list[str]:
    return [pdu for _, pdu in plant.starter(name).writes]


def stands(plant: RigPlant) -> str:
    """The motor of the mill is not driven; general enable and remote are as they were."""
    unit: Any = plant.starter("mill").unit
    found = unit.motor.is_turned_on, unit.is_enabled, unit.is_remote
    return "" if found == (False, True, True) else f"driven, enabled, remote: {found}"


def is_not_driven(plant: RigPlant) -> str:
    """A stop was written, and the motor is not driven."""
    if not _written(plant, "pump"):
        return "no stop"
    return "it is driven" if plant.starter("pump").unit.motor.is_turned_on else ""


def case(
    name: str, at: dict[float, Any], until_s: float, *then: Expectation, given: str = MILL_1, **sim: Any
) -> Any:
    """A starter and what happens to it; what must be the case at `until_s`."""
    starter_name = given.split('name = "')[2].split('"')[0]
    return row(name, given=given + ALICE, sim={starter_name: {**QUICK, **sim}}, at=at, then={until_s: then})


def in_place_of(family: str) -> str:
    return line() + starter("pump", 1, family)


CONFIRMED = result("stop confirmed ok")
START = command("mill/alice/start")
NO_MASK = fault("refuse", "mill", 1, (22,))
SCENARIOS = [
    case("an SSW900 in slot 2 gets the word of slot 2", {3.0: command("mill/alice/start"), 7.0: stop("mill")},
         10.0, CONFIRMED, frames("mill", "06 02 ae 00 13", "06 02 ae 00 12"), given=MILL_2, slot=2),
    case("before the first reading an SSW900 of slot 1 is stopped by clearing run and jog in its word",
         {0.05: stop("mill")}, 3.0, CONFIRMED, begins_with(MASK_1)),
    case("of slot 2 in the other one", {0.05: stop("mill")}, 3.0, CONFIRMED, begins_with(MASK_2),
         given=MILL_2, slot=2),
    case("of an SSW900 whose slot is unknown the words of both slots are cleared",
         {0.01: [SILENT_READS, stop("mill")]}, 12.0, written("mill", MASK_1, MASK_2), stands,
         result("stop unconfirmed not_seen"), given=SSW900),
    case("a word that was read more than 2 s ago is not written again: a running SSW900 is stopped by mask",
         {3.0: START, 7.0: SILENT_READS, 12.0: stop("mill")}, 24.0, written("mill", "06 02 ad 00 13", MASK_1),
         stands),
    case("an SSW900 without function 22 gets the word that was read last, however old, without run",
         {3.0: START, 7.0: [SILENT_READS, NO_MASK], 12.0: stop("mill")}, 24.0,
         written("mill", "06 02 ad 00 13", MASK_1, "06 02 ad 00 12"), stands),
    case("an SSW900 without function 22 that was never read is not said to be stopped",
         {0.01: [SILENT_READS, NO_MASK, stop("mill")]}, 12.0, written("mill", MASK_1),
         msg("result/mill/alice", phase="unconfirmed")),
    case("a stop takes an SST out of its configuration mode, and what configures it ends",
         {3.0: command("belt/alice/configure"), 3.6: stop("belt")}, 9.0, in_and_out_of_configuration,
         seen("result/belt/alice", verb="configure", code="stopped_first"), CONFIRMED, given=SST),
]  # fmt: skip
WRONG = [
    *(
        case(f"an {found} in the place of an {family} is stopped in its own words, and the result says so",
             {5.0: stop("pump")}, 9.0, CONFIRMED, final_text(f"proved to be {found}, not {family}"),
             frames("pump", *OWN[found]), given=in_place_of(family), family=found)
        for family in OWN
        for found in OWN
        if found != family
    ),
    *(
        case(f"an {found} in the place of an {family} does not name itself: no stop of it is confirmed",
             {5.0: stop("pump")}, 17.0, never("result/pump/alice", phase="confirmed"),
             given=in_place_of(family), family=found)
        for family, found in (("ssw06", "sst"), ("ssw07", "sst"), ("ssw900", "sst"), ("sst", "ssw07"))
    ),
    *(
        case(f"no word of a stop for an {family} drives the motor of an {found} that is not named yet",
             {0.01: stop("pump")}, 4.0, is_not_driven, given=in_place_of(family), family=found)
        for family in (*OWN, "sst")
        for found in (*OWN, "sst")
        if found != family
    ),
    case("what a device proved to be is of no account once its port was lost",
         {5.0: ["line pumps unplug", fault("swap", "pump", "ssw07"), "line pumps plug", stop("pump")]}, 8.0,
         CONFIRMED, frames("pump", STOP_07, since=5.0), given=SSW07, family="ssw06"),
]  # fmt: skip


test_words_of_a_stop = played(SCENARIOS + WRONG)
