"""A plant of simulated starters on a pty, a real Mosquitto, and the gateway as the service it will be."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.end_to_end.plant import STARTERS, plant
from tests.end_to_end.site import Program, Scada, site_config, write_config
from tests.mosquitto import StartMosquitto


@pytest.mark.long
async def test_every_family_starts_runs_and_stops_by_topics_alone(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        for starter in STARTERS:
            await scada.command(starter, "start", f"start-{starter}")
        for starter in STARTERS:
            await scada.until(f"starter/{starter}/state", state="starting")
        for starter in STARTERS:
            await scada.until(f"starter/{starter}/state", state="running", quality="good")
        running = {starter: scada.phases(f"start-{starter}") for starter in STARTERS}
        for starter in STARTERS:
            await scada.publish(f"command/{starter}/alice/stop", "")
        for starter in STARTERS:
            await scada.result(starter, verb="stop", phase="confirmed")
            await scada.until(f"starter/{starter}/state", state="ready", quality="good")

    assert running == {starter: ["accepted", "written", "confirmed"] for starter in STARTERS}
    assert [event["code"] for event in scada.events].count("started") == len(STARTERS)


async def test_a_retained_start_does_nothing_but_say_so(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        await scada.command("pump", "start", "retained", "-r")
        refused = await scada.result("pump", id="retained", phase="rejected")
        await scada.command("pump", "read", "after", parameter="P003")
        await scada.result("pump", id="after", phase="confirmed")

    assert refused["code"] == "retained"
    assert scada.latest["starter/pump/state"]["state"] == "ready"
    assert not any(event["code"] == "started" for event in scada.events)


async def test_a_repeated_id_gets_the_stored_result_and_no_second_start(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        await scada.command("pump", "start", "once")
        await scada.result("pump", id="once", phase="confirmed", duplicate=False)
        await scada.publish("command/pump/alice/stop", "")
        await scada.until("starter/pump/state", state="ready")
        await scada.command("pump", "start", "once")
        repeated = await scada.result("pump", id="once", duplicate=True)

    assert repeated["phase"] == "confirmed"
    assert scada.phases("once").count("written") == 1
    assert [event["code"] for event in scada.events].count("started") == 1


async def test_a_parameter_is_set_read_back_and_out_of_range_refused(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        await scada.command("pump", "set", "good", parameter="P314", value=30)
        done = await scada.result("pump", id="good", phase="confirmed")
        await scada.command("belt", "set", "guarded", parameter="R33", value=4.0)
        guarded = await scada.result("belt", id="guarded", phase="confirmed")
        await scada.command("pump", "set", "bad", parameter="P314", value=1000)
        refused = await scada.result("pump", id="bad", phase="rejected")

    assert (done["value"], done["unit"]) == (30.0, "s")
    assert guarded["value"] == 4.0
    assert refused["code"] == "out_of_range"


async def test_events_and_results_of_a_broker_outage_come_afterwards_in_order(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    async with plant(broker, tmp_path) as (scada, gateway, _):
        await scada.command("pump", "start", "long")
        await scada.result("pump", id="long", phase="confirmed")
        broker.kill()
        await gateway.says("connection lost")
        broker.start()
        async with broker.watch("starters/plant/#") as watcher:
            again = Scada(broker, watcher)
            await again.until("gateway/status", state="online")
            await again.until("starter/pump/state", state="running", quality="good")
            sequence = [event["seq"] for event in again.events]

    assert [event["code"] for event in again.events][:1] == ["broker_away"]
    assert sequence == sorted(sequence)


async def test_a_lost_port_makes_everything_stale_and_comes_back(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    broker = start_mosquitto()
    config = write_config(tmp_path, site_config(broker_port=broker.port, port=str(tmp_path / "ttyHALL")))
    async with broker.watch("starters/plant/#") as watcher, Program("gateway", "run", str(config)) as gateway:
        scada = Scada(broker, watcher)
        await scada.until("gateway/status", state="degraded")
        await gateway.says("no such")
        async with Program("gateway", "simulate", str(config)):
            await scada.until("gateway/status", state="online")
            await scada.until("starter/fan/value/running", quality="good")
            online = await scada.until("starter/fan/availability", state="online")
        await scada.until("starter/fan/availability", state="offline")
        lost = await scada.until("starter/fan/value/running", quality="stale")
        async with Program("gateway", "simulate", str(config)):
            await scada.until("starter/fan/value/running", quality="good")

    assert online["reason"] is None
    assert lost["value"] is False


async def test_sigterm_says_offline_with_the_reason_and_ends_with_success(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, gateway, _):
        gateway.signal(signal.SIGTERM)
        code = await gateway.exit_code(within_s=10.0)
        status = await scada.until("gateway/status", state="offline")

    assert code == 0
    assert status["reason"] == "ended by SIGTERM"


async def test_a_bad_new_configuration_is_refused_and_a_good_one_taken_over(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, gateway, config):
        good = config.read_text("utf-8")
        config.write_text(good.replace("baud = 19200", "baud = 7"), "utf-8")
        gateway.signal(signal.SIGHUP)
        event = await scada.until("gateway/event", code="reload_refused")
        before = await scada.boot()
        config.write_text(good.replace('name = "fan"', 'name = "blower"'), "utf-8")
        gateway.signal(signal.SIGHUP)
        await scada.until("starter/blower/state", state="ready", quality="good")
        after = await scada.boot()

    assert "baud" in event["text"]
    assert before == after


async def test_no_client_without_a_right_and_nothing_malformed_gets_through(
    start_mosquitto: StartMosquitto, tmp_path: Path
) -> None:
    async with plant(start_mosquitto(), tmp_path) as (scada, _, _):
        boot = await scada.boot()
        await scada.publish(
            "command/pump/mallory/start", json.dumps({"id": "m", "token": await scada.token()})
        )
        refused = await scada.until("result/pump/mallory", phase="rejected")
        wanted = {
            "not json": "bad_json",
            json.dumps({"id": "a", "boot": "another"}): "wrong_boot",
            json.dumps({"id": "b"}): "not_fresh",
            json.dumps({"id": "c", "boot": boot, "now": True}): "bad_payload",
            "x" * 5000: "too_big",
        }
        codes = {}
        for payload in wanted:
            scada.latest.pop("result/pump/alice", None)
            await scada.publish("command/pump/alice/start", payload)
            codes[payload] = (await scada.result("pump", phase="rejected"))["code"]

    assert refused["code"] == "not_allowed"
    assert codes == wanted
