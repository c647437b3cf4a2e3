"""From readings to the record of a start."""

from __future__ import annotations

from typing import Any

import pytest

from gateway.contract import Cause
from gateway.plugins.history.start_recorder import LONGEST_S
from gateway.starters import Readings, Value
from tests.history.support import UTC_S, AnalyticStart, ReadMotor, recorder, records, sole

WITHIN = 0.03


def one_reply(at_s: float, state: str, **values: Value) -> Readings:
    flags: dict[str, Value] = {
        "running": state in ("starting", "running"),
        "accelerating": state == "starting",
    }
    return Readings(at_s, UTC_S + at_s, state, flags | values)


@pytest.mark.parametrize("fast_s", [0.1, 0.25, 0.4])
@pytest.mark.parametrize("ramp_s", [6.0, 8.0, 20.0])
def test_a_start_of_ours_agrees_with_the_analytic_curve_within_three_percent(
    fast_s: float, ramp_s: float
) -> None:
    for seed in range(40):
        start = AnalyticStart(begin_s=20.0 + 0.137 * seed, ramp_s=ramp_s)
        motor = ReadMotor(start, fast_s=fast_s, seed=seed, noise=0.004, is_ours=True)

        summary = sole(records(motor))

        assert summary.outcome == "full_voltage"
        assert summary.acceleration_s is not None
        assert summary.resolution_s is not None
        assert abs(summary.acceleration_s - ramp_s) <= summary.resolution_s
        if fast_s == 0.4 and ramp_s < 20.0:
            continue  # the replies lie too far apart for that
        assert summary.acceleration_s == pytest.approx(ramp_s, rel=WITHIN)
        assert summary.peak_a == pytest.approx(start.peak_a, rel=WITHIN)
        assert summary.mean_a == pytest.approx(start.mean_a(), rel=WITHIN)
        assert summary.i2t_a2s == pytest.approx(start.i2t_a2s(), rel=WITHIN)
        assert summary.rate_hz == pytest.approx(1 / fast_s, rel=0.1)


def test_a_start_that_the_starter_has_refused_is_not_ours() -> None:
    one = recorder()
    one.note_command("alice", "c1", 20.28)
    one.note_command("bob", "c2", 20.29)
    one.forget_command("bob", "c2")

    summary = sole(records(ReadMotor(AnalyticStart(begin_s=20.3)), one=one))

    assert summary.cause == Cause("command", "alice", "c1")


START, NEAR_350 = AnalyticStart(begin_s=20.3), pytest.approx(350.0)
WHOLE = {
    "peak_a": NEAR_350,
    "i2t_a2s": pytest.approx(START.i2t_a2s(), rel=WITHIN),
    "mean_a": pytest.approx(START.mean_a(), rel=WITHIN),
}
CUT = {"acceleration_s": None, "peak_a": NEAR_350, "i2t_a2s": pytest.approx(350.0**2 * 3.4, rel=0.15)}
GAP = {"acceleration_s": pytest.approx(8.0, rel=WITHIN), "i2t_a2s": None, "peak_a": NEAR_350}
UNSEEN = {"acceleration_s": None, "standstill_s": None, "i2t_a2s": None}
TRIPS = {"cut_s": 24.0, "cut_state": "fault", "is_ours": False}


def motor(**options: Any) -> ReadMotor:
    return ReadMotor(**{"start": START, "is_ours": True, **options})


FED = sum("current" in each.values and 20.3 <= each.at_s < 24.0 for each in motor(**TRIPS).replies(0.0, 60.0))


@pytest.mark.parametrize(
    ("options", "wrong", "found"),
    [  # of a motor, the currents that are read wrongly, and what its record has
        ({}, {}, {"outcome": "full_voltage", **WHOLE}),
        *(
            ({}, wrong, {"outliers": len(wrong), **WHOLE})  # what cannot be is counted and enters nothing
            for wrong in ({12: 6553.5}, {12: 6553.5, 13: 6553.5}, {0: 6553.5}, {10: 3500.0, 40: 900.0})
        ),
        ({"fast_s": 0.1}, {0: 900.0}, {"outliers": 0, "peak_a": 900.0}),  # a kick start
        (TRIPS, {FED - 1: 980.0}, {"outliers": 0, "peak_a": 980.0}),  # this current trips the starter
        *(({"cut_s": 24.0, "cut_state": state}, {}, CUT) for state in ("fault", "stopping")),
        ({"lost": (22.0, 26.0)}, {}, {"outcome": "full_voltage", **GAP}),
        ({"start": AnalyticStart(-2.0), "is_ours": False}, {}, {"outcome": "full_voltage", **UNSEEN}),
    ],
)
def test_a_record_has_what_can_be_computed_of_what_was_read(
    options: dict[str, Any], wrong: dict[int, float], found: dict[str, Any]
) -> None:
    summary = sole(records(motor(**options), wrong=wrong))

    assert {name: getattr(summary, name) for name in found} == found
    assert max(filter(None, summary.samples["current"])) == summary.peak_a


def test_the_time_before_a_start_that_was_announced_is_no_acceleration() -> None:
    """SSW900: initial test and time before start (C5.7.1) are `starting` too."""
    replies = [one_reply(0.0, "ready"), one_reply(1.0, "starting", accelerating=False)]
    replies += [one_reply(2.0 + 0.25 * n, "starting", accelerating=False) for n in range(12)]
    replies += [one_reply(5.0 + 0.25 * n, "starting") for n in range(20)]
    replies += [one_reply(10.0 + 0.25 * n, "running") for n in range(24)]

    summary = sole([each for each in map(recorder().take, replies) if each is not None])

    assert summary.acceleration_s == pytest.approx(5.0)
    assert summary.time_s == pytest.approx(UTC_S + 4.875)


def test_a_long_start_at_a_high_rate_stays_small_and_true() -> None:
    start = AnalyticStart(begin_s=5.0, ramp_s=200.0)
    motor = ReadMotor(start, fast_s=0.02, is_ours=True)

    summary = sole(records(motor, until_s=260.0))

    assert len(summary.samples["t_s"]) <= 300
    assert summary.i2t_a2s == pytest.approx(start.i2t_a2s(), rel=WITHIN)
    assert summary.peak_a == max(value for value in summary.samples["current"] if value is not None)


def test_the_heating_is_the_rise_of_the_thermal_level_and_the_lowest_voltage_that_of_the_ramp() -> None:
    replies = [
        one_reply(0.0, "ready", p050=12, line_voltage=300.0),
        one_reply(0.5, "starting", p050=12, line_voltage=392.0),
        one_reply(1.0, "starting", line_voltage=371.0),
        one_reply(5.0, "running", line_voltage=399.0),
        one_reply(7.0, "running", p050=31, line_voltage=200.0),
        one_reply(11.0, "running"),
    ]

    summary = sole([each for each in map(recorder().take, replies) if each is not None])

    assert (summary.heating_pct, summary.lowest_v) == (19.0, 371.0)
    assert summary.samples["thermal"][-1] == 31.0


@pytest.mark.parametrize("fast_s", [0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("ramp_s", [2.0, 4.0, 8.0])
def test_the_i2t_is_as_exact_as_the_record_says(fast_s: float, ramp_s: float) -> None:
    errors = []
    for seed in range(60):
        start = AnalyticStart(begin_s=20.0 + 0.137 * seed, ramp_s=ramp_s)
        motor = ReadMotor(start, fast_s=fast_s, seed=seed, is_ours=seed % 2 == 0)

        summary = sole(records(motor))

        if summary.i2t_a2s is None:
            assert fast_s >= ramp_s / 5, "too few samples"
            continue
        assert summary.i2t_error_pct is not None
        assert 100 * abs(summary.i2t_a2s / start.i2t_a2s() - 1) <= summary.i2t_error_pct
        if motor.is_ours:
            errors.append(summary.i2t_error_pct)
    if fast_s <= 0.25 and ramp_s == 8.0:
        assert max(errors) <= 6.0, "it is a bound, not a guess that excludes every start"
    if fast_s == 1.0:
        assert min(errors, default=99.0) > 10.0 or ramp_s == 8.0


def test_the_rate_is_that_of_the_samples_that_are_there() -> None:
    start = AnalyticStart(begin_s=20.0, ramp_s=4.0)
    replies = [one_reply(0.0, "ready"), one_reply(19.999, "ready"), one_reply(20.001, "starting")]
    current = [Readings(at_s, UTC_S + at_s, "starting", {"current": 300.0}) for at_s in (20.5, 22.0, 23.0)]
    end = [one_reply(23.999, "starting"), one_reply(24.001, "running"), one_reply(29.5, "running")]

    for number, expected in ((3, 0.75), (1, 0.25), (0, None)):
        taken = map(recorder().take, [*replies, *current[:number], *end])
        summary = sole([each for each in taken if each is not None])
        assert summary.acceleration_s == pytest.approx(start.ramp_s)
        assert summary.rate_hz == (None if expected is None else pytest.approx(expected, rel=0.01))


@pytest.mark.parametrize(
    ("replies", "outcomes"),
    [
        ("running*20", []),  # a motor that is found on was not seen to start
        ("ready lost running*10", ["full_voltage"]),  # it has started unseen
        ("running*3 lost starting*3 running*8", ["full_voltage"]),  # it was started anew
        ("ready starting lost lost starting lost starting*9", ["given_up"]),  # one start, lost twice
        (f"ready starting*{int(3 * LONGEST_S)}", ["given_up"]),
        ("ready starting*3 ready*9", ["stopped"]),
        ("ready starting*3 fault*9", ["tripped"]),
        ("ready starting*3 starting:accelerating=0 starting*3 running*9", ["full_voltage"]),  # one start
        ("ready starting*3 starting:bypass_closed=1*9", ["full_voltage"]),
        ("ready running:jog=1*9 running:braking=1*9 running:reversing=1*9 ready", []),
        ("ready running:running=0*2 running*9", ["full_voltage"]),
        ("ready starting*5 running*2 lost", ["full_voltage"]),  # lost after full voltage
        ("ready starting*5 lost", ["given_up"]),
    ],
)
def test_what_is_a_start_and_how_it_ended(replies: str, outcomes: list[str]) -> None:
    one, found, at_s = recorder(), [], 0.0
    for said in replies.split():
        shown, _, times = said.partition("*")
        state, _, flag = shown.partition(":")
        name, _, value = flag.partition("=")
        for _ in range(int(times or 1)):
            at_s += 1.0
            flags = {name: value == "1"} if name else {}
            found.append(one.lose() if state == "lost" else one.take(one_reply(at_s, state, **flags)))

    assert [each.outcome for each in found if each is not None] == outcomes


@pytest.mark.parametrize(("remote", "source"), [(True, "remote"), (False, "local"), (None, "unknown")])
def test_another_start_is_local_or_remote_as_the_starter_shows(remote: bool | None, source: str) -> None:
    one = recorder()
    flags: dict[str, Value] = {} if remote is None else {"remote": remote}
    for at_s, state in ((0.0, "running"), (10.0, "stopping"), (12.0, "ready"), (14.0, "ready")):
        one.lose()  # meanwhile it may have been started: it stands still since it was seen again
        one.take(one_reply(at_s, state, **flags))
    one.take(one_reply(101.0, "starting", **flags))
    one.take(one_reply(50.0, "running", **flags))  # out of order

    lost = one.lose()

    assert lost is not None
    assert lost.cause.source == source
    assert lost.standstill_s == pytest.approx(87.0)
    assert (lost.acceleration_s, lost.peak_a, lost.samples["t_s"]) == (None, None, ())
