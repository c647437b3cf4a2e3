"""Ten small examples of the five doors, and what the rig itself promises."""

from __future__ import annotations

import pytest

from tests.rig import (
    RigPlant,
    ScenarioRow,
    clean_line,
    command,
    event,
    fault,
    frames,
    msg,
    never,
    play,
    reload,
    result,
    results,
    retained,
    row,
    run_cli,
    seen,
)
from tests.rig.sites import (
    ALICE,
    FOUR,
    HOME_ASSISTANT,
    LOGIN,
    METRICS,
    PASSWORD,
    QUICK,
    SPARKPLUG,
    SSW07,
    WEB,
    operator,
    starter,
)


def _acknowledge(plant: RigPlant) -> None:
    plant.broker.ack_after_s = 0.0


READY, RUNNING, TRIPPED = "VB01 = 0x4102", "VB01 = 0x5123", "VB01 = 0x8000"

SCENARIOS = [
    row(
        "the values of an SSW-07 are published with unit and quality",
        given=SSW07,
        then={
            3.0: [
                msg("starter/pump/value/current", value=0.0, unit="A", quality="good", qos=1, retain=True),
                msg("starter/pump/availability", state="online"),
                clean_line,
            ]
        },
    ),
    row(
        "the state follows the words of the status register",
        given=SSW07,
        at={2.0: f"unit 1 {READY}", 4.0: f"pump {RUNNING}", 6.0: [f"pump {TRIPPED}", "pump P014 = 5"]},
        then={
            3.9: msg("starter/pump/state", state="ready", remote=True),
            5.9: msg("starter/pump/state", state="running", bypass_closed=True),
            8.5: msg("starter/pump/state", state="fault", fault=True),
            8.6: msg("starter/pump/alarm/e05", active=True, severity="fault"),
        },
    ),
    row(
        "a start with a token is written once and confirmed",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={3.0: command("pump/alice/start")},
        then={
            6.0: [
                results("start accepted ok", "start written ok", "start confirmed ok"),
                frames("pump", "05 00 64 ff 00"),
                msg("starter/pump/state", state="running"),
            ]
        },
    ),
    row(
        "a stop is written again and again until the motor stands",
        given=SSW07 + ALICE,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start"),
            6.0: [f"pump {RUNNING}", command("pump/alice/stop")],
            7.2: "pump VB01 = -",
        },
        then={
            7.1: [result("stop written ok"), frames("pump", *3 * ["05 00 64 00 00"], since=6.0)],
            8.0: [result("stop confirmed ok"), frames("pump", *3 * ["05 00 64 00 00"], since=6.0)],
        },
    ),
    row(
        "when the broker comes back everything retained is published again, then that the gateway is online",
        given=SSW07,
        at={5.0: "broker down", 20.0: "broker up"},
        then={
            19.0: never("starter/pump/value/current", since=5.1),
            60.0: [
                event("broker_away"),
                seen("starter/pump/value/current", since=20.0),
                msg("gateway/status", state="online"),
            ],
        },
    ),
    row(
        "a reload adds a starter and leaves the others alone",
        given=SSW07,
        at={5.0: reload(SSW07 + starter("fan", 2, "ssw06"))},
        then={
            8.0: [
                event("reloaded"),
                msg("starter/fan/availability", state="online"),
                never("starter/pump/availability", since=5.0),
            ]
        },
    ),
    row(
        "a reload with a mistake is refused and changes nothing",
        given=SSW07,
        at={5.0: reload(SSW07 + "wrong = 1\n")},
        then={8.0: [event("reload_refused"), msg("starter/pump/availability", state="online")]},
    ),
    row(
        "a lost starter is offline, its values stale; it comes back",
        given=SSW07,
        at={5.0: fault("silent", "pump", for_s=30.0)},
        then={
            20.0: [
                msg("starter/pump/availability", state="offline"),
                msg("starter/pump/value/current", quality="stale"),
            ],
            60.0: msg("starter/pump/availability", state="online"),
        },
    ),
    row(
        "a client without the right is refused",
        given=SSW07 + ALICE + operator("bob", may=("stop",)),
        at={3.0: command("pump/bob/start")},
        then={4.0: [result("start rejected not_allowed", client="bob"), frames("pump")]},
    ),
    row(
        "each starter is announced to Home Assistant",
        given=SSW07 + HOME_ASSISTANT,
        then={20.0: retained("homeassistant/device/+/config", device=...)},
    ),
]


BROKER = [  # what Mosquitto does, as the gateway sees it
    row(
        "without acknowledgements the connection is given up and everything sent again",
        given=SSW07,
        before=lambda plant: setattr(plant.broker, "ack_after_s", None),
        at={25.0: _acknowledge},
        then={60.0: [event("broker_away"), seen("starter/pump/value/current", since=30.0)]},
    ),
    row(
        "late acknowledgements hold nothing up for long",
        given=SSW07,
        at={1.0: lambda plant: setattr(plant.broker, "ack_after_s", 0.5)},
        then={
            10.0: [
                msg("starter/pump/availability", state="online"),
                never("gateway/event", code="broker_away"),
            ]
        },
    ),
    row(
        "a broker that stands still is noticed by its silence",
        given=SSW07,
        at={5.0: "broker stalls", 60.0: "broker goes"},
        then={
            59.0: never("gateway/fresh", since=5.1),
            90.0: [event("broker_away"), seen("gateway/fresh", since=61.0)],
        },
    ),
    row(
        "an older broker is spoken to in MQTT 3.1.1",
        given=SSW07,
        before=lambda plant: setattr(plant.broker, "speaks_5", False),
        then={5.0: [event("mqtt_3_1_1"), msg("gateway/info", mqtt_version="3.1.1")]},
    ),
    row(
        "a message that the broker refuses is reported",
        given=SSW07,
        before=lambda plant: plant.broker.deny("*", "starters/plant/starter/pump/state", "write"),
        then={5.0: [event("publish_refused"), never("starter/pump/state")]},
    ),
    row(
        "without the right to read commands the gateway says that it is deaf to them",
        given=SSW07 + ALICE,
        before=lambda plant: plant.broker.deny("*", "starters/plant/command/#", "read"),
        at={3.0: command("pump/alice/stop")},
        then={5.0: [results(), msg("gateway/status", state="degraded")]},
    ),
    row(
        "another client with the gateway's id is named",
        given=SSW07,
        at={5.0: lambda plant: plant.broker.drop(code=0x8E)},
        then={8.0: event("client_id_taken")},
    ),
    row(
        "a dropped connection leaves the will",
        given=SSW07,
        at={5.0: "broker drops"},
        then={
            5.0: retained("gateway/status", state="offline"),
            9.0: retained("gateway/status", state="online"),
        },
    ),
    row(
        "what was retained before the gateway came is no command",
        given=SSW07 + ALICE,
        before=lambda plant: plant.publish("command/pump/alice/stop", client="alice", retain=True),
        then={5.0: [results(), frames("pump")]},
    ),
]


@pytest.mark.parametrize("row", SCENARIOS + BROKER)
def test_a_scenario(row: ScenarioRow) -> None:
    play(row)


def test_a_start_from_the_page_needs_a_login_and_shows_its_phases() -> None:
    with RigPlant(SSW07 + ALICE + WEB + LOGIN, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        token = plant.get("/api/v1/state").json["token"]
        start = {"id": "1", "token": token}

        refused = plant.post("/api/v1/command/pump/start", start)
        plant.browser.log_in("anna", PASSWORD)
        answer = plant.post("/api/v1/command/pump/start", start)

        assert refused.status == 401
        assert [phase["phase"] for phase in answer.json["phases"]] == ["accepted", "written", "confirmed"]
        assert plant.starter("pump").writes == [(pytest.approx(5.0, abs=0.5), "05 00 64 ff 00")]


def test_a_stream_of_the_page_shows_what_changes() -> None:
    with RigPlant(SSW07 + WEB) as plant:
        plant.run(until=5.0)
        stream = plant.browser.stream("/api/v1/events")
        plant.run(until=6.0)
        plant.do(lambda: plant.lines["pumps"].set_knob("pump", "trip", "E05"))
        plant.run(until=9.0)

        assert stream.events[0][0] == "snapshot"
        assert any("starter/pump/alarm/e05" in data.get("topics", {}) for _, data in stream.events)


def test_prometheus_scrapes_the_gateway() -> None:
    with RigPlant(SSW07 + WEB + METRICS) as plant:
        plant.run(until=5.0)

        assert "starter_gateway_starter_online{" in plant.get("/metrics").text
        assert plant.get("/health").status == 200


def test_sparkplug_publishes_births_and_takes_a_hosts_stop() -> None:
    node = SPARKPLUG + 'commands = true\noperator = "alice"\n'
    with RigPlant(SSW07 + ALICE + node) as plant:
        plant.run(until=5.0)
        births = plant.messages("spBv1.0/#")
        data = plant.messages("spBv1.0/plant/DDATA/plant/pump")
        plant.publish("spBv1.0/plant/DCMD/plant/pump", plant.sparkplug({"Command/Stop": True}))
        plant.run(until=7.0)

        assert [each.topic for each in births[:2]] == [
            "spBv1.0/plant/NBIRTH/plant",
            "spBv1.0/plant/DBIRTH/plant/pump",
        ]
        assert any(each.json["metrics"].get("current") == 0.0 for each in data)
        assert plant.results() == ["stop accepted ok", "stop written ok", "stop confirmed ok"]


def test_a_wrong_configuration_ends_check_with_78() -> None:
    with RigPlant(SSW07) as plant:
        plant.write(SSW07.replace("ssw07", "ssw99"))

        ran = plant.cli("check", "CONFIG")

    assert ran.code == 78
    assert "ssw99" in ran.err


def test_a_command_line_sends_to_the_running_gateway() -> None:
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)

        ran = plant.cli("send", "CONFIG", "pump", "start", "--client", "alice")

        assert (ran.code, plant.results()) == (
            0,
            ["start accepted ok", "start written ok", "start confirmed ok"],
        )


def test_a_scan_of_the_line_finds_its_starters() -> None:
    with RigPlant(FOUR) as plant:
        plant.end()

        ran = plant.cli("scan", "/dev/pumps", "--baud", "19200", "--framing", "8N2", "--address", "1-5")

    assert ran.code == 0
    assert [word in ran.out for word in ("ssw07", "ssw06", "ssw900", "sst")] == [True] * 4


def test_a_restart_continues_with_the_same_state_and_broker() -> None:
    with RigPlant(SSW07 + ALICE, sim={"pump": QUICK}) as plant:
        plant.run(until=5.0)
        plant.command("pump/alice/start", id="one")
        plant.run(until=8.0)
        plant.restart()
        plant.run(until=12.0)
        plant.command("pump/alice/start", id="one")
        plant.run(until=13.0)

        assert plant.messages("result/pump/alice")[-1].json["duplicate"] is True
        assert len(plant.starter("pump").writes) == 1


def test_a_killed_gateway_leaves_its_will() -> None:
    with RigPlant(SSW07) as plant:
        plant.run(until=5.0)
        plant.kill()

        assert plant.broker.retained[plant.topic("gateway/status")].json["state"] == "offline"


def test_the_same_scenario_gives_the_same_bytes() -> None:
    def day() -> str:
        with RigPlant(FOUR + ALICE + SPARKPLUG + HOME_ASSISTANT + WEB) as plant:
            plant.run(until=5.0)
            plant.command("pump/alice/start")
            plant.run(until=8.0)
            plant.broker.drop()
            plant.lines["pumps"].garble("fan", for_s=2.0)
            plant.run(until=30.0)
            plant.restart()
            plant.run(until=40.0)
            plant.end()
            return plant.transcript()

    assert day() == day()


def test_the_command_line_needs_no_plant() -> None:
    ran = run_cli("decode", "ssw07", "holding", "3", "8150")

    assert '"value": 815.0' in ran.out
