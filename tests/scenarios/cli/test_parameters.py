"""`parameters save`, `diff` and `restore`, beside the gateway whose starter it is."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.rig import RigPlant, frames, played, row, scene
from tests.rig.sites import ALICE, FOUR, SST, SSW06, SSW07, SSW900, operator, starter
from tests.scenarios.cli.lines import LineRow, beside, cli, ended, file_has, line_row, play_line

ENTER = "05 00 01 ff 00"  # of the SST's configuration mode


def wanted(family: str, /, model: str = "", **values: Any) -> dict[str, dict[str, str]]:
    """Return a row's file of settings; an underscore stands for a point of a code."""
    rows = (f'"{code.replace("_", ".")}" = {json.dumps(value)}\n' for code, value in values.items())
    head = f'[starter]\nname = "other"\nfamily = "{family}"\n' + (f'model = "{model}"\n' if model else "")
    return {"files": {"set.toml": f"{head}[parameters]\n{''.join(rows)}"}}


def restore(name: str, options: str = "", **said: Any) -> Any:
    return cli(f"parameters restore CONFIG {name} DIR/set.toml {options}", **said)


def run_on(name: str) -> Any:
    """Return the action by which a motor runs without a command."""
    return lambda plant: plant.starter(name).unit.motor.start()


def entered_once(plant: RigPlant) -> str:
    pdus = [pdu for _, pdu in plant.starter("belt").writes]
    return "" if pdus.count(ENTER) == 1 else f"{pdus}"


SAVED = "parameters save CONFIG pump DIR/pump.toml"
PUMP, MILL, BELT = SSW07 + ALICE, SSW900 + ALICE, SST + ALICE
P314 = wanted("ssw07", P314=30)
WATCHED = wanted("ssw900", C8_2_5_3=1.5, C8_2_5_1="Alarm A128", C8_2_5_2="Ramp Stop")
SETS = [
    *(
        beside(
            f"everything that {name} reports is saved, and differs from it in nothing",
            given + ALICE,
            cli(
                f"parameters save CONFIG {name} DIR/set.toml",
                out=f"{count} parameters of {name}\n",
                err="100%",
            ),
            file_has(
                "set.toml", f'name = "{name}"', f'model = "{model}', *(f"{code} = {{ " for code in codes)
            ),
            cli(f"parameters diff DIR/set.toml CONFIG:{name}", out="no setting differs"),
            restore(name, "--command-sources", out="nothing to write"),
            frames(name),
        )
        for given, name, count, model, codes in (
            (SSW06, "fan", 71, "SSW-06", ("P003", "P314")),
            (SSW07, "pump", 67, "SSW-07 85.0A", ("P003", "P314")),
            (SSW900, "mill", 501, "SSW900", ('"C8.2.5.3"',)),
            (SST, "belt", 69, "", ("R41",)),
        )
    ),
    scene(
        "a row that the starter refuses is noted",
        PUMP,
        {1.0: lambda plant: plant.starter("pump").unit.settings.pop(277)},
        3.0,
        cli(
            "parameters save CONFIG pump -",
            out=(re.compile('P277 = ".*illegal data address'), "P278 = {"),
        ),
        cli(SAVED, out="66 parameters of pump, 1 could not"),
    ),
    beside(
        "a setting is written once, whatever else the file has",
        PUMP,
        restore("pump", "--dry-run", out="would write: P314"),
        frames("pump"),
        restore(
            "pump",
            out=(
                "to write: P314 timeout for message reception: 0.0 s (off) -> 30.0 s",
                "read back: P314",
                "left as it is: P308",
            ),
            err="writing P314",
        ),
        frames("pump", "06 01 3a 00 1e"),
        cli(
            "parameters diff DIR/set.toml CONFIG:pump",
            code=1,
            out=re.compile("^P313 .*not there|^P308"),
        ),
        **wanted("ssw07", P314=30, P313=1, P003=7, P308=9),
    ),
    beside(
        "settings may be given by their names in the manual",
        MILL,
        restore("mill", out="written and read back: C8.2.5.3, C8.2.5.1, C8.2.5.2"),
        restore("mill", out="nothing to write"),
        frames("mill", "06 02 de 00 0f", "06 02 e4 00 02", "06 02 e5 00 01"),
        **WATCHED,
    ),
    row(
        "the first setting that is not followed ends a restore, with an account",
        given=MILL,
        at={1.0: "mill C8.2.5.1 = 0"},
        then={
            3.0: restore(
                "mill",
                code=1,
                out=("written and read back: C8.2.5.3\n", "unconfirmed: C8.2.5.1: ", "not tried: C8.2.5.2"),
            )
        },
        **WATCHED,
    ),
    beside(
        "an SST is configured once for all its registers",
        BELT,
        restore("belt", out="written and read back: "),
        entered_once,
        restore("belt", out="nothing to write"),
        **wanted("sst", R41=9, R42=20, R36=40),
    ),
    *(
        row(
            f"nothing is written to {name} while its motor turns",
            given=FOUR + ALICE,
            at={1.0: run_on(name)},
            then={
                3.0: [
                    restore(
                        name, code=1, out=(re.compile("rejected: .*running is true"), "read back: nothing")
                    ),
                    frames(name),
                ]
            },
            **wanted(family, **{code.replace(".", "_"): value}),
        )
        for name, family, code, value in (
            ("pump", "ssw07", "P314", 30),
            ("mill", "ssw900", "C8.2.5.3", 2),
            ("belt", "sst", "R41", 9),
        )
    ),
    beside(
        "who commands the motor is left as it is unless asked for, and then run = 0 comes before",
        PUMP,
        restore("pump", out="--command-sources"),
        frames("pump"),
        restore("pump", "--command-sources", out="run = 0 was written first"),
        restore("pump", "--command-sources", out="nothing to write"),
        **wanted("ssw07", P230="DI"),
    ),
    beside(
        "a set of another model is refused unless asked for",
        PUMP,
        restore("pump", code=2, err="(--other-model restores it nevertheless)"),
        frames("pump"),
        restore("pump", "--other-model", out="written and read back: P314"),
        **wanted("ssw07", model="SSW-07 17.0A", P314=3),
    ),
    beside(
        "an operator needs the rights",
        SSW07 + operator("bob", may=("read",)) + operator("carol", may=("stop",)),
        cli("parameters save CONFIG pump -", code=2, err="which operator? (--client with one of bob, carol)"),
        cli("parameters save CONFIG pump - --client carol", code=1, err="[not_allowed]"),
        restore("pump", "--client bob", code=1, out="[not_allowed]"),
        frames("pump"),
        **P314,
    ),
    ended(
        "without a running gateway there is an error, and no file",
        PUMP,
        cli(SAVED, code=1, err="the gateway is offline: "),
        restore("pump", code=1, err="the gateway is offline: "),
        lambda plant: "it is there" if (plant.folder / "pump.toml").exists() else "",
        **P314,
    ),
    beside(
        "a starter that is silent is not saved, nor one of another family than the one configured",
        SSW07 + starter("fan", 2, "ssw06") + ALICE,
        cli(SAVED, code=1, err="the gateway reads nothing of pump: the starter does not answer"),
        cli("parameters save CONFIG fan -", code=1, err="it is ssw07, not ssw06"),
        at_s=10.0,
        absent=("pump",),
        sim={"fan": {"family": "ssw07"}},
    ),
    row(
        "a restore that loses the broker says what was written",
        given=MILL,
        at={3.0: lambda plant: plant.loop.call_later(1.15, plant.broker.drop)},
        then={
            3.0: restore(
                "mill",
                code=1,
                out=(
                    "written and read back: C8.2.5.3\n",
                    "unknown: C8.2.5.1 may have been written: look at the starter\n",
                    "not tried: C8.2.5.2\n",
                ),
                err="was lost before the final result",
            )
        },
        **WATCHED,
    ),
]


test_sets_of_parameters = played(SETS)


FILES_SAVED = {
    f"{name}.toml": f'[starter]\nname = "p"\nfamily = "{family}"\n[parameters]\np314 = {seconds}\n'
    for name, family, seconds in (("a", "ssw07", 3), ("b", "ssw07", 5), ("c", "ssw06", 3))
}
FILES_SAVED["new.toml"] = (
    '[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP220 = { raw = [3] }\nP314 = { raw = [0] }\n'
)
FILES_SAVED["read.toml"] = FILES_SAVED["a.toml"] + "P003 = 12.0\nP101 = 30\n"
FILES_SAVED["used.toml"] = FILES_SAVED["new.toml"].replace("07", "06").replace("[3]", "[6]")
FILES = [
    line_row(
        f"parameters {words}",
        f"parameters {words}",
        given=PUMP,
        files=FILES_SAVED,
        code=code,
        out=out,
        err=err,
    )
    for words, code, out, err in [
        ("diff a.toml b.toml", 1, re.compile("^P314 : 3 -> 5\n$"), ""),
        ("diff a.toml a.toml", 0, re.compile("^no setting differs between a.toml and a.toml\n$"), ""),
        ("diff a.toml read.toml", 0, "read.toml (--all shows 2 rows that can only be read)\n", ""),
        ("diff a.toml read.toml --all", 1, re.compile("^P003 .*\nP101 .*\n$"), ""),
        ("diff a.toml a.toml --all", 0, "no difference between a.toml and a.toml\n", ""),
        ("diff new.toml --factory", 0, "as delivered: P220, P314\n", ""),
        ("diff used.toml --factory", 1, re.compile(r"^P220 .*: 2 \(.*-> .*\nas delivered: P314\n$"), ""),
        ("diff a.toml", 2, "", "name a second set"),
        ("diff a.toml b.toml --factory", 2, "", "takes the place of b.toml"),
        ("diff a.toml c.toml", 2, "", "not comparable"),
        ("diff a.toml none.toml", 2, "", "none.toml"),
        ("diff a.toml CONFIG:fan", 2, "", "no starter 'fan' (one of pump)"),
        ("save CONFIG pump a.toml", 2, "", "exists already"),
        ("save CONFIG pump nowhere/a.toml", 2, "", "no folder"),
        ("restore CONFIG pump CONFIG", 2, "", "[starter]"),
        ("restore CONFIG pump c.toml", 2, "", "the file is of family ssw06, pump of ssw07: choose another"),
    ]
]


@pytest.mark.parametrize("row", FILES)
def test_sets_as_files(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)
