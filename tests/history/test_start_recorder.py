"""From readings to the record of a start."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from gateway.history.readings import Readings, Value
from gateway.history.start_record import Cause, StartOutcome, StartSource
from gateway.history.start_recorder import (
    LONGEST_S,
    FinishedStart,
    StartCommand,
    StartPoints,
    StartRecorder,
)
from tests.history.support import POINTS, RATED_A, UTC_S, AnalyticStart, ReadMotor, recorder, records, sole

WITHIN = 0.03


def written(at_s: float, client: str = "alice", id_: str | None = "c1"):
    """Return what notes a command of ours as soon as the time has come."""
    noted: list[float] = []

    def note(one: StartRecorder, now_s: float) -> None:
        if now_s >= at_s and not noted:
            noted.append(now_s)
            one.note_command(StartCommand(client, id_, at_s))

    return note


def one_reply(at_s: float, state: str, **values: Value) -> Readings:
    flags: dict[str, Value] = {
        "running": state in ("starting", "running"),
        "accelerating": state == "starting",
    }
    return Readings(at_s, UTC_S + at_s, state, flags | values)


def feed(one: StartRecorder, *replies: Readings) -> list[StartOutcome]:
    found = [one.take(reply) for reply in replies]
    return [each.summary.outcome for each in found if each is not None]


@pytest.mark.parametrize("fast_s", [0.1, 0.25, 0.4])
@pytest.mark.parametrize("ramp_s", [6.0, 8.0, 20.0])
def test_a_start_of_ours_agrees_with_the_analytic_curve_within_three_percent(
    fast_s: float, ramp_s: float
) -> None:
    for seed in range(40):
        start = AnalyticStart(begin_s=20.0 + 0.137 * seed, ramp_s=ramp_s)
        motor = ReadMotor(start, fast_s=fast_s, seed=seed, noise=0.004, is_ours=True)

        summary, _ = sole(records(motor, before=written(start.begin_s)))

        assert summary.outcome is StartOutcome.FULL_VOLTAGE
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


def test_of_a_start_given_elsewhere_the_acceleration_time_is_as_exact_as_the_record_says() -> None:
    for seed in range(100):
        start = AnalyticStart(begin_s=20.0 + 0.0371 * seed, ramp_s=10.0)

        summary, _ = sole(records(ReadMotor(start, seed=seed)))

        assert summary.acceleration_s is not None
        assert summary.resolution_s is not None
        assert abs(summary.acceleration_s - 10.0) <= summary.resolution_s <= 0.8
        assert summary.cause == Cause(StartSource.REMOTE)


def test_samples_begin_a_second_before_the_start_and_end_five_seconds_after_full_voltage() -> None:
    start = AnalyticStart(begin_s=20.3)

    summary, curve = sole(records(ReadMotor(start, idle_s=0.2), before=written(start.begin_s)))

    assert summary.time_s == pytest.approx(UTC_S + start.begin_s, abs=0.15)
    assert -1.0 <= curve.t_s[0] <= -0.4
    assert start.ramp_s + 4.7 <= curve.t_s[-1] <= start.ramp_s + 5.5
    assert set(curve.columns) == {"current"}
    zero_s = summary.time_s - UTC_S
    for t_s, value in zip(curve.t_s, curve.columns["current"], strict=True):
        assert value == pytest.approx(start.current_a(zero_s + t_s), abs=0.6)  # each at its own time


def test_the_cause_is_ours_only_when_a_command_of_ours_fits() -> None:
    start = AnalyticStart(begin_s=20.3)

    ours, _ = sole(records(ReadMotor(start), before=written(20.28)))
    long_ago, _ = sole(records(ReadMotor(start), before=written(5.0)))

    assert ours.cause == Cause(StartSource.COMMAND, "alice", "c1")
    assert long_ago.cause == Cause(StartSource.REMOTE)


def test_a_start_that_the_starter_has_refused_is_not_ours() -> None:
    one = recorder()
    one.note_command(StartCommand("alice", "c1", 20.28))
    one.note_command(StartCommand("bob", "c2", 20.29))
    one.forget_command("bob", "c2")

    summary, _ = sole(records(ReadMotor(AnalyticStart(begin_s=20.3)), one=one))

    assert summary.cause == Cause(StartSource.COMMAND, "alice", "c1")


@pytest.mark.parametrize(("remote", "source"), [(True, "remote"), (False, "local"), (None, "unknown")])
def test_another_start_is_local_or_remote_as_the_starter_shows(remote: bool | None, source: str) -> None:
    one = recorder()
    flags: dict[str, Value] = {} if remote is None else {"remote": remote}
    feed(one, one_reply(0.0, "ready", **flags), one_reply(1.0, "starting", **flags))

    lost = one.lose()

    assert lost is not None
    assert lost.summary.cause.source == source


@pytest.mark.parametrize(
    ("state", "outcome"),
    [("fault", StartOutcome.TRIPPED), ("stopping", StartOutcome.STOPPED), ("ready", StartOutcome.STOPPED)],
)
def test_a_start_that_is_cut_has_its_peak_and_heat_but_no_acceleration_time(
    state: str, outcome: StartOutcome
) -> None:
    start = AnalyticStart(begin_s=20.3)
    motor = ReadMotor(start, cut_s=24.0, cut_state=state, is_ours=True)

    summary, _ = sole(records(motor, before=written(20.28)))

    assert (summary.outcome, summary.acceleration_s) == (outcome, None)
    assert summary.peak_a == pytest.approx(350.0)
    assert summary.i2t_a2s == pytest.approx(350.0**2 * 3.4, rel=0.15)


def test_a_starter_that_is_lost_while_it_starts_ends_the_record_with_what_is_known() -> None:
    start = AnalyticStart(begin_s=20.3)
    one = recorder()
    before = records(ReadMotor(start), until_s=24.0, one=one)

    lost = one.lose()
    later = [one.take(reply) for reply in ReadMotor(start).replies(40.0, 60.0)]

    assert before == []
    assert lost is not None
    assert (lost.summary.outcome, lost.summary.acceleration_s) == (StartOutcome.GIVEN_UP, None)
    assert lost.summary.peak_a == pytest.approx(350.0)
    assert lost.summary.i2t_a2s is None
    assert later == [None] * len(later), "it is the same start, not another one"
    assert one._start is None


def test_a_starter_that_is_lost_after_full_voltage_has_started() -> None:
    one = recorder()
    records(ReadMotor(AnalyticStart(begin_s=20.3)), until_s=30.0, one=one)

    lost = one.lose()

    assert lost is not None
    assert lost.summary.outcome is StartOutcome.FULL_VOLTAGE
    assert lost.summary.acceleration_s == pytest.approx(8.0, abs=0.7)


def test_a_gap_in_the_samples_leaves_out_what_cannot_be_computed() -> None:
    motor = ReadMotor(AnalyticStart(begin_s=20.3), lost=(22.0, 26.0), is_ours=True)

    summary, _ = sole(records(motor, before=written(20.28)))

    assert summary.outcome is StartOutcome.FULL_VOLTAGE
    assert summary.acceleration_s == pytest.approx(8.0, rel=WITHIN)
    assert summary.i2t_a2s is None
    assert summary.peak_a is not None


def test_what_the_state_never_showed_is_found_by_the_current() -> None:
    """A start between two replies of the status, at 2.5 times the rated current [SEL-749M]."""
    start = AnalyticStart(begin_s=20.0, ramp_s=2.0, peak_a=450.0)
    one = recorder()
    found = []
    for number in range(400):
        at_s = number * 0.1
        if number % 30 == 0:
            state = "ready" if at_s < 20.0 else "running"
            found.append(one.take(one_reply(at_s, state)))
        found.append(
            one.take(
                Readings(at_s + 0.01, UTC_S + at_s, "running", {"current": start.current_a(at_s + 0.01)})
            )
        )

    (finished,) = [each for each in found if each is not None]

    above_s = (2.5 * RATED_A - 150.0) / 300.0 * 0.2
    below_s = 2.0 - (2.5 * RATED_A - 80.0) / 370.0 * 0.3
    assert finished.summary.acceleration_s == pytest.approx(below_s - above_s, rel=WITHIN)
    assert finished.summary.outcome is StartOutcome.FULL_VOLTAGE


def test_a_motor_that_is_found_on_was_not_seen_to_start() -> None:
    one = recorder()

    outcomes = feed(one, *(one_reply(float(number), "running") for number in range(20)))

    assert outcomes == []


def test_a_motor_that_is_found_on_after_a_silence_at_rest_has_started_unseen() -> None:
    one = recorder()
    feed(one, one_reply(0.0, "ready"))
    one.lose()

    outcomes = feed(one, *(one_reply(60.0 + number, "running") for number in range(10)))

    assert outcomes == [StartOutcome.FULL_VOLTAGE]


def test_a_motor_that_was_on_before_a_silence_and_accelerates_after_it_was_started_anew() -> None:
    one = recorder()
    feed(one, *(one_reply(float(number), "running") for number in range(3)))
    one.lose()

    states = ["starting"] * 3 + ["running"] * 8
    outcomes = feed(one, *(one_reply(20.0 + number, state) for number, state in enumerate(states)))

    assert outcomes == [StartOutcome.FULL_VOLTAGE]


def test_a_start_that_was_lost_twice_is_one() -> None:
    one = recorder()
    feed(one, one_reply(0.0, "ready"), one_reply(1.0, "starting"))
    outcomes = [each.summary.outcome for each in (one.lose(), one.lose()) if each is not None]
    outcomes += feed(one, one_reply(20.0, "starting"))
    one.lose()

    outcomes += feed(one, *(one_reply(30.0 + number, "starting") for number in range(9)))

    assert outcomes == [StartOutcome.GIVEN_UP]


def test_a_start_whose_beginning_was_not_seen_has_no_acceleration_time() -> None:
    one = recorder()
    motor = ReadMotor(AnalyticStart(begin_s=-2.0))

    summary, _ = sole(records(motor, one=one))

    assert (summary.outcome, summary.acceleration_s) == (StartOutcome.FULL_VOLTAGE, None)
    assert summary.standstill_s is None
    assert summary.i2t_a2s is None


def test_a_start_whose_beginning_was_not_seen_has_no_known_cause() -> None:
    summary, _ = sole(records(ReadMotor(AnalyticStart(begin_s=-2.0))))

    assert summary.cause.source == "unknown"  # that the starter is in remote now says nothing of then


def test_the_time_at_rest_before_a_start_is_counted_from_the_stop() -> None:
    one = recorder()
    feed(one, one_reply(0.0, "running"), one_reply(10.0, "stopping"), one_reply(14.0, "ready"))
    feed(one, one_reply(100.0, "ready"), one_reply(101.0, "starting"))

    lost = one.lose()

    assert lost is not None
    assert lost.summary.standstill_s == pytest.approx(87.0)


def test_a_jog_a_braking_and_a_reversal_are_no_starts() -> None:
    one = recorder()

    outcomes = feed(
        one,
        one_reply(0.0, "ready"),
        one_reply(1.0, "running", jog=True),
        one_reply(20.0, "running", braking=True),
        one_reply(40.0, "running", reversing=True),
        one_reply(60.0, "ready"),
    )

    assert outcomes == []


def test_the_time_before_a_start_that_was_announced_is_no_acceleration() -> None:
    """SSW900: initial test and time before start (C5.7.1) are `starting` too."""
    one = recorder()
    replies = [one_reply(0.0, "ready"), one_reply(1.0, "starting", accelerating=False)]
    replies += [one_reply(2.0 + 0.25 * n, "starting", accelerating=False) for n in range(12)]
    replies += [one_reply(5.0 + 0.25 * n, "starting") for n in range(20)]
    replies += [one_reply(10.0 + 0.25 * n, "running") for n in range(24)]

    found = [each for each in map(one.take, replies) if each is not None]

    summary, _ = sole(found)
    assert summary.acceleration_s == pytest.approx(5.0)
    assert summary.time_s == pytest.approx(UTC_S + 4.875)


def test_full_voltage_ends_the_acceleration_while_the_state_still_says_starting() -> None:
    one = recorder()
    replies = [one_reply(0.0, "ready"), one_reply(0.5, "starting", bypass_closed=False)]
    replies += [one_reply(0.75 + 0.25 * n, "starting", bypass_closed=n >= 20) for n in range(60)]

    summary, _ = sole([each for each in map(one.take, replies) if each is not None])

    assert summary.outcome is StartOutcome.FULL_VOLTAGE
    assert summary.acceleration_s == pytest.approx(5.375)


def test_a_ramp_that_goes_on_after_one_reply_without_it_is_one_start() -> None:
    one = recorder()
    replies = [one_reply(0.0, "ready")]
    for number in range(80):
        at_s = 0.25 * number + 0.25
        replies.append(one_reply(at_s, "running" if number == 10 or at_s > 8 else "starting"))

    summary, _ = sole([each for each in map(one.take, replies) if each is not None])

    assert summary.acceleration_s == pytest.approx(8.0)


def test_a_motor_that_never_comes_to_speed_is_given_up_and_counted_once() -> None:
    one = recorder()
    feed(one, one_reply(0.0, "ready"))

    outcomes = feed(one, *(one_reply(1.0 + 0.5 * n, "starting") for n in range(int(3 * LONGEST_S))))

    assert outcomes == [StartOutcome.GIVEN_UP]


def test_a_long_start_at_a_high_rate_stays_small_and_true() -> None:
    start = AnalyticStart(begin_s=5.0, ramp_s=200.0)
    motor = ReadMotor(start, fast_s=0.02, is_ours=True)

    summary, curve = sole(records(motor, until_s=260.0, before=written(5.0)))

    assert len(curve.t_s) <= 300
    assert summary.i2t_a2s == pytest.approx(start.i2t_a2s(), rel=WITHIN)
    assert summary.peak_a == max(value for value in curve.columns["current"] if value is not None)


def test_the_heating_is_the_rise_of_the_thermal_level() -> None:
    one = recorder(replace(POINTS))
    feed(one, one_reply(0.0, "ready", p050=12), one_reply(0.5, "starting", p050=12))
    feed(one, one_reply(5.0, "running"), one_reply(7.0, "running", p050=31))

    summary, curve = sole([each for each in [one.take(one_reply(11.0, "running"))] if each is not None])

    assert summary.heating_pct == 19.0
    assert curve.columns["thermal"][-1] == 31.0


def test_the_lowest_voltage_is_that_of_the_start_alone() -> None:
    columns = ("current", "line_voltage", "output_voltage", "torque_pct", "power_factor", "")
    one = recorder(StartPoints(POINTS.motion, columns, has_acceleration=True))
    feed(one, one_reply(0.0, "ready", line_voltage=300.0))
    feed(one, one_reply(0.5, "starting", line_voltage=392.0), one_reply(1.0, "starting", line_voltage=371.0))
    feed(one, one_reply(5.0, "running", line_voltage=399.0), one_reply(7.0, "running", line_voltage=200.0))

    summary, _ = sole([each for each in [one.take(one_reply(11.0, "running"))] if each is not None])

    assert summary.lowest_v == 371.0


def test_replies_out_of_order_change_nothing() -> None:
    one = recorder()
    feed(one, one_reply(5.0, "ready"))

    assert one.take(one_reply(4.0, "starting")) is None
    assert one._start is None


def test_without_a_single_sample_there_is_still_a_record() -> None:
    one = recorder()
    replies = [
        one_reply(float(n), "ready" if n < 5 else "starting" if n < 12 else "running") for n in range(30)
    ]

    summary, curve = sole([each for each in map(one.take, replies) if each is not None])

    assert summary.acceleration_s == pytest.approx(7.0)
    assert (summary.peak_a, summary.i2t_a2s, summary.rate_hz) == (None, None, None)
    assert curve.t_s == ()
    assert not math.isnan(summary.time_s)


def read_wrongly(one: StartRecorder, motor: ReadMotor, wrong: dict[int, float]) -> list[FinishedStart]:
    """Return the records of a motor of which some readings of the current, from the start on, are wrong."""
    found, number = [], -1
    for readings in motor.replies(0.0, 60.0):
        taken = readings
        if "current" in readings.values and readings.at_s >= motor.start.begin_s:
            number += 1
            taken = readings._replace(values={"current": wrong.get(number, readings.values["current"])})
        found.append(one.take(taken))
    return [each for each in found if each is not None]


@pytest.mark.parametrize(
    "wrong", [{12: 6553.5}, {12: 6553.5, 13: 6553.5}, {0: 6553.5}, {10: 3500.0, 40: 900.0}]
)
def test_a_current_that_cannot_be_is_counted_and_enters_nothing(wrong: dict[int, float]) -> None:
    start = AnalyticStart(begin_s=20.3)
    motor = ReadMotor(start, is_ours=True)
    one = recorder()
    one.note_command(StartCommand("alice", "c1", start.begin_s))

    summary, curve = sole(read_wrongly(one, motor, wrong))

    assert summary.outliers == len(wrong)
    assert summary.peak_a == pytest.approx(start.peak_a)
    assert summary.i2t_a2s == pytest.approx(start.i2t_a2s(), rel=WITHIN)
    assert summary.mean_a == pytest.approx(start.mean_a(), rel=WITHIN)
    assert max(value for value in curve.columns["current"] if value is not None) == pytest.approx(350.0)


def test_without_a_rated_current_a_lone_spike_is_still_none() -> None:
    one = recorder()
    one.rated_a = None

    summary, _ = sole(read_wrongly(one, ReadMotor(AnalyticStart(begin_s=20.3)), {12: 6553.5}))

    assert (summary.outliers, summary.peak_a) == (1, pytest.approx(350.0))


def test_a_kick_start_and_the_current_that_trips_the_starter_are_real() -> None:
    start = AnalyticStart(begin_s=20.3)
    kicked, _ = sole(read_wrongly(recorder(), ReadMotor(start), {0: 700.0}))
    motor = ReadMotor(start, cut_s=24.0, cut_state="fault")
    fed = sum(
        "current" in each.values and start.begin_s <= each.at_s < 24.0 for each in motor.replies(0.0, 60.0)
    )
    tripped, _ = sole(
        read_wrongly(recorder(), ReadMotor(start, cut_s=24.0, cut_state="fault"), {fed - 1: 980.0})
    )

    assert (kicked.outliers, kicked.peak_a) == (0, 700.0)
    assert (tripped.outliers, tripped.peak_a) == (0, 980.0)


@pytest.mark.parametrize("fast_s", [0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("ramp_s", [2.0, 4.0, 8.0])
def test_the_i2t_is_as_exact_as_the_record_says(fast_s: float, ramp_s: float) -> None:
    errors = []
    for seed in range(60):
        start = AnalyticStart(begin_s=20.0 + 0.137 * seed, ramp_s=ramp_s)
        motor = ReadMotor(start, fast_s=fast_s, seed=seed, is_ours=seed % 2 == 0)

        summary, _ = sole(records(motor, before=written(start.begin_s) if motor.is_ours else lambda *_: None))

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
        summary, _ = sole([each for each in taken if each is not None])
        assert summary.acceleration_s == pytest.approx(start.ramp_s)
        assert summary.rate_hz == (None if expected is None else pytest.approx(expected, rel=0.01))


def test_a_start_after_the_first_replies_counts_although_the_one_that_showed_rest_was_not_handed_over() -> (
    None
):
    one = recorder()
    values = Readings(
        1.0, UTC_S + 1.0, "ready", {"current": 0.0}
    )  # no motion: the state is of an earlier reply

    outcomes = feed(one, values, *(one_reply(1.5 + n, "running") for n in range(7)))

    assert outcomes == [StartOutcome.FULL_VOLTAGE]


def test_a_motor_that_runs_as_the_first_replies_say_has_not_started() -> None:
    values = Readings(1.0, UTC_S + 1.0, "running", {"current": 50.0})

    assert feed(recorder(), values, *(one_reply(1.5 + n, "running") for n in range(7))) == []
