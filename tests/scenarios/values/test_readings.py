"""Raw words of the four families, as values with unit, quality, scale and sign."""

from __future__ import annotations

from typing import Any

import pytest

from tests.rig import ScenarioRow, msg, play, row
from tests.rig.rows import Expectation
from tests.rig.sites import SST, SSW06, SSW07, SSW900
from tests.scenarios.values.words import bad, value


def read(name: str, given: str, words: str, at_s: float, *then: Expectation, **sim: Any) -> ScenarioRow:
    """A starter that holds these words from its beginning on (`pump: P002 = 500, P003 = 400`) is read so."""
    starter, _, held = words.partition(": ")
    return row(
        name,
        given=given,
        sim={starter: sim},
        at={0: [f"{starter} {word}" for word in held.split(", ")]},
        then={at_s: list(then)},
    )


ROWS = [
    read(
        "an SSW-07's example of the manual: 500 and 400 are 50.0 % and 40.0 A",
        SSW07,
        "pump: P002 = 500, P003 = 400",
        3,
        value("pump/current_pct", 50.0, "%"),
        value("pump/current", 40.0, "A"),
    ),  # 5.4.2
    read(
        "an SSW-07's slow values have the scales of its parameters",
        SSW07,
        "pump: P005 = 599, P007 = 87, P011 = 1234, P030 = 405",
        15,
        value("pump/line_frequency", 59.9, "Hz"),
        value("pump/p007", 87, "%"),
        value("pump/apparent_power", 123.4, "kVA"),
        value("pump/p030", 40.5, "A"),
    ),
    read(
        "an SSW-07's temperature, thermal level and the number of its last fault",
        SSW07,
        "pump: P081 = 415, P050 = 63, P014 = 66",
        15,
        value("pump/heatsink_temperature", 41.5, "°C"),
        value("pump/p050", 63, "%"),
        value("pump/fault_code", 66),
        msg("starter/pump/state", fault=False),
    ),
    read(
        "the number of an enumeration has its name beside it",
        SSW07,
        "pump: P006 = 5",
        15,
        value("pump/p006", 5, label="PASS (bypass)"),
    ),
    read(
        "what FC43 says of an SSW-06's size counts without a configured model",
        SSW06,
        "fan: P003 = 950",
        5,
        value("fan/current", 950.0, "A"),
        model="SSW-06 1000A",
    ),
    read(
        "an SSW900's voltages, frequency, torque and power factor",
        SSW900,
        "mill: S1.2.4 = 3997, S1.3.1 = 2301, S1.6.2 = 501, S1.7.1 = 985, S1.5.4 = 87",
        3,
        value("mill/line_voltage", 399.7, "V"),
        value("mill/output_voltage", 230.1, "V"),
        value("mill/line_frequency", 50.1, "Hz"),
        value("mill/torque_pct", 98.5, "%"),
        value("mill/power_factor", 0.87),
    ),
    read(
        "an SST's registers count by their low byte alone, its temperature with a sign",
        SST,
        "belt: R12 = 0x550C, R13 = 0x00F6, R17 = 24, R14 = 100",
        3,
        value("belt/current", 12.0, "A"),
        value("belt/heatsink_temperature", -10, "°C"),
        value("belt/r17", 24, "V"),
        value("belt/r14", 100, "%"),
    ),
    read(
        "an SST's watchdogs are values",
        SST,
        "belt: R41 = 30, R42 = 60",
        15,
        value("belt/r41", 30, "s"),
        value("belt/r42", 60, "s"),
    ),
    row(
        "a word that its type cannot hold is bad, the others of the block good; and good again with the next",
        given=SSW900,
        at={0: ["mill S1.5.4 = 256", "mill S1.2.4 = 4000"], 4: "mill S1.5.4 = 100"},
        then={
            3.5: [bad("mill/power_factor"), value("mill/line_voltage", 400.0, "V")],
            7: value("mill/power_factor", 1.0),
        },
    ),
    read(
        "a firmware that does not know jog and direction yet has them neither true nor false",
        SSW07,
        "pump: VB01 = 0x5F27",
        3,
        msg("starter/pump/state", state="running", jog=None, reverse=None, braking=None),
        firmware="1.30",
    ),  # 4.2.1
]


@pytest.mark.parametrize("row", ROWS)
def test_words_become_values(row: ScenarioRow) -> None:
    play(row)
