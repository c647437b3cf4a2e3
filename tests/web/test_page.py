"""The page's requests, without sockets: what is answered to whom."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from gateway.records import EventRecord, Severity
from gateway.web.interface import WebSettings
from gateway.web.static_files import read_files
from tests.web.support import SETTINGS, PageRig, shown_site

STRICT = ("content-security-policy", "x-content-type-options", "referrer-policy", "x-frame-options")


async def test_a_wrong_password_and_an_unknown_user_are_answered_alike() -> None:
    rig = PageRig()

    wrong = await rig.log_in("wrong")
    unknown = await rig.log_in("right", user="not-configured")
    odd = await rig.post("/api/v1/login", {"user": ["anna"], "password": 3})
    long = await rig.post("/api/v1/login", {"user": "anna", "password": "x" * 2000})

    assert {(each.status, each.body) for each in (wrong, unknown, odd, long)} == {(401, wrong.body)}
    assert len(rig.checked) == 4  # each costs one check
    assert rig.access.logins[0] == ("login", "wrong_login", "anna", "alice", "127.0.0.1")
    assert rig.access.logins[1] == ("login", "wrong_login", "", "", "127.0.0.1")


async def test_after_five_wrong_passwords_even_the_right_one_waits_and_costs_no_check() -> None:
    rig = PageRig()
    for _ in range(5):
        await rig.log_in("wrong")
    checks = len(rig.checked)

    refused = await rig.log_in()
    rig.clock.s += 2.0
    accepted = await rig.log_in()

    assert (refused.status, refused.headers["retry-after"]) == (429, "1")
    assert len(rig.checked) == checks + 1
    assert accepted.status == 200


async def test_many_logins_at_once_are_checked_one_by_one_and_most_are_sent_away() -> None:
    rig = PageRig()

    answers = await asyncio.gather(
        *(rig.post("/api/v1/login", {"user": f"u{n}", "password": "x"}) for n in range(40))
    )

    assert len(rig.checked) <= 5
    assert {each.status for each in answers} == {401, 429}


async def test_a_command_that_takes_long_is_answered_without_its_end() -> None:
    rig = PageRig()
    await rig.log_in()
    rig.access.phases = ("accepted", "written")
    answering = asyncio.create_task(rig.post("/api/v1/command/pump-1/start", {"id": "1"}))
    for _ in range(20):  # steps of the loop
        await asyncio.sleep(0)

    [phases] = rig.commands._pending.values()
    phases._final.set()  # as if the time were over

    assert len((await answering).json["phases"]) == 2


async def test_a_bug_in_an_answer_is_logged_and_answered_500(caplog: pytest.LogCaptureFixture) -> None:
    rig = PageRig()
    rig.access.about = lambda: 1 / 0  # type: ignore[assignment, method-assign, return-value]

    answer = await rig.get("/api/v1/gateway")

    assert (answer.status, answer.json["error"]) == (500, "internal")
    assert "ZeroDivisionError" in caplog.text


async def test_under_a_sub_path_and_behind_a_proxy_with_tls() -> None:
    settings = WebSettings(
        base_path="/mcc1/", hosts=("plant.example",), trusted_proxies=("127.0.0.1",), users=SETTINGS.users
    )
    rig = PageRig(settings)
    proxied = {"host": "plant.example", "x_forwarded_proto": "https", "x_forwarded_for": "203.0.113.4"}

    redirect = await rig.get("/mcc1", **proxied)
    stripped = await rig.get("/api/v1/session", **proxied)
    login = await rig.log_in(**proxied, origin="https://plant.example")
    stop = await rig.post("/mcc1/api/v1/command/pump-1/stop", {}, **proxied, origin="https://plant.example")

    assert (redirect.status, redirect.headers["location"]) == (308, "/mcc1/")
    assert stripped.status == 200
    assert login.headers["set-cookie"].startswith("__Host-sid=")
    assert "Secure" in login.headers["set-cookie"]
    assert stop.status == 200
    assert rig.access.logins[0][-1] == "203.0.113.4"


async def test_files_come_with_an_etag_and_compressed_where_that_is_wanted(tmp_path: Path) -> None:
    (tmp_path / "js").mkdir()
    (tmp_path / "index.html").write_text("<!doctype html>" + "x" * 2000)
    (tmp_path / "js" / "app.js").write_text("let a = 1;" * 200)
    (tmp_path / "secret.toml").write_text("password")
    rig = PageRig(files=read_files(tmp_path))

    index = await rig.get("/")
    script = await rig.get("/static/js/app.js", accept_encoding="gzip, br")
    plain = await rig.get("/static/js/app.js", accept_encoding="gzip;q=0, br")
    again = await rig.get("/static/js/app.js", if_none_match=script.headers["etag"])
    secret = await rig.get("/static/secret.toml")

    assert index.headers["content-type"].startswith("text/html")
    assert script.headers["content-encoding"] == "gzip"
    assert len(script.body) < 200
    assert "content-encoding" not in plain.headers
    assert len(plain.body) == 2000
    assert (again.status, again.body) == (304, b"")
    assert secret.status == 404


async def test_events_as_csv_hold_no_formula() -> None:
    rig = PageRig()
    rig.publish(EventRecord("pump-1", "fault", Severity.ERROR, '=HYPERLINK("x")', 1.0, 1, {}))

    answer = await rig.get("/api/v1/events.csv")

    assert "'=HYPERLINK" in answer.body.decode()
    assert ",=" not in answer.body.decode()
    assert "attachment" in answer.headers["content-disposition"]


async def test_check_and_doctor_need_a_login_and_run_one_at_a_time() -> None:
    rig = PageRig()
    assert (await rig.post("/api/v1/check")).status == 401
    await rig.log_in()

    done = await rig.post("/api/v1/doctor")
    rig.access.is_busy = True
    busy = await rig.post("/api/v1/check")

    assert done.json["output"] == "doctor"
    assert (busy.status, busy.headers["retry-after"]) == (503, "5")


async def test_the_whole_state_is_json_with_an_etag() -> None:
    rig = PageRig(site=shown_site("pump-1", groups={"hall": ("pump-1",)}))
    payload = rig.value("pump-1", "current", 12.0)

    first = await rig.get("/api/v1/state")
    same = await rig.get("/api/v1/state", if_none_match=first.headers["etag"])

    assert payload in first.body  # the bytes that MQTT gets
    assert first.json["groups"] == {"hall": ["pump-1"]}
    assert first.json["starters"]["pump-1"]["groups"] == ["hall"]
    assert same.status == 304
    assert first.headers["cache-control"] == "no-store"


@pytest.mark.parametrize("path", ["/api/v1/state", "/api/v1/sparks"])
async def test_what_takes_long_for_many_starters_lets_others_in_between(path: str) -> None:
    names = [f"m{number}" for number in range(247)]
    rig = PageRig(site=shown_site(*names))
    for name in names:
        rig.value(name, "current", 1.0)
    asking = asyncio.create_task(rig.get(path))
    others = 0
    while not asking.done():
        await asyncio.sleep(0)
        others += 1

    assert asking.result().status == 200
    assert others > 20


async def test_health_follows_the_gateways_status() -> None:
    rig = PageRig()
    assert (await rig.get("/health")).status == 503

    for state, status in (("online", 200), ("degraded", 200), ("starting", 503)):
        payload = json.dumps({"state": state}).encode()
        rig.model.publish("starters/mcc1/gateway/status", payload, is_retained=True)
        assert (await rig.get("/health")).status == status
