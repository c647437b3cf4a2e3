"""Rows that a site asks for as points: docs/points.md, at every door."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.rig import (
    RigPlant,
    event,
    frames,
    msg,
    never,
    play,
    played,
    reload,
    result,
    retained,
    row,
    scene,
    seen,
)
from tests.rig.rows import Expectation
from tests.rig.sites import (
    ALICE,
    HOME_ASSISTANT,
    METRICS,
    QUICK,
    SPARKPLUG,
    SSW06,
    SSW07,
    SSW900,
    WEB,
    line,
    starter,
    table,
)
from tests.scenarios.commands import do
from tests.scenarios.plugins.doors import answer, born, device, entity, sample, shown
from tests.scenarios.values.words import answers, bad, value

FAN = line() + starter("fan", 2, "ssw06", points=["P314", "P220"])
ROW = {"family": "ssw07", "parameter": "P102", "name": "voltage_ramp_time", "title": "Voltage ramp time"}
PUMP_ROW = SSW07 + 'points = ["P102"]\n' + table("[row]", **ROW, unit="s", min=1, max=90)


def point(topic: str, **fields: Any) -> Expectation:
    """A starter's `info` describes a point so."""
    name, _, of = topic.partition("/")
    return msg(f"starter/{name}/info", points={of: fields})


VALUES = [
    scene(
        "a row that is asked for is a point under its code, with name, unit, type and period",
        FAN,
        {0: ["fan P314 = 12", "fan P220 = 5"]},
        15,
        point("fan/p314", code="P314", unit="s", type="float", every_s=10.0, name=re.compile("timeout")),
        point("fan/p220", code="P220", unit="", type="enum", every_s=10.0, enum={"0": ...}),
        point("fan/current", code="P003"),
        value("fan/p314", 12.0, "s"),
        value("fan/p220", 5, label=...),
    ),
    scene(
        "patterns ask for many rows, in capitals or not, and an enumeration has its names",
        SSW900 + 'points = ["s4.2.*", "S3.5.?", "D1.1.1"]\n',
        {0: ["mill S3.5.2 = 3"]},
        15,
        point("mill/s3_5_2", type="enum", enum={"3": "PT100"}),
        value("mill/s3_5_2", 3, label="PT100"),
        # what is a point already is that alone
        never("starter/mill/value/d1_1_1"),
        point("mill/s4_2_1", code="S4.2.1"),
    ),
    scene(
        "a line's points are those of each of its starters that has them, a table's those of its family",
        line(points=["P220"])
        + starter("pump", 1, "ssw07")
        + starter("fan", 2, "ssw06")
        + starter("belt", 4, "sst")
        + table("[points]", family="sst", codes=["R14", "COIL22"], every_s=2.0)
        + table("[points]", family="ssw06", codes=["P314"], starters=["fan"]),
        {},
        15,
        seen("starter/fan/value/p220", quality="good"),
        seen("starter/pump/value/p220", quality="good"),
        seen("starter/belt/value/coil22", value=False, quality="good"),
        point("belt/coil22", type="boolean", every_s=2.0),
        never("starter/belt/value/p220"),
        seen("starter/fan/value/p314", quality="good"),
        never("starter/pump/value/p314"),
    ),
    scene(
        "a row that this starter refuses is bad, and takes no other with it",
        PUMP_ROW.replace('["P102"]', '["P102", "P220", "P277"]'),
        {},
        40,
        bad("pump/voltage_ramp_time"),
        value("pump/p220", ..., label=...),
        value("pump/p277", ...),
        value("pump/current", ..., "A"),
        msg("starter/pump/state", state="ready", quality="good"),
    ),
    scene(
        "what the starter counts itself goes on to count where it is asked for as well",
        line() + starter("mill", 3, "ssw900", points=["D6.2", "D4.6.1"]),
        {0: ["mill D6.2 = 7200", "mill D4.6.1 = 55"]},
        15,
        value("mill/d6_2", 7200.0, "s", label="02:00:00"),
        msg("starter/mill/value/hours_total", value=2.0),
        msg("starter/mill/value/energy_kwh", value=5.5),
    ),
    row(
        "a reload adds points and takes them away, and nothing of them stays at the broker",
        given=FAN,
        at={15: reload(SSW06 + 'points = ["P295"]\n')},
        then={
            14: retained("starter/fan/value/p220", quality="good"),
            35: [
                event("reloaded", data={"starters_changed": ["fan"]}),
                retained("starter/fan/value/p220"),
                retained("starter/fan/value/p295", quality="good"),
                msg("starter/fan/info", points={"p295": ...}),
            ],
        },
    ),
    row(
        "a site's own row is a point under the name that the site gives it",
        given=PUMP_ROW,
        sim={"pump": {"settings": {102: 12}}},
        then={15: point("pump/voltage_ramp_time", code="P102", name="Voltage ramp time", type="float")},
    ),
]


test_a_row_becomes_a_point = played(VALUES)


WRITABLE = PUMP_ROW + "writable = true\n" + ALICE
HELD = {"pump": {**QUICK, "settings": {102: 12}}}


def takes_writes(plant: RigPlant) -> None:
    """The pump takes writes of P102, as its programming manual says."""

    def written(pdu: bytes) -> bytes:
        if pdu[:3] != bytes.fromhex("06 00 66"):
            return b""
        plant.starter("pump").unit.settings[102] = int.from_bytes(pdu[3:5], "big")
        return pdu

    answers("pump", written)(plant)


@pytest.mark.parametrize(
    ("rules", "motor", "number", "end", "written"),
    [
        ("writable = true", "rests", 30, "confirmed ok", ["06 00 66 00 1e"]),
        ("writable = true", "rests", 91, "rejected out_of_range", []),
        ("writable = true", "runs", 30, "rejected motor_running", []),
        ('writable = true\nwhile = "always"', "runs", 30, "confirmed ok", ["06 00 66 00 1e"]),
        ("", "rests", 30, "rejected not_writable", []),
    ],
)
def test_a_row_of_the_site_is_set_by_its_rules(
    rules: str, motor: str, number: int, end: str, written: list[str]
) -> None:
    setting = do("pump set", parameter="P102", value=number)
    at: dict[float, Any] = {0: takes_writes, 1: do("pump start") if motor == "runs" else (), 5: setting}
    now = value("pump/voltage_ramp_time", 30.0 if written else 12.0, "s")
    then = {17: [result(f"set {end}"), frames("pump", *written, since=5.0), now]}

    play(row(end, given=f"{PUMP_ROW}{rules}\n{ALICE}", sim=HELD, at=at, then=then).values[0])


ROWS = [
    row(
        "where the manual only says that a row's scale depends on the model, it still does",
        given=line()
        + starter("fan", 2, "ssw06", model="SSW-06 820A", points=["P048"])
        + table("[row]", family="ssw06", parameter="P048", name="peak", title="Peak", unit="A", scale=0.1),
        sim={"fan": {"model": "SSW-06 820A"}},
        at={0: "fan P048 = 123"},
        then={15: value("fan/peak", 123.0, "A")},
    ),
    row(
        "a site's own row is read by its code",
        given=WRITABLE,
        sim=HELD,
        at={5: do("pump read", parameter="p102")},
        then={12: msg("result/pump/alice", phase="confirmed", value=12.0, unit="s")},
    ),
]


test_a_row_of_the_site_is_a_row_like_any_other = played(ROWS)


EVERYWHERE = (
    line()
    + starter("fan", 2, "ssw06", points=["P314"])
    + starter("mill", 3, "ssw900", points=["S3.5.1", "S1.1.1"])
    + starter("belt", 4, "sst", points=["COIL22"])
    + WEB
    + METRICS
    + SPARKPLUG
    + HOME_ASSISTANT
)


def born_with(name: str, *metrics: str) -> Expectation:
    """The newest birth of a device names these metrics."""

    def check(plant: RigPlant) -> str:
        birth = plant.messages(born("DBIRTH", name))[-1].json["metrics"]
        return str(set(metrics) - birth.keys() or "")

    return check


def announced(name: str, key: str, **fields: Any) -> Expectation:
    """An entity is announced that is off at first."""

    def check(plant: RigPlant) -> str:
        found = entity(plant, key, name)
        wanted = {"enabled_by_default": False, **fields}
        return "" if wanted.items() <= found.items() else f"{device(name)}: {found}"

    return check


def test_a_point_is_seen_everywhere() -> None:
    at_each_door = [
        answer("/api/v1/starter/fan", topics={"starter/fan/value/p314": {"value": 155.0}}),
        answer("/api/v1/starter/belt", topics={"starter/belt/value/coil22": ...}),
        sample("point_value", 155.0, line="pumps", starter="fan", point="p314", unit="s"),
        sample("point_value", line="pumps", starter="mill", point="s1_1_1", unit="A"),
        sample("point_value", None, line="pumps", starter="mill", point="s4_2_1", unit="%"),  # not asked for
        born_with("fan", "p314"),
        born_with("mill", "s1_1_1", "s3_5_1"),
        born_with("belt", "coil22"),
        announced("fan", "p314", device_class="duration", unit_of_measurement="s"),
        announced("mill", "s1_1_1", device_class="current", unit_of_measurement="A", platform="sensor"),
        announced("belt", "coil22", platform="binary_sensor"),
        shown("p314", "155.0", "fan"),
        shown("coil22", "False", "belt"),
        shown("s3_5_1", "PT100", "mill"),
    ]
    at = {0: ["fan P314 = 155", "mill S3.5.1 = 3"]}

    play(row("every consumer takes points", given=EVERYWHERE, at=at, then={20: at_each_door}).values[0])
