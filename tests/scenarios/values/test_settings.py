"""A starter's settings: watchdogs read at first contact, changes at the keypad, readiness, the baseline."""

from __future__ import annotations

from tests.rig import RigPlant, command, event, frames, never, played, result, row, seen
from tests.rig.rows import Expectation
from tests.rig.sites import ALICE, FOUR, SITES, SSW07, SSW900
from tests.scenarios.values.words import answers, nothing_written, refuse_rows

EVENTS = "starter/pump/event"
DOES = "shows E28 and disables the motor, which coasts"


def _readiness(name: str, *, times: int) -> Expectation:
    return seen(f"starter/{name}/event", times=times, code="readiness", data={"would_refuse_start": ...})


def _is_said_once(name: str) -> Expectation:
    return _readiness(name, times=1)


def _not_asked(name: str, request: bytes, *, since: float) -> Expectation:
    def check(plant: RigPlant) -> str:
        return str(
            [at_s for at_s, pdu in plant.starter(name).asked if at_s > since and pdu[:3] == request] or ""
        )

    return check


def _loses_settings(pdu: bytes) -> bytes | None:
    """P313 and P314 are not answered."""
    return None if pdu[0] == 3 and int.from_bytes(pdu[1:3], "big") in (312, 313, 314) else b""


def _refuses_register_400(pdu: bytes) -> bytes | None:
    return b"\x86\x03" if pdu[:3] == b"\x06\x01\x90" else b""


SELDOM_POLLED, SELDOM_POLLED_900 = (
    site.replace("every_s = 1.0", "every_s = 10.0") for site in (SSW07, SSW900)
)
NAMES = ("pump", "fan", "mill", "belt")
ROWS = [
    row(
        "a starter that does not take its commands from the line is an event, which names its watchdog",
        given=SSW07,
        sim={"pump": {"settings": {230: 0, 313: 2, 314: 5}}},
        then={
            3: event(
                "readiness",
                EVENTS,
                severity="error",
                data={
                    "would_refuse_start": True,
                    "findings": ...,
                    "watchdogs": [{"parameter": "P314", "after_s": 5.0, "does": DOES}],
                },
            ),
        },
    ),
    *(
        row(
            f"a setting changed at the keypad is found, and the readiness is looked at again ({name})",
            given=SITES[name],
            at={55: f"{name} {code} = 30"},
            then={
                54: never(f"starter/{name}/event", code="parameter_changed"),
                500: seen(
                    f"starter/{name}/event",
                    times=1,
                    code="parameter_changed",
                    severity="warning",
                    data={"parameter": code, "before": {"raw": [0], **old}, "after": {"raw": [30], **new}},
                ),
                500.5: _readiness(name, times=2),
            },
        )
        for name, code, old, new in (
            ("pump", "P314", {"value": 0.0, "unit": "s", "label": "off"}, {"value": 30.0, "unit": "s"}),
            ("fan", "P314", {}, {}),
            ("mill", "C8.2.5.3", {}, {"value": 3.0}),
        )
    ),
    row(
        "a setting that the gateway itself has changed is no event",
        given=SSW07 + ALICE,
        at={10: command("pump/alice/set", args={"parameter": "P314", "value": 30})},
        then={400: [result("set confirmed ok"), never(EVENTS, code="parameter_changed")]},
    ),
    row(
        "what a set of two rows has changed before its second was refused is no event",
        given=SELDOM_POLLED_900 + ALICE,
        at={
            400: [
                answers("mill", _refuses_register_400),
                command("mill/alice/set", args={"parameters": {"C1.3": 20, "C2.1": 1}}),
            ]
        },
        then={
            410: [
                result("set failed illegal_data_value"),
                frames("mill", "06 00 66 00 14", "06 01 90 00 01"),
            ],
            700: never("starter/mill/event", code="parameter_changed"),
        },
    ),
    row(
        "what was changed between two runs is an event of the next",
        given=SSW07,
        at={300: "end", 300.5: ["pump P314 = 77", "start"]},
        then={340: event("parameter_changed", EVENTS, data={"parameter": "P314", "after": {"value": 77}})},
    ),
    row(
        "each family says once whether it is ready, and nothing is written for that",
        given=FOUR,
        then={60: [check(name) for name in NAMES for check in (_is_said_once, nothing_written)]},
    ),
    row(
        "a readiness that could not be read is looked at again",
        given=SSW07,
        at={0: answers("pump", _loses_settings, for_s=40)},
        then={39: _readiness("pump", times=0), 300: _readiness("pump", times=1)},
    ),
    row(
        "the patrol leaves a silent starter alone, and finds what was changed meanwhile",
        given=SSW07,
        at={30: "pump power off", 90: ["pump P314 = 7", "pump power on"]},
        then={500: seen(EVENTS, times=1, code="parameter_changed", data={"parameter": "P314"})},
    ),
    row(
        "the patrol comes to its last rows however often the starter is silent",
        given=SELDOM_POLLED_900,
        at={
            **{150.0 * n: "mill power off" for n in range(1, 9)},
            **{150.0 * n + 20: "mill power on" for n in range(1, 9)},
            700.0: "mill C8.1.2.25 = 1",
        },
        then={1300: seen("starter/mill/event", code="parameter_changed", data={"parameter": "C8.1.2.25"})},
    ),
    row(
        "the patrol stops asking for a row that is refused",
        given=SELDOM_POLLED,
        at={0: refuse_rows("pump", {277, 278})},
        then={1500: _not_asked("pump", b"\x03\x01\x15", since=900)},
    ),
]


test_settings = played(ROWS)
