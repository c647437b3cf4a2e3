"""The other commands, each beside its plant: what they print, write, refuse and leave alone."""

from __future__ import annotations

import fcntl
import json
import re
from pathlib import Path
from typing import Any

import pytest

from gateway.families import FAMILIES
from tests.rig import RigPlant, command, fault, frames, played, result, row, scene
from tests.rig.sites import ALICE, FOUR, LOGIN, QUICK, SSW07, SSW900, WEB, line, starter, table
from tests.rig.state import with_sql
from tests.scenarios.cli.lines import LineRow, beside, cli, ended, file_has, line_row, play_line
from tests.scenarios.line.wires import chatter

SCAN = "scan /dev/pumps --baud 19200 --framing 8N2 --address"
TRIPPED = {3.0: command("pump/alice/start"), 6.0: "pump trip E05"}


def ran(words: str, **said: object) -> Any:
    """Return the action that runs a line, which must go as said."""

    def act(plant: RigPlant) -> None:
        wrong = cli(words, **said)(plant)
        assert not wrong, wrong

    return act


def while_it_runs(words: str, **said: Any) -> Any:
    """Return the expectation of a line while a process of the gateway has the lock of the folder."""
    expected = cli(words, **said)

    def check(plant: RigPlant) -> str:
        with (plant.folder / "state" / "gateway.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return expected(plant)

    return check


def _accepted(plant: RigPlant) -> str:
    """Have `check` accept what `scan` prints."""
    found = plant.cli("scan", "/dev/pumps", "--baud", "19200", "--framing", "8N2", "--address", "1-5")
    (plant.folder / "found.toml").write_text(found.out)
    return cli("check DIR/found.toml", out="valid, 4 starters on 1 line, read-only")(plant)


def _cut_off(plant: RigPlant) -> str:
    """Take away the newest line of the audit: the chain is whole, but a hash that was noted is missing."""
    noted = plant.cli("audit", "verify", str(plant.path)).out.split("hash ")[1].strip()
    wrong = cli(f"audit verify CONFIG --contains {noted}")(plant)
    with_sql("DELETE FROM audit WHERE number = (SELECT max(number) FROM audit)")(plant)
    wrong += cli("audit verify CONFIG", out="chain whole")(plant)
    missing = f"no line has the hash {noted}"
    return wrong + cli(f"audit verify CONFIG --contains {noted}", code=1, out=(missing, "chain whole"))(plant)


def _curve_of_a_start(plant: RigPlant) -> str:
    """Export the curve of the newest start by its id."""
    records = map(json.loads, plant.cli("history", str(plant.path), "pump", "--json").out.splitlines())
    (start,) = [each["id"] for each in records if "outcome" in each]
    exported = f"history CONFIG pump --id {start} --comtrade DIR/start --csv DIR/start.csv"
    wrong = cli(exported, out="start.cfg: ")(plant) or file_has("start.cfg", "current,,,A")(plant)
    return wrong or file_has("start.csv", "t_s,time,", "current [A]")(plant)


def _corrupted(plant: RigPlant) -> None:
    """Have requests arrive corrupted at the mill."""
    (mill,) = plant.lines["pumps"].starters.values()
    for _ in range(12):
        mill.unit.note_reception_error(is_crc=True, byte_count=8)
    mill.unit.note_reception_error(is_crc=False, byte_count=5)


def looked(name: str, given: str, *said: str, code: int | None = 1, **options: Any) -> Any:
    """Return a row in which `doctor` says this (patterns), and writes nothing."""
    names = re.findall(r'(?m)^\[\[line.starter\]\]\nname = "(\S+)"', given)
    unwritten = (frames(each) for each in names if each not in options.get("absent", ()))
    says = cli("doctor CONFIG", code=code, out=tuple(map(re.compile, said)))
    return ended(name, given, says, *unwritten, **options)


def asked(
    name: str, given: str, words: str, *said: str, code: int | None = 1, at_s: float, **options: Any
) -> Any:
    """Return a row in which `doctor` says this beside the gateway that holds the port."""
    return beside(
        name,
        given,
        cli(f"doctor CONFIG {words}", code=code, out=tuple(map(re.compile, said))),
        at_s=at_s,
        **options,
    )


SCANNING = [
    ended(
        "a scan finds every family and prints a site that check accepts",
        FOUR,
        cli(
            f"{SCAN} 1-5",
            out=(*(f'family = "{each}"' for each in FAMILIES), "address = 4"),
            err=("80% ", "address 1 at 19200 8N2: SSW-07"),
        ),
        _accepted,
        *(frames(name) for name in ("pump", "fan", "mill", "belt")),
    ),
    ended(
        "a line without starters is no success",
        SSW07,
        cli(f"{SCAN} 9", code=1, out="", err="no starter was found"),
        cli("scan /dev/none", code=1, out="", err="port /dev/none: "),
    ),
    ended(
        "a watchdog that the scan has started stands in the site that it prints",
        SSW07,
        cli(f"{SCAN} 1-2", out="watchdog_s = 30.0", err="P314 runs since this scan: after 30 s"),
        sim={"pump": {"settings": {314: 30}}},
    ),
    ended(
        "what another setting of the line would find is not found at this one",
        SSW07.replace("19200", "9600"),
        cli(f"{SCAN} 1-2", code=1, err="no starter was found"),
        cli("scan /dev/pumps --baud 9600,19200 --framing 8N2 --address 1-2", out="baud = 9600"),
    ),
]

DOCTOR = [  # a clock that is not synchronised is a warning, which ends with 1 too
    looked(
        "doctor looks at port, broker, identity and settings, and changes nothing",
        SSW07,
        "ok      broker 127.0.0.1:1883: takes the gateway's login, MQTT 5",
        "ok      line pumps: /dev/pumps opens",
        r"\A(?![\s\S]*echoes)",
        "ok      starter pump: is SSW-07 85.0A",
        r"ok      starter pump: its command sources: P220 = 6 \(Serial \(standard is remote\)\), P229 = ",
        "note    starter pump: no watchdog is on: ",
        code=None,
    ),
    looked(
        "a broker that is away is an error, and a line whose adapter is gone",
        SSW07,
        "error   broker 127.0.0.1:1883: .*nothing listens there",
        "error   line pumps: ",
        "2 errors",
        then=["broker down", "line pumps unplug"],
    ),
    looked(
        "so is a broker that refuses the gateway's login",
        SSW07,
        "error   broker 127.0.0.1:1883: the gateway's login: .*username and password",
        then=[lambda plant: setattr(plant.broker, "refuses", 134)],
    ),
    asked(
        "another login is tried alone, as a second one of the gateway's could disconnect it",
        SSW07 + ALICE,
        "--username alice --password-file DIR/alice.password",
        r"\A(?![\s\S]*the gateway's login)",
        "ok      broker 127.0.0.1:1883: takes the login alice, MQTT 5",
        code=None,
        at_s=3.0,
        files={"alice.password": "hers\n"},
    ),
    looked(
        "another starter than the one configured is an error, or than the one of this family that is known",
        SSW07 + starter("fan", 2, "ssw06") + ALICE,
        "error   starter pump: .*commands would be held",
        "error   starter fan: .*SSW-07",
        end_s=12.0,
        sim={"fan": {"family": "ssw07"}},
        then=[with_sql("UPDATE documents SET body = replace(body, '1.40', '1.30')")],
    ),
    looked("a starter that does not answer is an error", SSW07, "error   starter pump: ", absent=("pump",)),
    looked(
        "four starters that are set up well are no problem",
        FOUR,
        r"\n0 errors, |\nno problems",
        r"\A(?![\s\S]*warning starter)",
        code=None,
    ),
    looked(
        "settings are judged: a watchdog that the polls keep quiet, a start that is not executed",
        SSW07 + starter("second", 2, "ssw07"),
        r"note +starter pump: after 30 s without a request .*\(P314\)",
        "error   starter second: a start is not executed",
        sim={"pump": {"settings": {314: 30, 313: 2}}, "second": {"settings": {230: 0}}},
    ),
    looked(
        "a watchdog that the polls do not keep is a problem",
        line(baud=9600) + "".join(starter(f"p{n}", n, "ssw07") for n in range(1, 9)),
        "it may act although all is well",
        "P314 runs since this look",
        sim={"p1": {"settings": {314: 1}}},
        absent=tuple(f"p{n}" for n in range(2, 9)),
    ),
    asked(
        "where a gateway holds the port it is asked instead",
        SSW900 + ALICE,
        "--client alice",
        "is in use; the gateway is asked over MQTT",
        "starter mill: answers the gateway",
        "C3.2 = 0",
        code=None,
        at_s=5.0,
    ),
    asked(
        "a gateway that no operator may ask is a problem",
        SSW900,
        "",
        r"cannot be asked: .*\[not_allowed\] \(--client NAME asks as another operator\)",
        at_s=5.0,
    ),
    scene(
        "what the gateway knows of a silent starter is said, and of one of another family",
        SSW07 + starter("fan", 2, "ssw06") + ALICE,
        {3.0: fault("silent", "pump")},
        30.0,
        cli(
            "doctor CONFIG",
            code=1,
            out=(
                "starter pump: the gateway says: offline since ",
                re.compile("starter fan: the gateway says: .*it is ssw07, not ssw06"),
            ),
        ),
        sim={"fan": {"family": "ssw07"}},
    ),
    looked(
        "an adapter that echoes is named",
        SSW07,
        "ok      line pumps: its adapter echoes what it sends",
        "ok      starter pump: is SSW-07 85.0A",
        code=None,
        then=["line pumps echo"],
    ),
    looked(
        "a port that is lost on the way is a problem",
        SSW07,
        "line pumps: /dev/pumps opens",
        "1 error",
        then=[lambda plant: plant.loop.call_later(0.3, plant.lines["pumps"].unplug)],
    ),
    looked(
        "a line that is never quiet is an error, once for all its starters",
        SSW07 + starter("second", 2, "ssw07"),
        "error   line pumps: .*the line is never quiet",
        r"\A(?![\s\S]* starter )[\s\S]*\n1 error,",
        then=[chatter(0.002, 60.0)],
    ),
    looked(
        "the corrupted requests that an SSW900 has counted are a problem",
        SSW900,
        r"warning starter mill: it has counted \d+ requests, \d+ replies, 12 requests with a wrong CRC"
        r" and 5 bytes with other errors \(each count begins again after 65535; if errors still",
        then=[_corrupted],
    ),
    row(
        "the slot of an SSW900's accessory decides where its command sources must point",
        given=SSW900 + ALICE,
        at={1.0: ["mill S3.5.1 = 2", "mill S3.5.2 = 0", "mill C3.3 = 5"], 3.0: "end"},
        then={3.0: cli("doctor CONFIG", code=1, out="C3.3 = 5 (Slot 2) (set C3.3 = 4, Slot 1)")},
    ),
]

NO_ENTRIES = ("nonsense", "[]")
AUDIT = [
    scene(
        "the audit says who did what, with the result",
        SSW07 + ALICE,
        {3.0: command("pump/alice/start", operator="Anna"), 6.0: command("pump/bob/stop")},
        8.0,
        cli(
            "audit show CONFIG",
            out=(
                "gateway_started",
                re.compile(r"alice \(says: Anna\): start pump, id id-1: confirmed; .*running false -> true"),
                re.compile(r"bob.*: stop pump, id id-2: rejected \(not_allowed\)"),
            ),
        ),
        cli("audit show CONFIG --last 1", out=re.compile(r"^\d+ [^\n]*bob[^\n]*\n$")),
        cli(
            "audit show CONFIG --last 1 --json",
            json={"client": "bob", "verb": "stop", "code": "not_allowed"},
        ),
        cli("audit verify CONFIG", out="chain whole"),
        cli("audit verify DIR/state", out="chain whole"),
        cli("audit verify CONFIG --contains abc", code=1, out="no line has the hash abc"),
    ),
    row(
        "an entry that was changed breaks the chain; the newest that were cut off only a noted hash shows",
        given=SSW07 + ALICE,
        at={
            3.0: command("pump/alice/start"),
            6.0: "end",
            7.0: with_sql("UPDATE audit SET line = replace(line, 'alice', 'mallory')"),
        },
        then={
            6.0: _cut_off,
            7.0: cli("audit verify CONFIG", code=1, out=("line 2: was changed", "chain broken")),
        },
    ),
    row(
        "what is no entry is shown as such, and an empty table is an empty chain",
        given=SSW07,
        at={
            3.0: [
                "end",
                *(with_sql("INSERT INTO audit (line, upto) VALUES (?, 0)", each) for each in NO_ENTRIES),
            ],
            4.0: with_sql("DELETE FROM audit"),
        },
        then={
            3.0: cli("audit show CONFIG --last 2", out=tuple(f"?  {each!r}\n" for each in NO_ENTRIES)),
            4.0: cli("audit verify DIR/state", out="0 entries from line 1 on, chain whole"),
        },
    ),
]

HISTORY = [
    scene(
        "starts and trips are listed, of one starter or of all, and exported as CSV and COMTRADE",
        SSW07 + starter("fan", 2, "ssw06") + ALICE,
        {**TRIPPED, 9.0: "end"},
        9.0,
        cli(
            "history CONFIG pump",
            out=(
                re.compile(r" start  full voltage, 0\.\d+ s, "),
                " trip   fault E05 Motor overload, was running",
            ),
        ),
        cli("history CONFIG fan", out="no start and no trip is recorded yet"),
        cli("history CONFIG fan --csv -", code=1),
        cli(
            "history CONFIG",
            out=(re.compile(r"Z  pump  .* start "), re.compile(r"Z  pump  .* trip ")),
        ),
        cli(
            "history CONFIG pump --json",
            out=(re.compile(r'^\{"id": .*"outcome": "full_voltage"'), '"code": "e05"'),
        ),
        cli(
            "history CONFIG pump --id 1-1",
            code=2,
            err="there is no record 1-1; without --id they are listed",
        ),
        cli("history CONFIG pump --csv -", out=(re.compile("^t_s,time,"), "current [A]", "fault_code")),
        cli("history CONFIG pump --comtrade DIR/trip", out="trip.cfg: trip "),
        file_has("trip.cfg", ",2013", "current,,,A", "ASCII"),
        file_has("trip.dat"),
        _curve_of_a_start,
        cli("history CONFIG pump --csv DIR/none/x.csv", code=1, out="", err="cannot be written"),
        cli("report CONFIG pump --html DIR/none/x.html", code=1, err="cannot be written"),
        sim={"pump": QUICK},
    ),
    scene(
        "the report has identity, starts and trips, in the language asked for, and as a page",
        SSW07 + ALICE,
        TRIPPED,
        12.0,
        cli(
            "report CONFIG pump",
            out=(
                "Health report: pump",
                "SSW-07 85.0A",
                "85 A",
                "Starts",
                "E05",
                "alice",
                " answered",
            ),
        ),
        cli("report CONFIG pump --no-broker", out="Health report: pump"),
        cli("report CONFIG pump --language es", out="Informe de estado: pump"),
        cli("report CONFIG pump --html DIR/pump.html", out="pump.html: written"),
        file_has("pump.html", "<html", "<svg", "E05", but=("<script",)),
        sim={"pump": QUICK},
    ),
]

BACKUP = [
    scene(
        "a backup of the running gateway is restored elsewhere, its starters locked",
        SSW07 + ALICE + WEB + LOGIN,
        {3.0: command("pump/alice/start")},
        6.0,
        cli(
            "backup CONFIG DIR/b.tar.gz",
            out=("state.sqlite", "left out (--secrets takes them): the password of login anna"),
        ),
        cli("backup CONFIG DIR/b.tar.gz"),  # in place of the earlier one
        cli("backup CONFIG CONFIG", code=2, err="is there, and no backup"),
        cli("restore DIR/b.tar.gz", code=1, out="", err=("already there: ", "--replace", "--to DIR")),
        cli("restore DIR/b.tar.gz --to DIR/new", out="locked until an operator unlocks them: pump"),
        file_has("new/site.toml", 'name = "pump"'),
        cli("restore CONFIG", code=1, out="", err=("is no whole backup", "take another copy")),
        cli(
            "restore DIR/none.tar.gz",
            code=1,
            out="",
            err="none.tar.gz: No such file or directory (name a",
        ),
    ),
    row(
        "what is replaced is set aside, and a start is refused until somebody has unlocked",
        given=SSW07 + ALICE,
        at={
            3.0: [
                ran("backup CONFIG DIR/b.tar.gz"),
                "end",
                ran("restore DIR/b.tar.gz --replace", out="set aside: "),
                "start",
            ],
            80.0: command("pump/alice/start"),
            82.0: command("pump/alice/unlock"),
            84.0: command("pump/alice/start"),
        },
        then={
            81.0: result("start rejected locked"),
            83.0: result("unlock confirmed ok"),
            88.0: result("start confirmed ok"),
        },
    ),
]

ONLINE = "starters/plant  online  LIVE"
WATCH = [
    scene(
        "watch shows each starter with state, current, fault and the last command",
        SSW07 + ALICE + starter("fan", 2, "ssw06"),
        {3.0: command("pump/alice/start")},
        6.0,
        cli(
            "watch CONFIG --once",
            out=(ONLINE, re.compile("fan .* ready"), re.compile("pump .* running")),
        ),
        cli("watch mqtt://127.0.0.1 --once", out=ONLINE),
        sim={"pump": QUICK},
    ),
    row(
        "what is not live is never shown as if it were, and without a broker there is no table",
        given=SSW07,
        at={3.0: "end", 4.0: "broker down"},
        then={
            3.0: cli("watch CONFIG --once", out=("offline (ended by SIGTERM)  NOT LIVE", "unknown?")),
            4.0: cli("watch CONFIG --once", code=1, out="", err="nothing listens there (is the broker run"),
        },
    ),
]

UPGRADE = [
    beside(
        "a watchdog that a restart would trip ends with 75, also one that is only configured",
        SSW07 + starter("fan", 2, "ssw06") + starter("mill", 3, "ssw900", watchdog_s=7.0),
        while_it_runs(
            "check CONFIG --upgrade",
            code=75,
            out=(
                re.compile(r"pump: a restart may leave it .* s at the worst; its watchdog of 5 s is "),
                "mill: a restart may leave it",
                "stop these motors first, or make their watchdogs longer",
            ),
        ),
        while_it_runs(
            "check CONFIG --upgrade --json",
            code=75,
            json={"is_restart_safe": False, "starters/0/is_safe": False, "starters/1/is_safe": True},
        ),
        at_s=6.0,
        sim={"pump": {"settings": {314: 5, 313: 1}}},
    ),
    beside(
        "a restart is safe for a watchdog that is long enough",
        SSW07,
        while_it_runs("check CONFIG --upgrade", out="a restart is safe: no"),
        at_s=6.0,
        sim={"pump": {"settings": {314: 60, 313: 1}}},
    ),
    ended(
        "where no gateway runs a short one is interrupted by nothing",
        SSW07,
        cli("check CONFIG --upgrade", out="no gateway runs with this state_dir"),
        cli("check CONFIG --upgrade --json", json={"is_valid": True, "starters/0/watchdog_s": 5.0}),
        end_s=6.0,
        sim={"pump": {"settings": {314: 5, 313: 1}}},
    ),
]


test_a_tool = played(SCANNING + DOCTOR + AUDIT + HISTORY + BACKUP + WATCH + UPGRADE)


LOCAL = '[mqtt]\nurl = "mqtt://localhost"\nusername = "plant"\n' + SSW07 + ALICE  # without certificates
WRONG_OPTIONS = {
    "two logins have the name": (
        "--viewer alice",
        "--viewer prover",
        "--viewer acl-probe",
        "--login alice=alice",
    ),
    "is no NAME": ("--viewer 'a b'", "--auditor .."),
    "no [[operator]] carol": ("--login x=carol",),
    "is no ADDRESS": tuple(f"--host={x}" for x in ("a,DNS:evil", "bröker.plant", "'a b'", "-a", "{gateway}")),
    "is no NAME=OPERATOR": ("--login x", "--login ..=alice"),
    "is no HOST": tuple(
        f"--bridge {x}" for x in ("central:x", "central:65536", "'central evil:8883'", "[::1]:8883")
    ),
    "is no BASE": tuple(
        f"--bridge central --bridge-base {x}" for x in ("a/#", "'a b'", "'a\ntopic # out'", "$share/a")
    ),
}


def kit(name: str, options: str = "", *, given: str = LOCAL, **said: Any) -> Any:
    """Return a row of `broker-kit`; where it fails nothing is written."""
    return line_row(name, f"broker-kit CONFIG DIR/kit {options}", given=given, **said)


KIT = [
    kit(
        "it is for a login with a name",
        given=SSW07 + ALICE,
        code=78,
        out="",
        err='mqtt.username: is missing: the broker ties topics to it (username = "plant"',
    ),
    kit(
        "an update needs a kit",
        "--update",
        code=2,
        out="",
        err="kit/kit.json: no kit that can be read: No such file or directory (write one first)",
    ),
    *(
        kit(
            f"Sparkplug needs a login of its own at this broker: {scheme}",
            given=LOCAL.replace("mqtt:", f"{scheme}:") + table("sparkplug", group="plant"),
            code=78,
            err=f'username = "plant-spb", {files})',
        )
        for scheme, files in (("mqtt", "password_file"), ("mqtts", "password_file, ca_file"))
    ),
    *(
        kit(
            f"commands that this clock refuses are said where a bridge has them: {options}",
            options,
            given=table("gateway", name="mcc1", clock="untrusted") + LOCAL + 'freshness = "issued_at"\n',
            out=re.compile(says),
        )
        for options, says in (
            ("--bridge central", "warning operator alice: the commands of this operator need issued_at"),
            ("--viewer panel", r"\A(?![\s\S]*need issued_at)"),
        )
    ),
    *(
        kit(f"a bridge cannot have {what}", "--bridge central", given=given, code=2, out="", err=said)
        for what, said, given in (
            (
                "names with spaces",
                "cannot pass 'spBv1.0/the plant/",
                LOCAL + table("sparkplug", group="the plant", urls=["mqtt://localhost"], username="spb"),
            ),
            ("a broker at its port", "port 18883 is", LOCAL.replace("localhost", "localhost:18883")),
        )
    ),
    *(
        kit(f"{options} is refused", options, code=2, out="", err=said)
        for said, wrong in WRONG_OPTIONS.items()
        for options in wrong
    ),
]


@pytest.mark.parametrize("row", KIT)
def test_the_brokers_kit(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)
    assert any((tmp_path / "kit").rglob("*")) is (row.says.code == 0)


def test_a_folder_with_other_things_in_it_gets_no_kit(tmp_path: Path) -> None:
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit" / "bank").write_text("precious")

    play_line(kit("", code=2, out="", err="holds no kit, but bank").values[0], tmp_path)

    assert [path.read_text() for path in (tmp_path / "kit").iterdir()] == ["precious"]
