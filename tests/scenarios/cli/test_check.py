"""`check`: right, unwise, wrong, each mistake with line, key and remedy; and wrong uses of any command."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.rig.sites import ALICE, FOUR, SSW07, WEB, line, operator, starter, table
from tests.scenarios.cli.lines import LineRow, Texts, line_row, play_line

WATCHDOGS = tuple(enumerate((7.0, 12.0, 40.0, 2.5), 1))  # s

NO_REPEATER = re.compile(r"\A(?![\s\S]*repeater)")
NO_TLS = '[mqtt]\nurl = "mqtt://broker.plant"\nallow_plaintext = true\n'
CROWDED = line(baud=9600) + "".join(starter(f"p{n}", n, "ssw07", every_s=0.1) for n in range(1, 9))
PRICED = starter("fan", 2, "ssw06", points=["P314", "P220", "P003"]) + starter(
    "mill", 3, "ssw900", points=["S1.1.?"]
)
GUARDED = starter("pump", 1, "ssw07", watchdog_s=60.0) + starter("fan", 2, "ssw06", watchdog_s=0.0)
DATED = '[gateway]\nname = "a"\nclock = "untrusted"\n' + SSW07 + operator("alice", freshness="issued_at")
SPARKPLUG = table("sparkplug", group="plant", commands=True, operator="alice")


def crowd(*families: str, baud: int = 19200, **keys: float) -> str:
    starters = (starter(f"s{n}", n, each, **keys) for n, each in enumerate(families, 1))
    return line(baud=baud) + "".join(starters)


SAID: list[tuple[str, str, Texts]] = [
    (
        "the budget of each line is printed",
        FOUR + ALICE,
        (
            "site.toml: valid, 4 starters on 1 line, 1 operator\n",
            re.compile(
                r"line pumps: /dev/pumps, 19200 8N2\n  load \d+%, sweep [\d.]+ s, a stop waits at most "
            ),
            re.compile(r"pump +1 +ssw07 .* not stated, must be above [\d.]+ s"),
        ),
    ),
    (
        "a watchdog has its margin",
        line() + GUARDED,
        (re.compile(r"pump +1 +ssw07 .* 60 s, [\d.]+ s to spare"), re.compile(r"fan +2 +ssw06 .* off")),
    ),
    (
        "points that are asked for have their price",
        line() + PRICED,
        (
            re.compile(r"  points asked for: fan 2, mill 4; 4 reads more, 2\.\d% of its time\n"),
            "  fan has as points already: P003\n",
            "  mill has as points already: S1.1.4, S1.1.5\n",
        ),
    ),
    (
        "periods that the line cannot keep are stretched with a warning",
        CROWDED,
        re.compile(
            r"(?m)^warning line pumps: asked for 10\d\d% of its time, periods become [\d.]+ times as long"
        ),
    ),
    (
        "a plain ttyUSB, which may be another tomorrow, and a broker without TLS are warned of",
        NO_TLS + SSW07.replace("/dev/pumps", "/dev/ttyUSB9"),
        (
            "warning line pumps: /dev/ttyUSB9 may be another adapter tomorrow (use a name",
            "warning mqtt.url: passwords and commands cross the network unencrypted (use mqtts://)",
        ),
    ),
    ("a site without operators is read-only", SSW07, "1 starter on 1 line, read-only\n"),
    (
        "31 starters need a repeater",
        crowd(*["ssw07"] * 31),
        "31 starters need a repeater, WEG SSW-07/SSW-08 allows 30 without (put",
    ),
    ("32 SSW900 need none", crowd(*["ssw900"] * 32), NO_REPEATER),
    (
        "the weakest counts",
        crowd(*["ssw900"] * 30, "ssw06"),
        "31 starters need a repeater, WEG SSW-06 allows 30",
    ),
    ("the SST's manual names no limit", crowd(*["sst"] * 40), NO_REPEATER),
    ("lines may end as on Windows", SSW07.replace("\n", "\r\n"), "valid"),
    (
        "a watchdog acts when the gateway crashes, or hangs, or in neither case, or is tight",
        line() + "".join(starter(f"s{n}", n, "ssw900", every_s=2.0, watchdog_s=w) for n, w in WATCHDOGS),
        (
            "to spare, outlasts nothing\n",
            "warning starter s1: its watchdog of 7 s acts when the gateway crashes: ",
            "outlasts a crash\n",
            "starter s2: its watchdog of 12 s acts when the gateway hangs: ",
            "outlasts both\n",
            "warning starter s4: its watchdog of 2.5 s has ",
        ),
    ),
    (
        "an authority, a certificate and a key are missing",
        '[mqtt]\nurl = "mqtts://b"\nca_file = "plant-ca.pem"\n'
        + SSW07
        + table("web", cert_file="w.pem", key_file="web.key"),
        ("warning mqtt.ca_file: ", "warning web.cert_file: ", "warning web.key_file: "),
    ),
    ("a clock proves nothing", DATED, "warning operator alice: the commands of this operator need issued_at"),
    (
        "hosts of Sparkplug are one person",
        SSW07 + ALICE + SPARKPLUG,
        "warning sparkplug.commands: every Sparkplug host is the same person, operator alice",
    ),
]
JSON: list[tuple[str, str, dict[str, object]]] = [
    (
        "",
        line() + starter("pump", 1, "ssw07", watchdog_s=60.0),
        {
            "is_valid": True,
            "warnings": [],
            "lines/0/line": "pumps",
            "lines/0/is_overloaded": False,
            **dict.fromkeys(("lines/0/load", "lines/0/sweep_s", "lines/0/stop_latency_s"), ...),
            "lines/0/starters/0/watchdog_s": 60.0,
            **{
                f"lines/0/starters/0/{key}": ... for key in ("watchdog_margin_s", "crash_gap_s", "hang_gap_s")
            },
        },
    ),
    (
        "",
        line() + starter("fan", 2, "ssw06", points=["P314"]),
        {"lines/0/extra_points/count": 1, "lines/0/extra_points/reads": 1, "lines/0/extra_points/load": ...},
    ),
    (
        "--upgrade",
        SSW07,
        {"is_valid": True, "is_running": False, "is_restart_safe": True, "starters/0/starter": "pump"},
    ),
]

RIGHT = [line_row(name, "check CONFIG", given=given, out=said, err="") for name, given, said in SAID]
RIGHT += [
    line_row(f"as JSON {words or given}", f"check CONFIG --json {words}", given=given, json=fields)
    for words, given, fields in JSON
]

MISTAKES = [  # the others: tests/config
    (
        "an unknown key is answered with those that there are",
        SSW07 + "[web]\nport = 1\n",
        "line 18: web.port: unknown key (one of listen, ",
    ),
    (
        "secrets that are missing are found at once",
        '[mqtt]\nurl = "mqtt://127.0.0.1"\nusername = "mcc1"\npassword_file = "mqtt.password"\n'
        + SSW07
        + WEB
        + table("metrics", token_file="scrape.token")
        + table("history", values=["x"])
        + table("homeassistant", operator="Bob"),
        (
            "homeassistant.operator: is 'Bob' (only",  # and no mistake hides another
            "history.values[0]: 'x' is a point of no starter",
            re.compile(
                r"line 8: mqtt.password_file: \S+/mqtt.password: No such file or directory \(create it, mode"
            ),
            re.compile(r"metrics.token_file: \S+/scrape.token: No such file or directory"),
        ),
    ),
    ("no line", ALICE, "line: is missing (at least one [[line]] is needed)"),
    ("a header that is not closed", SSW07 + "[web\n", "line 17: syntax: Expected ']'"),
    (
        "a watchdog that the line cannot keep",
        crowd(*["ssw07"] * 19, baud=9600, watchdog_s=1.0),
        "line[0].starter[18].watchdog_s: s19: 1 s is too short: the watchdogs on this "
        "line need 278% of the line's time (14 of its 19 starters on another line, or no watchdog below 3 s)",
    ),
    (
        "every single change that helps is offered",
        crowd(*["ssw07"] * 7, baud=9600, watchdog_s=1.0),
        "(baud = 19200, or 2 of its 7 starters on another line, or no watchdog below 2 s)",
    ),
    (
        "but no rate that the family does not have",
        crowd(*["ssw06"] * 14, baud=38400, watchdog_s=1.0),
        re.compile(r"\A(?![\s\S]*baud =)"),
    ),
    (
        "and no watchdog that nothing has",
        crowd(*["sst"] * 247, baud=1200, watchdog_s=255.0, response_time_s=10.0),
        re.compile(r"\(\d+ of its 247 starters on another line\)"),
    ),
]

WRONG = [
    line_row(name, "check CONFIG", given=given, code=78, out="", err=said) for name, given, said in MISTAKES
]

ALL_AT_ONCE = line(baud=1234) + starter("Pump", 0, "ssw99", foo=1) + operator("alice", may=("strat",))

OTHERS = [
    line_row(
        "all mistakes are reported at once, a line each, in the file's order",
        "check CONFIG",
        given=ALL_AT_ONCE,
        code=78,
        out="",
        err=re.compile(
            r"^(starter-gateway: \S+site\.toml: line \d+: \S+: [^\n]+\n){6}$",
        ),
    ),
    line_row(
        "as JSON each has line, key, what and remedy",
        "check CONFIG --json",
        given=SSW07 + starter("fan", 1, "ssw06"),
        code=78,
        json={
            "is_valid": False,
            "problems/0/line": 19,
            "problems/0/key": "line[0].starter[1].address",
            "problems/0/what": "1 is also line[0].starter[0].address",
            "problems/0/hint": "each starter on a line needs its own address",
        },
    ),
    line_row(
        "a file that is not there",
        "check DIR/none.toml",
        code=78,
        out="",
        err="none.toml: file: No such file or directory (is the path right, and may this user read it?)",
    ),
    line_row(
        "`run` ends with the same", "run DIR/none.toml", code=78, out="", err="No such file or directory"
    ),
    line_row(
        "and says of a wrong configuration what `check` says",
        "run CONFIG",
        given=SSW07 + 'famly = "ssw07"\n',
        code=78,
        out="",
        err="line[0].starter[0].famly: unknown key (did you mean family?)",
    ),
    line_row(
        "the schema knows each table",
        "schema",
        json={
            "properties/gateway": ...,
            "properties/mqtt": ...,
            "properties/line": ...,
            "properties/operator": ...,
            "properties/sparkplug": ...,
            "required": ["gateway", "mqtt", "line"],
            "additionalProperties": False,
            "$defs/StarterTable/properties/address/maximum": 247,
        },
    ),
    *(
        line_row(
            f"without a history: {words}",
            words,
            given=SSW07,
            code=1,
            out="",
            err="history.sqlite: No such file or directory (has a gateway run with this state_dir?)",
        )
        for words in ("history CONFIG pump", "report CONFIG pump --no-broker")
    ),
    line_row(
        "a capture of a gateway that does not run",
        "capture CONFIG DIR/x.pcapng",
        given=SSW07,
        code=1,
        out="",
        err=".capture: No such file or directory (is this gateway running",
    ),
    line_row("the version is printed", "--version", out=re.compile(r"^starter-gateway \d+\.\d+\.\d+")),
]

USAGE = [
    line_row(f"wrong use: {words or 'nothing at all'}", words, given=SSW07 + ALICE, code=2, out="", err=said)
    for words, said in [
        ("frobnicate", "no command 'frobnicate' (one of run, demo, "),
        ("watc CONFIG", "no command 'watc' (did you mean watch?)"),
        ("report CONFIG pmup", "no starter 'pmup' (did you mean pump?)"),
        ("check", "the following arguments are required: CONFIG (see starter-gateway check --help)"),
        ("report CONFIG pump --client alice", "--client alice (see starter-gateway report --help)"),
        ("send CONFIG mill stop", "no starter 'mill' (one of pump)"),
        ("send CONFIG pump start P314", "'P314' is not KEY=VALUE"),
        ("send CONFIG pump start --timeout 0", "--timeout 0 leaves no time for a result: nothing was sent"),
        ("send CONFIG pump start --timeout=-1", "nothing was sent"),
        ("send CONFIG pump start --timeout=nan", "nothing was sent"),
        ("send CONFIG pump Start", "no verb 'Start'"),
        ("send CONFIG pump start --client A/b", "--client 'A/b' is no name"),
        ("send CONFIG pump start --username alice", "no password for alice"),
        *(
            (f"send CONFIG pump start expect={what}", "is not POINT:VALUE")
            for what in ("ready", "state:", ":x", "a:b,c")
        ),
        ("scan /dev/null --baud 12345", "--baud"),
        ("scan /dev/null --framing 7E1", "--framing"),
        ("scan /dev/null --address 0-300", "--address"),
        ("scan /dev/null --reply-within 0", "--reply-within"),
        ("parameters save CONFIG mill -", "no starter 'mill' (one of pump)"),
        ("history CONFIG mill", "no starter 'mill' (one of pump)"),
        ("report CONFIG mill", "no starter 'mill' (one of pump)"),
        *((f"capture CONFIG DIR/x.pcapng --seconds={what}", "--seconds") for what in ("nan", "inf", "0")),
        ("audit show DIR", "no audit in "),
        ("audit show CONFIG --last 0", "--last 0 shows nothing"),
        ("watch mqtt://127.0.0.1 --base Plant/#", "each level is"),
        ("watch mqtt://broker.plant --username alice", "unencrypted"),
        ("watch ftp://x", "ftp"),
    ]
]


@pytest.mark.parametrize("row", RIGHT + WRONG + OTHERS)
def test_check(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)


@pytest.mark.parametrize("row", USAGE)
def test_a_wrong_use_ends_with_2_and_one_line(row: LineRow, tmp_path: Path) -> None:
    play_line(row, tmp_path)
