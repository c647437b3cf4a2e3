"""Metrics for Prometheus: what docs/metrics.md promises."""

from __future__ import annotations

import pytest

from tests.rig import RigPlant, command, fault, played, reload, row, scene
from tests.rig.sites import ALICE, FOUR, METRICS, QUICK, SSW07, WEB
from tests.scenarios.plugins.doors import answer, sample, samples

SCRAPED = SSW07 + ALICE + WEB + METRICS
PUMP = {"line": "pumps", "starter": "pump"}
LAST_GOOD = "starter_last_good_reading_timestamp_seconds"
OPEN_S = 1_795_219_200.0  # the scenario's beginning

SERIES = [
    row(
        "who runs here, since when, how fast and fresh a starter answers; every counter begins with 0",
        given=SCRAPED,
        then={
            5.0: [
                sample("build_info", 1.0, gateway="plant", contract="1"),
                sample("start_timestamp_seconds", pytest.approx(OPEN_S, abs=1)),
                sample("clock_synchronised", 1.0),
                sample("loop_lag_seconds_count", loop="gateway"),
                sample("broker_connected", 1.0),
                sample("outbox_messages", 0.0),
                sample("outbox_oldest_timestamp_seconds", None),
                sample("line_open", 1.0, line="pumps"),
                sample("line_stop_latency_worst_seconds", None),
                sample("starter_info", 1.0, **PUMP, family="ssw07", model="SSW-07 85.0A", firmware="1.40"),
                sample("line_stop_latency_bound_seconds", line="pumps"),
                sample("starts_total", 0.0, **PUMP),
                sample("start_drifts_total", 0.0, **PUMP),
                sample("commands_unconfirmed_total", 0.0, **PUMP),
                *(sample("trips_total", 0.0, **PUMP, code=code) for code in ("e05", "e28", "fault")),
                *(
                    sample("starter_polls_total", 0.0, **PUMP, outcome=outcome)
                    for outcome in ("silent", "garbled")
                ),
                sample("starter_polls_total", **PUMP, outcome="answered"),
                sample("broker_reconnects_total", 0.0),
                sample("outbox_dropped_total", 0.0),
                sample("outbox_refused_total", 0.0),
                sample("commands_total", None),
            ],
            90.0: [  # a value that does not change is as fresh as its last reading
                sample(LAST_GOOD, pytest.approx(OPEN_S + 89.5, abs=1), **PUMP),
                sample("starter_response_seconds", pytest.approx(0.01, abs=0.01), **PUMP, quantile="0.5"),
            ],
        },
    ),
    row(
        "a start, a trip and their commands are counted once",
        given=SCRAPED,
        sim={"pump": QUICK},
        at={
            3.0: command("pump/alice/start", id="one"),
            7.0: command("pump/alice/start", id="one"),
            16.0: "pump trip E05",
        },
        then={
            9.0: [
                sample("starter_state", 1.0, **PUMP, state="running"),
                sample("starter_state", 0.0, **PUMP, state="ready"),
                sample("motor_current_amperes", pytest.approx(62, abs=2), **PUMP),
                sample("starter_fault_active", 0.0, **PUMP),
                sample("starter_fault_code", None, **PUMP),
            ],
            40.0: [
                sample("starts_total", 1.0, **PUMP),
                sample("trips_total", 1.0, **PUMP, code="e05"),
                sample("starter_fault_active", 1.0, **PUMP),
                sample("starter_fault_code", 5.0, **PUMP),
                *(
                    sample("commands_total", 1.0, verb="start", phase=phase, code="ok")
                    for phase in ("accepted", "written", "confirmed")
                ),
                sample("command_seconds_count", 1.0, verb="start"),
                sample("command_seconds_sum", pytest.approx(0.5, abs=0.5), verb="start"),
            ],
        },
    ),
    scene(
        "the number of a fault that is over is not that of a fault",
        SCRAPED,
        {5.0: "pump P014 = 5"},
        40.0,
        sample("starter_fault_active", 0.0, **PUMP),
        sample("starter_fault_code", None, **PUMP),
    ),
    row(
        "verbs that clients invent make one series",
        given=SCRAPED,
        at={3.0: [command(f"pump/alice/verb-{number}") for number in range(9)]},
        then={5.0: sample("commands_total", 9.0, verb="other", phase="rejected", code="unknown_verb")},
    ),
    row(
        "a trip whose number the manual does not name is counted from its first on",
        given=SCRAPED,
        at={5.0: ["pump VB01 = 0x8000", "pump P014 = 99"]},
        then={
            4.0: sample("trips_total", None, **PUMP, code="e99"),
            40.0: sample("trips_total", 1.0, **PUMP, code="e99"),
        },
    ),
    row(
        "refused and unconfirmed commands are counted by reason and starter",
        given=SCRAPED,
        at={
            3.0: command("pump/alice/start", fresh=False),
            5.0: fault("silent", "pump"),
            20.0: command("pump/alice/stop"),
        },
        then={
            4.0: [
                sample("commands_rejected_total", 1.0, code="not_fresh"),
                sample("commands_total", 1.0, verb="start", phase="rejected", code="not_fresh"),
            ],
            40.0: sample("commands_unconfirmed_total", 1.0, **PUMP),
        },
    ),
    row(
        "how long stops wait is measured, and whether a starter is locked",
        given=SCRAPED,
        at={
            3.0: command("pump/alice/stop"),
            6.0: command("pump/alice/lock", args={"reason": "belt"}),
            11.0: command("pump/alice/unlock"),
        },
        then={
            5.0: [
                sample("stop_latency_seconds_count", 1.0, line="pumps"),
                sample("line_stop_latency_worst_seconds", pytest.approx(0.02, abs=0.05), line="pumps"),
                sample("line_stop_latency_bound_seconds", line="pumps"),
            ],
            9.0: sample("starter_locked", 1.0, **PUMP),
            13.0: sample("starter_locked", 0.0, **PUMP),
        },
    ),
    row(
        "a silent starter has no values, but says when it was last seen",
        given=SCRAPED,
        at={10.0: fault("silent", "pump")},
        then={
            9.0: sample("starter_online", 1.0, **PUMP),
            40.0: [
                sample("starter_online", 0.0, **PUMP),
                sample("motor_current_amperes", None, **PUMP),
                sample(LAST_GOOD, pytest.approx(OPEN_S + 9.5, abs=1.0), **PUMP),
                sample("starter_last_reply_timestamp_seconds", pytest.approx(OPEN_S + 9.5, abs=1.0), **PUMP),
                sample("starts_total", 0.0, **PUMP),
                sample("starter_state", 1.0, **PUMP, state="unknown"),
                sample("starter_fault_active", None, **PUMP),
            ],
        },
    ),
    scene(
        "a disabled starter has its info and nothing else",
        SSW07 + "enabled = false\n" + WEB + METRICS,
        {},
        5.0,
        sample("starter_info", 1.0, **PUMP),
        sample("starter_online", None),
        sample("starts_total", None),
    ),
    scene(
        "units are base units",
        FOUR + ALICE + WEB + METRICS,
        {3.0: command("mill/alice/start")},
        15.0,
        sample("motor_active_power_watts", pytest.approx(33500, rel=0.1), starter="mill", line="pumps"),
        sample("motor_line_voltage_volts", pytest.approx(400, abs=9), starter="mill"),
        sample("motor_power_factor_ratio", pytest.approx(0.79, abs=0.02), starter="mill"),
        sample("motor_frequency_hertz", 50.0, starter="mill"),
        sample("motor_heatsink_celsius", pytest.approx(25, abs=2), starter="mill"),
        sim={"mill": QUICK},
    ),
    row(
        "other points are there with all_points only, in their own units",
        given=SCRAPED + "all_points = true\n",
        at={10.0: reload(SCRAPED)},
        then={
            5.0: [
                sample("point_value", 0.0, **PUMP, point="apparent_power", unit="kVA"),
                sample("point_value", 1.0, **PUMP, point="remote"),
            ],
            15.0: sample("point_value", None),
        },
    ),
    row(
        "what waits for the broker, and since when, and a line whose port is away",
        given=SCRAPED,
        at={10.0: "broker down", 40.0: "broker up", 85.0: "line pumps unplug"},
        then={
            35.0: [
                sample("broker_connected", 0.0),
                sample("outbox_oldest_timestamp_seconds", pytest.approx(OPEN_S + 10, abs=5)),
                lambda plant: "" if sample("outbox_messages", 0.0)(plant) else "nothing waits",
            ],
            80.0: [
                sample("broker_connected", 1.0),
                sample("broker_reconnects_total", 1.0),
                sample("outbox_oldest_timestamp_seconds", None),
            ],
            100.0: sample("line_open", 0.0, line="pumps"),
        },
    ),
    row(
        "a clock that is not trusted is 0",
        given='[gateway]\nname = "plant"\nstate_dir = "state"\nclock = "auto"\n' + SCRAPED,
        before=lambda plant: setattr(plant, "is_clock_synchronised", False),
        then={5.0: sample("clock_synchronised", 0.0)},
    ),
    row(
        "a reload switches the metrics off and on, and counts go on from 0",
        given=SCRAPED,
        at={3.0: command("pump/alice/stop"), 6.0: reload(SSW07 + ALICE + WEB), 9.0: reload(SCRAPED)},
        then={
            5.0: sample("commands_total", 1.0, verb="stop", phase="confirmed", code="ok"),
            8.0: answer("/metrics", 404),
            12.0: [sample("starter_online", 1.0, **PUMP), sample("commands_total", None)],
        },
    ),
    row(
        "a reload adds a starter's series and takes them away",
        given=SCRAPED,
        at={5.0: reload(FOUR + ALICE + WEB + METRICS), 12.0: reload(SCRAPED)},
        then={
            10.0: [
                sample("starter_online", 1.0, starter="mill"),
                sample("trips_total", 0.0, starter="mill", code="f005"),
            ],
            16.0: [sample("starter_online", None, starter="mill"), sample("starter_online", 1.0, **PUMP)],
        },
    ),
]


test_a_scrape = played(SERIES)


def test_the_text_file_is_replaced_as_a_whole_and_removed_at_an_orderly_end() -> None:
    with RigPlant(SSW07 + METRICS + 'textfile = "starter.prom"\n') as plant:
        plant.run(until=20.0)
        file = plant.folder / "starter.prom"
        early = file.read_text()
        plant.run(until=40.0)
        late = file.read_text()
        assert file.stat().st_mode & 0o777 == 0o644
        others = [path.name for path in plant.folder.iterdir() if "prom" in path.name]
        plant.end()

        assert early != late
        assert sample_of(late, "starter_online") == [1.0]
        assert sample_of(late, "web_streams") == []  # there is no page
        assert others == ["starter.prom"]
        assert not file.exists()


def test_a_text_file_that_cannot_be_written_is_said_and_its_return_too() -> None:
    with RigPlant(SSW07 + METRICS + 'textfile = "gone/starter.prom"\n') as plant:
        plant.run(until=20.0)
        away = plant.events()
        (plant.folder / "gone").mkdir()
        plant.run(until=50.0)

        assert away.count("metrics_away") == 1
        assert plant.events().count("metrics_back") == 1
        assert sample_of((plant.folder / "gone" / "starter.prom").read_text(), "starter_online") == [1.0]


def sample_of(text: str, name: str) -> list[float]:
    return [value for (found, _), value in samples(text).items() if found == name]
