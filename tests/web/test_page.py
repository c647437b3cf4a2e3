"""The page's requests, without sockets: what is answered to whom."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from gateway.records import EventRecord, Severity
from gateway.web.interface import WebSettings, WebUser
from gateway.web.static_files import read_files
from tests.web.support import HOST, ORIGIN, SETTINGS, USER, PageRig, shown_site

STRICT = ("content-security-policy", "x-content-type-options", "referrer-policy", "x-frame-options")


async def test_everybody_may_look_and_only_who_is_logged_in_may_do_something() -> None:
    rig = PageRig()
    rig.state("pump-1", "ready")

    state = await rig.get("/api/v1/state")
    start = await rig.post("/api/v1/command/pump-1/start", {"id": "1"})
    stop = await rig.post("/api/v1/command/pump-1/stop")
    diagnostics = await rig.get("/api/v1/diagnostics.json")

    assert state.json["topics"]["starter/pump-1/state"]["state"] == "ready"
    assert [start.status, stop.status, diagnostics.status] == [401, 401, 401]
    assert start.json["error"] == "login"
    assert rig.access.commands == []


async def test_a_login_gives_the_operators_rights_and_its_name_as_the_claim() -> None:
    rig = PageRig()

    session = await rig.log_in()
    answer = await rig.post("/api/v1/command/pump-1/start", b'{"id":"1"}')

    assert session.json["client"] == "alice"
    assert session.json["idle_s"] == 1800
    assert "HttpOnly; SameSite=Strict" in session.headers["set-cookie"]
    assert rig.access.commands == [("pump-1", "start", b'{"id":"1"}', "alice", "anna")]
    assert answer.json == {"final": True, "phases": [{"phase": "accepted"}, {"phase": "confirmed"}]}
    assert rig.access.logins == [("login", "ok", "anna", "alice", "127.0.0.1")]


async def test_a_command_without_the_sessions_csrf_token_does_nothing() -> None:
    rig = PageRig()
    await rig.log_in()

    for token in ("", "wrong", "Zü"):
        answer = await rig.post("/api/v1/command/pump-1/stop", {}, x_csrf_token=token)
        assert (answer.status, answer.json["error"]) == (403, "csrf")

    assert rig.access.commands == []


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": ""},  # none
        {"sec_fetch_site": "cross-site"},
        {"sec_fetch_site": "same-site"},
    ],
)
async def test_a_post_of_another_site_is_refused_though_it_has_cookie_and_token(
    headers: dict[str, str],
) -> None:
    rig = PageRig()
    await rig.log_in()

    answer = await rig.post("/api/v1/command/pump-1/start", {"id": "1"}, **headers)

    assert (answer.status, answer.json["error"]) == (403, "cross_site")
    assert rig.access.commands == []


async def test_a_form_of_another_site_is_refused() -> None:
    rig = PageRig()
    await rig.log_in()

    answer = await rig.post("/api/v1/command/pump-1/start", {"id": "1"}, content_type="text/plain")

    assert (answer.status, answer.json["error"]) == (415, "no_json")


async def test_a_name_that_is_not_the_pages_own_is_answered_421_whatever_is_asked() -> None:
    rig = PageRig()

    for path in ("/", "/api/v1/state", "/health", "/nothing"):
        answer = await rig.get(path, host="evil.example:8480")
        assert (answer.status, answer.json["error"]) == (421, "host")


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


async def test_wrong_passwords_from_one_address_shut_no_login_for_another() -> None:
    rig = PageRig(WebSettings(users={"anna": USER}, trusted_proxies=("127.0.0.1",)))
    await rig.log_in(x_forwarded_for="192.0.2.1")
    inside, rig.cookie = rig.cookie, ""
    statuses = []
    for _ in range(30):
        rig.clock.s += 1.0
        statuses.append((await rig.log_in("wrong", x_forwarded_for="192.0.2.66")).status)

    elsewhere = await rig.log_in(x_forwarded_for="192.0.2.2")
    there = await rig.log_in(x_forwarded_for="192.0.2.66")
    session = await rig.get("/api/v1/session", cookie=inside)

    assert statuses[0] == 401
    assert statuses[-1] == 429
    assert (elsewhere.status, there.status) == (200, 429)
    assert session.json["user"] == "anna"


async def test_many_logins_at_once_are_checked_one_by_one_and_most_are_sent_away() -> None:
    rig = PageRig()

    answers = await asyncio.gather(
        *(rig.post("/api/v1/login", {"user": f"u{n}", "password": "x"}) for n in range(40))
    )

    assert len(rig.checked) <= 5
    assert {each.status for each in answers} == {401, 429}


async def test_a_session_ends_by_logout_by_time_and_with_its_user() -> None:
    rig = PageRig()
    await rig.log_in()
    assert (await rig.get("/api/v1/session")).json["user"] == "anna"
    await rig.post("/api/v1/logout")
    assert (await rig.get("/api/v1/session")).json["user"] is None

    await rig.log_in()
    rig.clock.s += 1801
    assert (await rig.post("/api/v1/command/pump-1/stop")).status == 401

    await rig.log_in()
    rig.accounts.move(WebSettings(users={"anna": WebUser("anna", "bob", "line-of-anna")}))
    assert (await rig.post("/api/v1/command/pump-1/stop")).status == 401
    assert rig.access.commands == []


async def test_a_body_that_is_too_large_is_refused_and_one_that_is_no_json_too() -> None:
    rig = PageRig()
    await rig.log_in()

    large = await rig.post("/api/v1/command/pump-1/stop", b" " * 4097)
    deep = await rig.post("/api/v1/login", b"[" * 4000)
    broken = await rig.post("/api/v1/login", b"{")

    assert (large.status, large.json["error"]) == (413, "too_big")
    assert {(each.status, each.json["error"]) for each in (deep, broken)} == {(400, "bad_json")}


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


async def test_unknown_starters_and_paths_are_not_found_and_other_methods_not_allowed() -> None:
    rig = PageRig()
    await rig.log_in()

    statuses = [
        (await rig.get("/api/v1/starter/nothing")).status,
        (await rig.get("/api/v1/state?starter=nothing")).status,
        (await rig.get("/api/v1/nothing")).status,
        (await rig.get("/static/../../../etc/passwd")).status,
        (await rig.post("/api/v1/command/nothing/stop")).status,
        (await rig.post("/api/v1/command/pump-1/%23")).status,
        (await rig.post("/api/v1/command/pump-1%2Fstop")).status,
        (await rig.post("/api/v1/command%2fpump-1/stop")).status,
        (await rig.post("/api/v1/command/pump-1%252Fstop")).status,
        (await rig.post("/api/v1/state")).status,
        (await rig.get("/api/v1/command/pump-1/stop")).status,
        (await rig.ask("DELETE", "/api/v1/state")).status,
        (await rig.ask("OPTIONS", "/api/v1/state")).status,
    ]

    assert statuses == [404] * 9 + [405] * 4
    assert rig.access.commands == []


async def test_what_is_not_found_or_not_allowed_is_answered_in_json_too() -> None:
    rig = PageRig()

    unknown = await rig.get("/api/v1/nothing")
    not_allowed = await rig.post("/api/v1/state")

    assert unknown.json["error"] == "not_found"
    assert not_allowed.json["error"] == "method"


async def test_a_request_with_two_lengths_ends_its_connection() -> None:
    rig = PageRig()
    await rig.log_in()

    answer = await rig.post("/api/v1/command/pump-1/stop", content_length="2", transfer_encoding="chunked")

    assert (answer.status, answer.json["error"]) == (400, "two_lengths")
    assert answer.headers["connection"] == "close"
    assert rig.access.commands == []


async def test_every_answer_has_the_strict_headers_and_none_allows_another_origin() -> None:
    rig = PageRig()
    answers = [
        await rig.get("/api/v1/state"),
        await rig.get("/nothing"),
        await rig.get("/", host="evil.example"),
        await rig.post("/api/v1/login", {}, origin="http://evil.example"),
        await rig.log_in(),
    ]

    for answer in answers:
        assert all(name in answer.headers for name in STRICT)
        assert not any(name.startswith("access-control") for name in answer.headers)


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


async def test_a_plain_connection_beside_the_proxy_does_not_see_the_secure_cookie() -> None:
    rig = PageRig()
    await rig.log_in()
    rig.cookie = rig.cookie.replace("sid=", "__Host-sid=")

    assert (await rig.get("/api/v1/session")).json["user"] is None


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


async def test_the_shipped_page_is_there() -> None:
    assert "index.html" in read_files()


async def test_events_as_csv_hold_no_formula() -> None:
    rig = PageRig()
    rig.publish(EventRecord("pump-1", "fault", Severity.ERROR, '=HYPERLINK("x")', 1.0, 1, {}))

    answer = await rig.get("/api/v1/events.csv")

    assert "'=HYPERLINK" in answer.body.decode()
    assert ",=" not in answer.body.decode()
    assert "attachment" in answer.headers["content-disposition"]


async def test_history_sparks_and_facts_of_a_starter() -> None:
    rig = PageRig()
    rig.value("pump-1", "current", 12.0)
    rig.value("pump-1", "line_voltage", 400.0)
    rig.model.publish("starters/mcc1/starter/pump-1/start", b'{"id":"s1"}', is_retained=False)

    history = (await rig.get("/api/v1/starter/pump-1/history")).json
    sparks = (await rig.get("/api/v1/sparks?points=10")).json
    about = (await rig.get("/api/v1/starter/pump-1")).json

    assert history["plots"]["current"][-1] == 12.0
    assert history["plots"]["voltage"][-1] == 400.0
    assert history["plots"]["voltage_point"] == "line_voltage"
    assert (history["starts"], history["trips"]) == ([{"id": "s1"}], [])
    assert sparks["starters"]["pump-1"] == [None] * 9 + [12.0]
    assert sparks["step_s"] == 60.0
    assert about["topics"].keys() == {"starter/pump-1/value/current", "starter/pump-1/value/line_voltage"}


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


def test_the_rigs_own_addresses_agree() -> None:
    assert ORIGIN.endswith(HOST)
