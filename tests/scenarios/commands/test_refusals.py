"""What readings and manuals forbid is refused by its code of docs/results.md, and nothing is written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tests.rig import fault, frames, played, result, row
from tests.rig.rows import Action
from tests.rig.sites import ALICE, QUICK, SITES, SSW07, line, starter
from tests.scenarios.commands import do


def by_the_readings(
    name: str,
    words: str,
    code: str,
    *first: Action | Sequence[Action],
    args: dict[str, Any] | None = None,
    site: str = "",
    at_s: float = 6.0,
    first_s: float = 2.0,
    within_s: float = 3.0,
    **options: Any,
) -> Any:
    """`first` happens before; the command is then refused with this code, and nothing is written."""
    starter_name, verb = words.split()
    return row(
        name,
        given=(site or SITES[starter_name]) + ALICE,
        sim={starter_name: {**QUICK, **options}},
        at={first_s: first, at_s: do(words, **(args or {}))},
        then={at_s + within_s: [result(f"{verb} rejected {code}"), frames(starter_name, since=at_s)]},
    )


READINGS = [
    by_the_readings("no start of an SSW-07 in fault", "pump start", "fault_active", "pump trip E05"),
    by_the_readings("no reset without a fault", "pump reset", "no_fault_to_reset"),
    by_the_readings("no start in local mode", "pump start", "in_local", "pump control local"),
    by_the_readings("no start where the source of local mode was the serial line until now", "pump start",
                    "in_local", "pump control local", "pump P229 = 0", settings={229: 2}),
    by_the_readings("no start while the parallel input controls an SST", "belt start", "controlled_elsewhere",
                    "belt control local"),
    by_the_readings("no start without general enable", "pump start", "not_enabled",
                    do("pump general_enable", value=False)),
    by_the_readings("no start of an SST that is not configured", "belt start", "not_configured",
                    do("belt reset", whole=True), at_s=8.0),
    by_the_readings("no start of a running motor", "pump start", "motor_running", do("pump start")),
    by_the_readings("no start of a motor that jogs", "fan start", "motor_running", do("fan jog", value=True)),
    by_the_readings("no general enable of a running motor", "pump general_enable", "motor_running",
                    do("pump start"), args={"value": True}),
    by_the_readings("no configuration of a running SST, whose motor would stop", "belt configure",
                    "motor_running", do("belt start")),
    by_the_readings("no start of an SSW-07 without power", "pump start", "no_power", "pump mains off"),
    by_the_readings("no start of an SST that is not ready, as without mains", "belt start", "not_ready",
                    "belt mains off"),
    by_the_readings("no start of an SST130i with a charged capacitor", "belt start", "capacitor_charged",
                    "belt R20 = 100", model="SST130i"),
    by_the_readings("no start in an adjusting mode", "fan start", "not_ready", "fan VB06 = 2"),
    by_the_readings("no jog of an SSW-07 before V1.40", "pump jog", "not_in_firmware",
                    args={"value": True}, firmware="1.30"),
    by_the_readings("no start of a silent starter", "pump start", "offline", fault("silent", "pump"),
                    at_s=30.0),
    by_the_readings("no start of a starter of which it is not yet known who it is", "pump start",
                    "identity_unknown", fault("refuse", "pump", 2, (43,)), site=SSW07, at_s=0.2, first_s=0.0),
    by_the_readings("no start while the adapter is pulled out", "pump start", "line_down",
                    "line pumps unplug",
                    at_s=2.05),
    by_the_readings("no start of another family than configured", "pump start", "identity_mismatch",
                    family="ssw06"),
    by_the_readings("no start of another model than configured", "pump start", "identity_changed",
                    site=line() + starter("pump", 1, "ssw07", model="SSW-07 85A"), rated_current_a=30.0),
    by_the_readings("no acceptance where nothing changed", "pump accept", "nothing_to_accept"),
    by_the_readings("no start of an SSW900 whose accessory sits in the other slot", "mill start",
                    "slot_mismatch", site=line() + starter("mill", 3, "ssw900", slot=2)),
    by_the_readings("a value out of the manual's range", "pump set", "out_of_range",
                    args={"parameter": "P314", "value": 1000}),
    by_the_readings("a watchdog that the line cannot keep", "belt set", "watchdog_unkept",
                    args={"parameter": "R41", "value": 1},
                    site=line(baud=1200) + starter("belt", 4, "sst"), within_s=6.0),
]  # fmt: skip


test_what_is_wrong_is_named_and_nothing_is_written = played(READINGS)
