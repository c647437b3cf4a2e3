"""`parameters restore` and `save`, beside the starter whose settings they are."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.rig import RigPlant, ScenarioRow, frames, play, row
from tests.rig.sites import FOUR, SST, SSW06, SSW07, SSW900, line, starter
from tests.rig.state import stored_document, with_document
from tests.scenarios.cli.lines import LineRow, beside, cli, ended, line_row, play_line

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


def _watchdog_stored(plant: RigPlant) -> str:
    rows = stored_document(plant, "watchdogs")["pump"]["rows"]
    mode = (plant.folder / "state/state.sqlite").stat().st_mode & 0o777
    return "" if (rows["P314"], mode) == ([60], 0o600) else f"{rows} {mode:o}"


CROWD = line() + starter("pump", 1, "ssw07")
CROWD += "".join(starter(f"f{n}", n, "ssw07", watchdog_s=2.0) for n in range(2, 17))
CROWD += "".join(starter(f"f{n}", n, "ssw07") for n in range(17, 61))
END = {1.0: "end"}
SETS = [
    *(
        ended(
            f"everything that {name} reports is saved, and differs from it in nothing",
            given,
            cli(f"parameters save CONFIG {name} DIR/set.toml", out=f"{count} parameters of {name}\n"),
            cli(f"parameters diff DIR/set.toml CONFIG:{name}", out="no setting differs"),
            restore(name, "--command-sources", out="nothing to write"),
            frames(name),
            end_s=1.0,
        )
        for given, name, count in (
            (SSW06, "fan", 71),
            (SSW07, "pump", 67),
            (SSW900, "mill", 501),
            (SST, "belt", 69),
        )
    ),
    row(
        "a row that the starter refuses is noted",
        given=SSW07,
        at={1.0: [lambda plant: plant.starter("pump").unit.settings.pop(277), "end"]},
        then={
            1.0: [
                cli("parameters save CONFIG pump -", out=('P277 = "illegal data address"', "P278 = {")),
                cli(
                    "parameters save CONFIG pump DIR/set.toml",
                    out="66 parameters of pump, 1 could not",
                ),
            ]
        },
    ),
    ended(
        "parameters without a name are saved as raw words where they are asked for",
        SSW07,
        cli("parameters save CONFIG pump - --unnamed", out=(re.compile(r"P500 = .*raw = \[77\]"), "P501 = ")),
        end_s=1.0,
        sim={"pump": {"settings": {500: 77}}},
    ),
    ended(
        "a setting is written once, whatever else the file has",
        SSW07,
        restore("pump", out=("read back: P314", "left as it is: P308"), err="writing P314"),
        frames("pump", "06 01 3a 00 1e"),
        end_s=1.0,
        **wanted("ssw07", P314=30, P313=1, P003=7, P308=9),
    ),
    ended(
        "settings may be given by their names in the manual",
        SSW900,
        restore("mill", out="written and read back: C8.2.5.3, C8.2.5.1, C8.2.5.2"),
        restore("mill", out="nothing to write"),
        frames("mill", "06 02 de 00 0f", "06 02 e4 00 02", "06 02 e5 00 01"),
        end_s=1.0,
        **wanted("ssw900", C8_2_5_3=1.5, C8_2_5_1="Alarm A128", C8_2_5_2="Ramp Stop"),
    ),
    row(
        "the first setting that is not followed ends a restore, with an account",
        given=SSW900,
        at={1.0: ["mill C8.2.5.1 = 0", "end"]},
        then={
            1.0: restore(
                "mill",
                code=1,
                out=("written and read back: C8.2.5.3\n", "unconfirmed: C8.2.5.1: ", "not tried: C8.2.5.2"),
            )
        },
        **wanted("ssw900", C8_2_5_3=1.5, C8_2_5_1="Alarm A128", C8_2_5_2="Ramp Stop"),
    ),
    ended(
        "an SST is configured once for all its registers",
        SST,
        restore("belt", out="written and read back: "),
        entered_once,
        restore("belt", out="nothing to write"),
        end_s=1.0,
        **wanted("sst", R41=9, R42=20, R36=40),
    ),
    *(
        row(
            f"nothing is written to {name} while its motor turns",
            given=FOUR,
            at={1.0: [run_on(name), "end"]},
            then={
                1.0: [
                    restore(
                        name,
                        code=1,
                        out=(f"rejected: {code}: the motor is not at standstill (", "read back: nothing"),
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
    ended(
        "who commands the motor is left as it is unless asked for, and then run = 0 comes before",
        SSW07,
        restore("pump", out="--command-sources"),
        frames("pump"),
        restore("pump", "--command-sources", out="run = 0 was written first"),
        restore("pump", "--command-sources", out="nothing to write"),
        end_s=1.0,
        **wanted("ssw07", P230="DI"),
    ),
    ended(
        "a set of another model is refused unless asked for",
        SSW07,
        restore("pump", code=2, err="--other-model"),
        frames("pump"),
        restore("pump", "--other-model", out="written and read back: P314"),
        end_s=1.0,
        **wanted("ssw07", model="SSW-07 17.0A", P314=3),
    ),
    ended(
        "a watchdog that the line cannot keep is not restored",
        CROWD,
        restore(
            "pump",
            code=1,
            err=("watchdog_unkept: ", "the shortest watchdog of pump that the line can meet is"),
        ),
        restore("pump", "--dry-run", out="would be refused"),
        frames("pump"),
        end_s=1.0,
        absent=tuple(f"f{n}" for n in range(2, 61)),
        **wanted("ssw07", P314=1),
    ),
    ended(
        "one that it can keep is, and known to the next run",
        CROWD,
        restore("pump", out="read back: P314"),
        _watchdog_stored,
        end_s=1.0,
        absent=tuple(f"f{n}" for n in range(2, 61)),
        **wanted("ssw07", P314=60),
    ),
    beside(
        "while the gateway holds the port nothing is written",
        SSW07,
        restore("pump", code=1, err="a gateway or another program holds it"),
        frames("pump"),
        at_s=2.0,
        **wanted("ssw07", P314=30),
    ),
    ended(
        "writes that cannot be counted are reported",
        SSW07,
        restore("pump", out="writes to the memory of pump that are not counted: 1"),
        end_s=1.0,
        then=[with_document("writes", "damaged")],
        **wanted("ssw07", P314=30),
    ),
]


@pytest.mark.parametrize("row", SETS)
def test_sets_of_parameters(row: ScenarioRow) -> None:
    play(row)


SAVED = {
    f"{name}.toml": f'[starter]\nname = "p"\nfamily = "{family}"\n[parameters]\nP314 = {seconds}\n'
    for name, family, seconds in (("a", "ssw07", 3), ("b", "ssw07", 5), ("c", "ssw06", 3))
}
SAVED["new.toml"] = (
    '[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP220 = { raw = [3] }\nP314 = { raw = [0] }\n'
)
SAVED["used.toml"] = SAVED["new.toml"].replace("07", "06").replace("[3]", "[6]")
FILES = [
    line_row(
        f"parameters {words}", f"parameters {words}", given=SSW07, files=SAVED, code=code, out=out, err=err
    )
    for words, code, out, err in [
        ("diff a.toml b.toml", 1, re.compile("^P314 : 3 -> 5\n$"), ""),
        ("diff a.toml a.toml", 0, "no setting differs", ""),
        ("diff a.toml a.toml --all", 0, (), ""),
        ("diff new.toml --factory", 0, "as delivered: P220, P314\n", ""),
        ("diff used.toml --factory", 1, re.compile(r"^P220 .*: 2 \(.*-> .*\nas delivered: P314\n$"), ""),
        ("diff a.toml", 2, "", "name a second set"),
        ("diff a.toml b.toml --factory", 2, "", "takes the place of b.toml"),
        ("diff a.toml c.toml", 2, "", "not comparable"),
        ("diff a.toml none.toml", 2, "", "none.toml"),
        ("diff a.toml CONFIG:fan", 2, "", "no starter 'fan' (one of pump)"),
        ("save CONFIG pump a.toml", 2, "", "exists already"),
        ("save CONFIG pump nowhere/a.toml", 2, "", "no folder"),
        ("restore CONFIG pump c.toml", 2, "", "of family ssw06, pump of ssw07"),
        ("restore CONFIG pump CONFIG", 2, "", "[starter]"),
    ]
]


@pytest.mark.parametrize("row", FILES)
def test_sets_as_files(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)
