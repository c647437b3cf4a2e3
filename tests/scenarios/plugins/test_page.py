"""The status page through HTTP: what docs/web-api.md promises."""

from __future__ import annotations

import csv
import gzip
import re
import subprocess
from errno import EADDRINUSE
from typing import Any
from unittest.mock import AsyncMock

import pytest

from gateway.plugins.web import diagnosis
from tests.rig import (
    RigPlant,
    command,
    event,
    frames,
    msg,
    played,
    reload,
    results,
    retained,
    row,
    scene,
    seen,
    that,
)
from tests.rig.rows import Expectation
from tests.rig.sites import (
    ALICE,
    FOUR,
    HOME_ASSISTANT,
    LOGIN,
    METRICS,
    QUICK,
    SPARKPLUG,
    SSW06,
    SSW07,
    WEB,
    line,
    operator,
    starter,
    table,
)
from tests.rig.web import NoSocket, WebBrowser
from tests.scenarios.plugins.doors import SLOW, answer, born, device, log_in, phases, pressed

PAGE = SSW07 + ALICE + WEB + LOGIN
LOOKER = SSW07 + operator("alice", ("stop", "read")) + WEB + LOGIN
GROUP = table("[group]", name="hall", starters=["*"])
TO = "/api/v1/command/pump/"
STOP = "05 00 64 00 00"


RIGHT = {"user": "anna", "password": "right"}
VALUES = "/api/v1/starter/pump/values"


def peaks(plant: RigPlant, name: str, point: str, span: str, least: float, most: float) -> str:
    """Return what is wrong with a point over time: its highest value is not between these."""
    found = plant.get(f"/api/v1/starter/{name}/values?point={point}&span={span}").json
    known = [each for each in found["most"] if each is not None]
    is_whole = len(found["least"]) == len(found["most"]) == len(found["last"])
    return "" if is_whole and known and least < max(known) < most else str(found)[:300]


def shown(plant: RigPlant, part: str) -> Any:
    """Return what the starter's page says: `facts`, `actions`, `commands`."""
    return plant.get("/api/v1/starter/pump").json[part]


def action(verb: str, **fields: Any) -> Expectation:
    """The starter's page says this of an action."""
    return that(lambda plant: {each["verb"]: each for each in shown(plant, "actions")}[verb], fields)


SESSIONS = [
    scene(
        "without a login the page shows everything and does nothing",
        PAGE,
        {},
        5.0,
        answer("/api/v1/state", session={"user": None, "csrf": None, "logins": True}),
        answer(
            "/api/v1/state",
            starters={"pump": {"address": 1, "family": "ssw07", "title": "pump"}},
        ),
        answer(TO + "stop", 401, post={}, error="login"),
        action("stop", permitted=False, code="login"),
        answer("/api/v1/diagnostics.json", 401, error="login"),
        answer("/api/v1/acknowledge/pump/e05", 401, post={}, error="login"),
        frames("pump"),
    ),
    scene(
        "a login has its operator's name and rights, a cookie and a token against forgery",
        PAGE,
        {5.0: log_in()},
        5.1,
        answer(
            "/api/v1/state",
            session={"user": "anna", "client": "alice", "csrf": re.compile("."), "idle_s": 1800},
        ),
        action("stop", permitted=True, code=""),
        action("start", permitted=True, two_step=False),
        msg("audit", verb="login", client="alice", operator="anna", source="web"),
        that(lambda plant: "right" in str(plant.messages("audit")[-1]), False),  # the password
    ),
    *(
        row(
            f"a start is offered in local mode where an {family} obeys the line there, before any command",
            given=line() + starter("pump", 1, family) + ALICE + WEB + LOGIN,
            sim={"pump": {"settings": {229: source}}},
            at={5.0: log_in(), 6.0: "pump control local"},
            then={9.0: action("start", permitted=True, code="")},
        )
        for family, source in (("ssw07", 2), ("ssw06", 2), ("ssw900", 4))
    ),
    row(
        "a wrong password and an unknown user get the same answer; many lock their address, and no other",
        given=PAGE,
        at={5.0: lambda plant: [plant.browser.log_in("anna", "wrong") for _ in range(10)]},
        then={
            4.0: [
                answer("/api/v1/login", 401, post={"user": who, "password": "wrong"}, error="wrong_login")
                for who in ("anna", "unknown")
            ],
            5.5: [
                answer("/api/v1/login", 429, post=RIGHT, error="too_many_logins"),
                lambda plant: setattr(plant.browser, "peer", "127.0.0.9") or "",
                answer("/api/v1/login", 200, post=RIGHT),
            ],
        },
    ),
    row(
        "rights that a reload takes away are gone at the next request, and a session with its user",
        given=PAGE,
        at={5.0: log_in(), 6.0: reload(LOOKER), 9.0: reload(SSW07 + ALICE + WEB)},
        then={
            8.0: [action("start", permitted=False), phases("start", "rejected not_allowed"), frames("pump")],
            11.0: answer(TO + "stop", 401, post={}, error="login"),
        },
    ),
]

REQUESTS = [
    scene(
        "a POST of another page, with another token, name of the machine or two lengths does nothing",
        PAGE,
        {5.0: log_in()},
        5.1,
        *(
            answer(TO + "stop", status, post={}, headers=headers, error=error)
            for status, error, headers in (
                (403, "cross_site", {"origin": "http://evil.example"}),
                (403, "csrf", {"x_csrf_token": "guess"}),
                (421, "host", {"host": "evil.example"}),
                (400, "two_lengths", {"transfer_encoding": "chunked"}),
            )
        ),
        frames("pump"),
        results(),
    ),
    scene(
        "what is not there, not allowed or too big has its own answer",
        PAGE,
        {4.0: log_in()},
        5.0,
        answer("/nothing", 404, error="not_found"),
        answer("/api/v1/starter/absent", 404, error="not_found"),
        answer("/static/../site.toml", 404, error="not_found"),
        answer("/api/v1/login", 405),
        answer(TO + "stop", 413, post=b"{" + b" " * 5000 + b"}", error="too_big"),
        answer("/api/v1/login", 400, post=b"[1", error="bad_json"),
        answer("/api/v1/state", 431, headers={"x_long": "a" * 8192}, error="too_big"),
        phases("fly", "rejected unknown_verb"),
    ),
    row(
        "a starter's page has its facts and its last 20 commands until a reload takes the starter away",
        given=PAGE,
        at={
            3.0: command("pump/alice/lock", id="l1", args={"reason": "belt"}),
            5.0: [log_in(), *[lambda plant: plant.post(TO + "stop", {})] * 2],
            8.0: [command("pump/alice/fly", id=f"f{number}") for number in range(19)],
            10.0: reload(SSW06 + ALICE + WEB),
            12.0: reload(PAGE),
        },
        then={
            7.0: [
                answer("/api/v1/starter/pump", name="pump", facts={"line": "pumps"}, topics=...),
                that(
                    lambda plant: [
                        (each["id"], each["source"], each["args"], len(each["phases"]))
                        for each in shown(plant, "commands")
                    ],
                    [("l1", "mqtt", {"reason": "belt"}, 2), *[(None, "web", {}, 3)] * 2],
                ),
            ],
            9.0: that(lambda plant: [each["id"] for each in shown(plant, "commands")][::19], [None, "f18"]),
            15.0: that(lambda plant: shown(plant, "commands"), []),
        },
    ),
    scene(
        "its history has the records of starts and trips, and when they were",
        PAGE,
        {3.0: command("pump/alice/start"), 15.0: "pump trip E05"},
        40.0,
        that(
            lambda plant: [
                (said[kind][-1]["id"], said[kind][-1]["time"])
                == (plant.last(f"starter/pump/{kind[:-1]}")["id"], said[times][-1])
                for said in [plant.get("/api/v1/starter/pump/history").json]
                for kind, times in (("starts", "started"), ("trips", "tripped"))
            ],
            [True, True],
        ),
        sim={"pump": QUICK},
    ),
    row(
        "values over ten minutes and eight hours are there for every point that is a number",
        given=FOUR + ALICE + WEB,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start"), 60.0: command("pump/alice/stop")},
        then={
            20.0: answer(VALUES, point="current", unit="A", step_s=2.0, is_stored=False),
            100.0: [
                lambda plant: peaks(plant, "pump", "current", "10min", 50, 3000),
                lambda plant: peaks(plant, "pump", "current", "8h", 50, 3000),
                that(
                    lambda plant: max(filter(None, plant.get("/api/v1/sparks").json["starters"]["pump"])) > 50
                ),
                lambda plant: peaks(plant, "mill", "line_voltage", "10min", 395, 405),
                answer(VALUES + "?point=heatsink_temperature", 404, error="not_found"),
                answer(VALUES + "?span=9y", 404, error="not_found"),
            ],
        },
    ),
    scene(
        "its parameters have limits, labels and why one cannot be set, and are read by their codes",
        PAGE,
        {5.0: log_in()},
        5.1,
        that(
            lambda plant: {
                each["code"]: each for each in plant.get("/api/v1/starter/pump/parameters").json["rows"]
            },
            {
                "P314": {"writable": True, "unit": "s", "least": 0, "most": 999},
                "P313": {"labels": {"0": re.compile(".")}},
                "P003": {"writable": False, "why_not": re.compile(".")},
            },
        ),
        phases("read", "accepted ok", "confirmed ok", args={"parameters": ["P003", "P314"]}),
    ),
    scene(
        "a title is the name for people: on the page, in Home Assistant, in Sparkplug, on a report",
        line(title="Hall 2")
        + starter("pump", 1, "ssw07", title="Cooling water 1")
        + table("[group]", name="all", title="Everything", starters=["*"])
        + WEB
        + HOME_ASSISTANT
        + SPARKPLUG,
        {},
        8.0,
        answer(
            "/api/v1/state",
            starters={"pump": {"title": "Cooling water 1", "kind": "WEG SSW-07/SSW-08"}},
            lines={"pumps": {"title": "Hall 2"}},
            groups={"all": {"title": "Everything", "starters": ["pump"]}},
        ),
        retained(device(), device={"name": "Cooling water 1"}),
        msg(born("DBIRTH", "pump"), metrics={"Properties/Title": "Cooling water 1"}),
        that(
            lambda plant: plant.cli("report", "CONFIG", "pump").out,
            re.compile(r"Cooling water 1 \(pump\)"),
        ),
    ),
    scene(
        "events and audit entries can be had as a table",
        PAGE,
        {3.0: command("pump/alice/stop", id="s1")},
        5.0,
        that(
            lambda plant: plant.get("/api/v1/events.csv").text,
            re.compile(r"(?s)\breadiness\b.*\bstop\b"),
        ),
        that(
            lambda plant: len(
                {len(line) for line in csv.reader(plant.get("/api/v1/events.csv").text.splitlines())}
            ),
            1,
        ),
    ),
    scene(
        "what a bug report needs has no secrets in it",
        PAGE,
        {5.0: log_in()},
        5.1,
        that(
            lambda plant: [
                text in plant.get("/api/v1/diagnostics.json").text.replace(" ", "")
                for text in ("scrypt", "(leftout)", '"pump"', '"gateway/status":{"state":')
            ],
            [False, True, True, True],
        ),
    ),
    row(
        "the page is switched on and changed by reloads, and without users it is read-only",
        given=SSW07,
        at={5.0: reload(SSW07 + WEB), 10.0: reload(FOUR + ALICE + WEB + LOGIN)},
        then={
            8.0: [
                event("web_open"),
                answer("/api/v1/state", session={"logins": False}),
                answer(TO + "stop", 401, post={}, error="login"),
                answer("/health", state="online"),
                answer(VALUES, point="current", points=["current"]),  # of before, and not published again
            ],
            14.0: [
                answer("/api/v1/state", session={"logins": True}, starters={"mill": {"address": 3}}),
            ],
        },
    ),
]

COMMANDS = [
    row(
        "a start by the page goes through its phases and stands in the audit under the page's name",
        given=PAGE,
        sim={"pump": QUICK},
        at={5.0: log_in()},
        then={
            5.1: phases("start", "accepted ok", "written ok", "confirmed ok", expect={"state": "ready"}),
            9.0: [
                frames("pump", "05 00 64 ff 00"),
                msg(
                    "audit", client="alice", verb="start", source="web", operator="anna", decision="confirmed"
                ),
            ],
        },
    ),
    row(
        "without a broker the page goes on, stops a motor and is well, also where a line is away",
        given=PAGE,
        sim={"pump": QUICK},
        at={
            5.0: [log_in(), command("pump/alice/start")],
            8.0: "broker down",
            20.0: "line pumps unplug",
        },
        then={
            7.0: answer("/health", state="online", lines={"pumps": True}, broker=True),
            15.0: [
                answer("/health", lines={"pumps": True}, broker=False),
                answer("/api/v1/state", topics={"starter/pump/state": {"state": "running"}}),
                phases("stop", "accepted ok", "written ok", "confirmed ok"),
                frames("pump", "05 00 64 ff 00", STOP),
            ],
            30.0: answer("/health", lines={"pumps": True}, broker=False),
        },
    ),
    scene(
        "a stop of a group is answered to its end, also where one of its starters is silent",
        FOUR + ALICE + WEB + LOGIN + GROUP,
        {5.0: [log_in(), "belt power off"]},
        40.0,
        that(
            lambda plant: {
                name: each["phase"]
                for said in [plant.post("/api/v1/command/hall/stop", {}).json]
                if said["final"]
                for name, each in said["phases"][-1]["members"].items()
            },
            {**dict.fromkeys(("pump", "fan", "mill"), "confirmed"), "belt": "unconfirmed"},
        ),
    ),
    scene(
        "a start with an old token, with none, or on another state than was seen is refused",
        PAGE,
        {5.0: log_in(), 5.2: lambda plant: plant.browser.__dict__.update(old=plant.token())},
        20.0,
        lambda plant: phases("start", "rejected expired", token=plant.browser.__dict__["old"])(plant),
        phases("start", "rejected not_fresh", token=None),
        phases("start", "accepted ok", "rejected not_as_expected", expect={"state": "running"}),
        frames("pump"),
    ),
    scene(
        "why a start is not possible is said before and after it is tried",
        PAGE,
        {3.0: "pump trip E05", 8.0: log_in()},
        8.1,
        action("start", permitted=False, code="fault_active"),
        action("reset", permitted=True),
        phases("start", "accepted ok", "rejected fault_active"),
    ),
    scene(
        "with two steps a start needs the selection that the page makes first",
        PAGE.replace("[[operator]]", '[line.starter.rules]\ntwo_step = ["start"]\n[[operator]]', 1),
        {5.0: log_in()},
        5.1,
        action("start", two_step=True),
        phases("start", "rejected select_first"),
        lambda plant: phases(
            "start",
            "accepted ok",
            "written ok",
            "confirmed ok",
            select=pressed(plant, "select", args={"verb": "start"}).json["phases"][-1]["select"],
        )(plant),
        sim={"pump": QUICK},
    ),
]


def acknowledged(*codes: str) -> Expectation:
    """The page shows that Anna has acknowledged these alarms, and no others."""
    return that(
        lambda plant: [(code, each["by"]) for code, each in shown(plant, "facts")["acknowledged"].items()],
        [(code, "anna") for code in codes],
    )


def acknowledge(plant: RigPlant) -> None:
    plant.post("/api/v1/acknowledge/pump/e05", {})


ALARMS = [
    scene(
        "an alarm is acknowledged by a login, with an event and in the audit, and nothing is reset",
        LOOKER,
        {5.0: "pump trip E05", 8.0: [log_in(), acknowledge]},
        8.1,
        acknowledged("e05"),
        event("alarm_acknowledged", topic="starter/pump/event"),
        msg("audit", verb="acknowledge", client="alice", operator="anna", args={"alarm": "e05"}),
        msg("starter/pump/alarm/e05", active=True),
        answer("/api/v1/acknowledge/pump/e24", 409, post={}, error="not_active"),
        answer("/api/v1/acknowledge/absent/e05", 404, post={}),
        frames("pump"),
    ),
    scene(
        "an alarm that is acknowledged stays with its first person",
        PAGE,
        {5.0: "pump trip E05", 8.0: [log_in(), acknowledge], 9.0: acknowledge},
        10.0,
        seen("audit", times=1, verb="acknowledge"),
        that(lambda plant: shown(plant, "facts")["acknowledged"]["e05"]["time"][17:19], "08"),
    ),
    row(
        "an acknowledgement ends, also on open pages, when its alarm clears or comes again, or by a restart",
        given=PAGE,
        at={
            5.0: "pump trip E05",
            7.0: lambda plant: setattr(plant, "stream", plant.browser.stream()),
            8.0: [log_in(), acknowledge],
            12.0: "pump clear",
            16.0: "pump trip E05",
            22.0: acknowledge,
            25.0: "restart",
        },
        then={
            11.0: acknowledged("e05"),
            15.0: [
                acknowledged(),
                that(
                    lambda plant: [
                        sorted(data["starters"]["pump"]["acknowledged"])
                        for _, data in plant.stream.events[1:]
                        if "starters" in data
                    ],
                    [["e05"], []],
                ),
            ],
            21.0: acknowledged(),
            24.0: acknowledged("e05"),
            35.0: [acknowledged(), msg("starter/pump/alarm/e05", active=True)],
        },
    ),
]


test_the_page = played(SESSIONS + REQUESTS + ALARMS)
test_commands_by_the_page = played(COMMANDS)


def test_a_stream_brings_a_snapshot_then_changes_and_beats_and_a_snapshot_after_a_reload() -> None:
    with RigPlant(FOUR + ALICE + WEB) as plant:
        plant.run(until=4.0)
        plant.command("pump/alice/stop")
        plant.run(until=5.0)
        of_all, of_one = (plant.browser.stream(scope) for scope in ("", "?starter=pump"))
        plant.run(until=6.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "trip", "E05"))
        plant.run(until=25.0)
        events = of_all.events
        records = [
            {each["topic"] for data in bodies for each in data.get("messages", ())}
            & {"result/pump/alice", "starter/pump/trip"}
            for stream in (of_all, of_one)
            for bodies in ([stream.events[0][1]], [data for _, data in stream.events[1:]])
        ]
        plant.reload(SSW07 + WEB)
        plant.run(until=28.0)

        assert set([data for name, data in of_all.events if name == "snapshot"][-1]["starters"]) == {"pump"}
        assert records == [set(), set(), {"result/pump/alice"}, {"starter/pump/trip"}]
        assert events[0][0] == "snapshot"
        assert {name for name, _ in events} <= {"snapshot", "change", "beat"}
        snapshot, changes = events[0][1], [data for name, data in events if name == "change"]
        assert set(snapshot["starters"]) == {"pump", "fan", "mill", "belt"}
        assert "starter/pump/value/line_frequency" not in snapshot["topics"]
        assert "starter/pump/value/line_frequency" in of_one.events[0][1]["topics"]
        assert "starter/pump/value/current" in snapshot["topics"]
        assert any(data["topics"].get("starter/pump/alarm/e05", {}).get("active") for data in changes)
        assert any(each["payload"].get("code") == "fault" for data in changes for each in data["messages"])
        generations = [data["gen"] for _, data in events]
        assert generations == sorted(generations)


def test_who_follows_the_changes_has_what_the_whole_would_be_at_most_four_times_a_second() -> None:
    with RigPlant(FOUR + ALICE + WEB, sim={"pump": SLOW, "mill": SLOW}) as plant:
        plant.run(until=5.0)
        stream = plant.browser.stream()
        plant.run(until=6.0)
        plant.command("pump/alice/start")
        plant.command("mill/alice/start")
        plant.run(until=20.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "trip", "E05"))
        plant.run(until=24.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "clear", ""))
        plant.run(until=40.0)
        whole = plant.get("/api/v1/state")

        followed: dict[str, Any] = {}
        texts = []
        for name, data in stream.events:
            followed = {} if name == "snapshot" else followed
            followed |= data.get("topics", {})
            said = data.get("messages", ()) if name == "change" else ()
            texts += [each["payload"]["seq"] for each in said if each["topic"].endswith("/event")]
        assert {topic: said for topic, said in followed.items() if said is not None} == whole.json["topics"]
        happened = [each.json["seq"] for each in plant.messages("#", since=5.1) if "/event" in each.topic]
        assert sorted(texts) == texts == happened
        assert 30 < [name for name, _ in stream.events].count("change") <= 35 * 4


def test_a_quiet_stream_beats_with_ages_and_one_that_is_not_read_begins_anew() -> None:
    with RigPlant(SSW07 + ALICE + WEB, sim={"pump": QUICK}) as plant:
        plant.run(until=30.0)
        stream = plant.browser.stream()
        plant.run(until=60.0)
        beats = [data for name, data in stream.events if name == "beat"]
        assert 24 <= len(beats) <= 30
        assert all(beat.keys() - {"ages"} == {"gen", "time", "token"} for beat in beats)
        assert all(0 <= age < 2.5 for beat in beats for age in beat.get("ages", ()))

        before = len(stream.events)
        plant.do(stream.may_come.clear)
        for number in range(210):
            plant.command("pump/alice/stop")
            plant.run(until=60.0 + number / 10)
        plant.do(stream.may_come.set)
        plant.run(until=85.0)

        assert "snapshot" in [name for name, _ in stream.events[before : before + 3]]


def test_below_a_path_and_behind_a_proxy_with_tls_the_callers_own_address_counts() -> None:
    proxied = {
        "host": "plant.example",
        "origin": "https://plant.example",
        "x_forwarded_proto": "https",
        "x_forwarded_for": "127.0.0.1, 203.0.113.4",
    }
    web = table(
        "web",
        listen="127.0.0.1:8480",
        base_path="/mcc1/",
        hosts=["plant.example"],
        trusted_proxies=["127.0.0.1"],
    )
    with RigPlant(SSW07 + ALICE + web + LOGIN + METRICS) as plant:
        plant.run(until=5.0)
        redirect = plant.get("/mcc1", **proxied)
        login = plant.post("/mcc1/api/v1/login", {"user": "anna", "password": "right"}, **proxied)
        cookie = login.headers["set-cookie"]
        session = {**proxied, "cookie": cookie.split(";")[0], "x_csrf_token": login.json["csrf"]}
        stop = plant.post("/mcc1/api/v1/command/pump/stop", {}, **session)
        scraped = plant.get("/metrics", **proxied, accept_encoding="gzip")
        plain = plant.get("/metrics", **{**proxied, "x_forwarded_proto": "http"})

        assert (redirect.status, redirect.headers["location"]) == (308, "/mcc1/")
        assert cookie.startswith("__Host-sid=")
        assert "Secure" in cookie
        assert ["strict-transport-security" in each.headers for each in (login, plain)] == [True, False]
        assert stop.json["final"] is True
        assert plant.messages("audit")[0].json["args"]["address"] == "203.0.113.4"
        assert b"starter_gateway_starter_online" in gzip.decompress(scraped.body)
        assert (scraped.status, plain.status) == (200, 403)


def test_values_of_an_earlier_run_or_of_a_starter_that_was_taken_out_are_shown_where_they_are_stored() -> (
    None
):
    stored = PAGE + table("history", values=["current"])
    with RigPlant(stored, sim={"pump": QUICK}) as plant:
        plant.run(until=3.0)
        plant.command("pump/alice/start")
        plant.run(until=190.0)
        plant.reload(SSW06 + ALICE + WEB + LOGIN + table("history", values=["current"]))
        plant.run(until=195.0)
        plant.reload(stored)
        plant.run(until=205.0)
        shown = plant.get(f"{VALUES}?point=current&span=8h").json
        plant.restart()
        plant.run(until=220.0)
        rows = [plant.get(f"{VALUES}?point=current&span={span}").json for span in ("10min", "8h", "7d")]

        assert max(filter(None, shown["most"])) > 100  # the start
        most = [max(filter(None, each["most"]), default=0.0) for each in rows]
        assert most[0] < most[1] == most[2]  # the start's current; the last ten minutes are this run's
        known = [[value is not None for value in rows[1][column]] for column in ("least", "most", "last")]
        assert known[0] == known[1] == known[2]  # the line as far as its band
        assert known[0].count(True) == 5
        assert [len(each["most"]) for each in rows] == [300, 480, 672]
        assert all(each["is_stored"] for each in rows)


def test_where_the_gateway_stood_still_there_is_a_gap_and_the_value_holds_after_it() -> None:
    with RigPlant(PAGE, sim={"pump": QUICK}) as plant:
        plant.run(until=60.0)
        plant.stand_still(40.0)
        plant.run(until=120.0)
        lasts = plant.get(f"{VALUES}?point=current&span=10min").json["last"]

        known = [value is not None for value in lasts[-55:]]
        assert 18 <= known.count(False) <= 21
        assert all([*known[:5], *known[-8:]])


def test_doctor_asks_as_who_is_logged_in_and_no_password_is_in_the_journal(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("DEBUG")
    ran: list[list[str]] = []
    done = subprocess.CompletedProcess([], 0, stdout=b"well")
    monkeypatch.setattr(diagnosis.subprocess, "run", lambda command, **_: ran.append(command) or done)
    with RigPlant(PAGE) as plant:
        plant.run(until=5.0)
        plant.browser.log_in("anna", "wrong horse")
        plant.browser.log_in("anna", "right")
        said = [plant.post(f"/api/v1/{name}", {}).json["output"] for name in ("doctor", "check")]

    assert said == ["well", "well"]
    assert [command[command.index("gateway") + 1] for command in ran] == ["doctor", "check"]
    assert ran[0][-2:] == ["--client", "alice"]
    assert "--client" not in ran[1]
    assert "web login: user=anna client=alice" in caplog.text
    assert not re.search("wrong horse|right", caplog.text)


def test_an_address_that_stays_in_use_is_one_event(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NoSocket, "run", AsyncMock(side_effect=OSError(EADDRINUSE, "in use")))
    with RigPlant(SSW07 + WEB) as plant:
        plant.run(until=30.0)
        assert plant.events().count("web_away") == 1

        monkeypatch.undo()
        plant.run(until=40.0)
        assert plant.events().count("web_open") == 1


def test_a_certificate_that_cannot_be_read_again_by_a_reload_is_one_event(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tls = SSW07 + WEB + 'cert_file = "page.pem"\nkey_file = "page.key"\n'
    monkeypatch.setattr(NoSocket, "renew", AsyncMock(side_effect=OSError("half a file")))
    with RigPlant(tls, files={"page.pem": "", "page.key": ""}) as plant:
        plant.run(until=5.0)
        plant.reload(tls + table("history", values=["current"]))
        plant.run(until=10.0)

        said = [code for code in plant.events() if code.startswith("web_")]
        assert said == ["web_open", "web_certificate"]


def test_files_come_with_an_etag_and_compressed_where_that_is_wanted() -> None:
    with RigPlant(SSW07 + WEB) as plant:
        plant.run(until=5.0)
        (script, *_) = re.findall(r"[\w./]*static/[\w/.-]+\.js", plant.get("/").text)
        path = "/" + script.lstrip("./")
        plain = plant.get(path)
        packed = plant.get(path, accept_encoding="gzip, br")
        again = plant.get(path, if_none_match=packed.headers["etag"])

        assert "javascript" in plain.headers["content-type"]
        assert "content-encoding" not in plain.headers
        assert gzip.decompress(packed.body) == plain.body
        assert len(packed.body) < len(plain.body)
        assert (again.status, again.body) == (304, b"")


@pytest.mark.parametrize("path", [TO + "start", TO + "stop", "/api/v1/logout", "/api/v1/check"])
def test_a_logout_ends_the_sessions_stream_and_refuses_what_has_not_come_whole(path: str) -> None:
    with RigPlant(PAGE) as plant:
        plant.run(until=5.0)
        plant.browser.log_in("anna", "right")
        stream = plant.browser.stream()
        begun = plant.browser.begin_post(path, {"id": "late", "token": plant.token()})
        plant.run(until=6.0)
        plant.post("/api/v1/logout", {})
        plant.do(begun.may_go.set)
        plant.run(until=8.0)

        assert (begun.status, begun.json["error"]) == (401, "login")
        assert not frames("pump")(plant)
        assert plant.results() == []
        assert (stream.events[-1][0], stream.events[-1][1]["user"], stream.is_over) == ("session", None, True)


def test_each_stop_by_the_page_is_answered_without_id_or_token_although_one_is_under_way() -> None:
    with RigPlant(PAGE, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        plant.browser.log_in("anna", "right")
        begun = [plant.browser.begin_post(TO + "stop") for _ in range(3)]
        for each in begun:
            plant.do(each.may_go.set)
        plant.run(until=8.0)

        assert [each.json["final"] for each in begun] == [True, True, True]
        assert {each.json["phases"][-1]["phase"] for each in begun} == {"confirmed"}
        assert plant.starter("pump").writes[0][1] == STOP


@pytest.mark.parametrize(("addresses", "most", "text"), [(1, 32, "32 of 32"), (99, 48, "48 of 48")])
def test_more_pages_than_an_address_or_all_may_have_are_refused_until_one_is_closed(
    addresses: int, most: int, text: str
) -> None:
    with RigPlant(SSW07 + WEB) as plant:

        def come(number: int) -> WebBrowser:
            plant.browser.peer = f"10.0.0.{1 + number % addresses}"
            return plant.browser

        plant.run(until=5.0)
        streams = [come(number).stream() for number in range(most)]
        beyond = come(most).get("/api/v1/events")
        streams[0].close()
        plant.run(until=6.0)
        again = come(most).stream()
        plant.run(until=6.5)

        assert (beyond.status, beyond.json["error"], beyond.headers["retry-after"]) == (503, "busy", "5")
        assert text in beyond.json["text"]
        assert again.status == 200


@pytest.mark.parametrize(
    ("given", "caller", "headers", "status"),
    [
        (METRICS, ("127.0.0.1", "http"), {}, 200),
        (METRICS, ("10.0.0.7", "https"), {}, 200),
        (METRICS, ("10.0.0.7", "http"), {}, 403),
        (METRICS + 'token_file = "token"\n', ("127.0.0.1", "http"), {}, 401),
        (METRICS + 'token_file = "token"\n', ("10.0.0.7", "http"), {"authorization": "Bearer wrong"}, 401),
        (METRICS + 'token_file = "token"\n', ("10.0.0.7", "https"), {"authorization": "Bearer s3cret"}, 200),
        (METRICS, ("127.0.0.1", "http"), {"host": "evil.example"}, 421),
        ("", ("127.0.0.1", "http"), {}, 404),
    ],
)
def test_who_may_scrape(given: str, caller: tuple[str, str], headers: dict[str, str], status: int) -> None:
    with RigPlant(SSW07 + WEB + given, files={"token": "s3cret"}) as plant:
        plant.run(until=5.0)
        plant.browser.peer, plant.browser.scheme = caller

        assert plant.get("/metrics", **headers).status == status
