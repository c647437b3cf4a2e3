"""Raw words of the four families, as values with unit, quality, scale and sign."""

from __future__ import annotations

from tests.rig import ScenarioRow, msg, played, row, scene
from tests.rig.rows import Expectation
from tests.rig.sites import FOUR, SSW06, SSW07, SSW900
from tests.scenarios.values.words import bad, value

WORDS = {  # of each starter from its beginning on; its values then, with their units
    "pump": (
        "P002 = 500, P003 = 400, P005 = 599, P007 = 87, P011 = 1234, P030 = 405, P081 = 415",
        # The first two are an example of the manual (5.4.2), the others have the scales of their parameters.
        "current_pct 50.0 %; current 40.0 A; line_frequency 59.9 Hz; p007 87.0 %; apparent_power 123.4 kVA; "
        "p030 40.5 A; heatsink_temperature 41.5 °C",
    ),
    "fan": ("P003 = 950", "current 95.0 A"),
    "mill": (
        "S1.2.4 = 3997, S1.3.1 = 2301, S1.6.2 = 501, S1.7.1 = 985, S1.5.4 = 87",
        "line_voltage 399.7 V; output_voltage 230.1 V; line_frequency 50.1 Hz; torque_pct 98.5 %; "
        "power_factor 0.87 ",
    ),
    "belt": (  # the low byte alone counts, with a sign where it is a temperature
        "R12 = 0x550C, R13 = 0x00F6, R17 = 24, R14 = 100, R41 = 30, R42 = 60",
        "current 12.0 A; heatsink_temperature -10.0 °C; r17 24.0 V; r14 100.0 %; r41 30.0 s; r42 60.0 s",
    ),
}


def _read(name: str, given: str, word: str, then: Expectation, **sim: str) -> ScenarioRow:
    starter = word.split()[0]
    return row(name, given=given, sim={starter: sim}, at={0: word}, then={5: then})


ROWS = [
    scene(
        "words of all families become values",
        FOUR,
        {0: [f"{name} {word}" for name, (words, _) in WORDS.items() for word in words.split(", ")]},
        25,
        *[
            value(f"{name}/{point}", float(number), unit)
            for name, (_, values) in WORDS.items()
            for point, number, unit in (each.split(" ") for each in values.split("; "))
        ],
    ),
    _read(
        "what FC43 says of an SSW-06's size counts without a configured model",
        *(SSW06, "fan P003 = 950", value("fan/current", 950.0, "A")),
        model="SSW-06 1000A",
    ),
    _read(
        "a firmware that does not know jog and direction yet has them neither true nor false (4.2.1)",
        *(SSW07, "pump VB01 = 0x5F27"),
        msg("starter/pump/state", state="running", jog=None, reverse=None, braking=None),
        firmware="1.30",
    ),
    _read(
        "an enumeration has its label", SSW07, "pump P006 = 5", value("pump/p006", 5, label="PASS (bypass)")
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
]


test_a_word_means_what_this_starter_says_by_it = played(ROWS)
