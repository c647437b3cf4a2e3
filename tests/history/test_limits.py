import math
from typing import Any

import pytest

from gateway.plugins.history.limits import (
    LEAST_FALL,
    LEAST_FALL_S,
    LEAST_LEVEL,
    ThermalModel,
    pause_left_s,
)


@pytest.mark.parametrize(
    ("limits", "starts", "since", "pause"),
    [
        ({}, [], 0.0, 0.0),
        ({"after_stop_s": 60}, [], 9_980.0, 40.0),
        ({"after_stop_s": 60}, [], 0.0, 0.0),
        ({"after_stop_s": 60}, [], None, 60.0),  # it runs: the pause begins with its standstill
        ({"between_starts_s": 300}, [9_900.0], 9_950.0, 200.0),
        ({"per_hour": 2}, [7_000.0, 9_000.0], 9_990.0, 600.0),
        ({"per_hour": 2}, [9_000.0], 9_990.0, 0.0),
        ({"per_hour": 2, "after_stop_s": 900}, [7_000.0, 9_000.0], 9_990.0, 890.0),
    ],
)
def test_the_pause_is_the_longest_that_any_limit_demands(
    limits: dict[str, Any], starts: list[float], since: float | None, pause: float
) -> None:
    assert pause_left_s(starts, standing_since_s=since, now_s=10_000.0, **limits) == pause


def cool(model: ThermalModel, *, level: float, tau_s: float, until_s: float, since_s: float = 0.0) -> float:
    """A motor at rest whose level the starter gives as whole numbers, every 10 s."""
    at_s = since_s
    while at_s <= until_s:
        shown = round(level * math.exp(-(at_s - since_s) / tau_s))
        model.note_level(shown, at_s=at_s, is_standing=True)
        at_s += 10.0
    return at_s


def test_the_time_constant_is_learnt_while_the_motor_cools() -> None:
    model = ThermalModel(trip_level=250.0)

    cool(model, level=250.0, tau_s=1200.0, until_s=900.0)

    assert model.tau_s == pytest.approx(1200.0, rel=0.05)


@pytest.mark.parametrize(
    ("level", "after_s", "is_standing", "tau_s"),
    [
        (LEAST_LEVEL * 250.0, 1200.0 * math.log(1 / LEAST_LEVEL), True, pytest.approx(1200.0)),
        (LEAST_LEVEL * 250.0 - 0.1, 1200.0 * math.log(1 / LEAST_LEVEL), True, None),
        (250.0 * (1 - LEAST_FALL) + 0.1, 600.0, True, None),
        (180.0, LEAST_FALL_S - 1.0, True, None),
        (180.0, 600.0, False, None),
    ],
)
def test_a_motor_at_rest_teaches_by_a_fall_that_is_deep_and_long_and_ends_above_the_least_level(
    level: float, after_s: float, is_standing: bool, tau_s: float | None
) -> None:
    model = ThermalModel(trip_level=250.0)
    model.note_level(250.0, at_s=500.0, is_standing=is_standing)
    model.note_level(level, at_s=500.0 + after_s, is_standing=is_standing)

    assert model.tau_s == tau_s


def test_a_silence_breaks_a_fall() -> None:
    model = ThermalModel(trip_level=250.0)
    model.note_level(250.0, at_s=0.0, is_standing=True)
    model.forget()
    model.note_level(100.0, at_s=1000.0, is_standing=True)

    assert model.tau_s is None


def test_an_ssw900_set_to_thirty_minutes_whose_starts_heat_by_forty_percent() -> None:
    model = ThermalModel(trip_level=100.0, set_tau_s=30 * 60.0)  # S4.2.1, C5.9.7.7
    for before, after in ((10.0, 50.0), (20.0, 45.0)):
        model.note_level(before, at_s=0.0, is_standing=True)
        model.note_start()
        model.note_started()
        model.note_level(after, at_s=10.0, is_standing=False)
    model.note_level(100.0, at_s=1000.0, is_standing=True)  # F005

    # The worst start needs 40 %, so it waits for 60 %: 1800 s * ln(100 / 60) = 919.5 s.
    assert model.restart_in_s(1000.0) == pytest.approx(919.5, abs=0.1)
    assert model.restart_in_s(1300.0) == pytest.approx(619.5, abs=0.1)
    assert model.restart_in_s(3000.0) == 0.0


def test_an_ssw07_that_was_seen_to_cool_from_250_to_200_percent_in_ten_minutes() -> None:
    model = ThermalModel(trip_level=250.0)  # P050
    model.note_level(250.0, at_s=0.0, is_standing=True)  # E05
    model.note_level(200.0, at_s=600.0, is_standing=True)

    # tau = 600 s / ln(250 / 200) = 2689 s; no start was seen, so 30 % of 250 are left free: 175.
    assert model.tau_s == pytest.approx(2688.9, abs=0.1)
    assert model.restart_in_s(600.0) == pytest.approx(2688.9 * math.log(200 / 175), abs=0.1)
