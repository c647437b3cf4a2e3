from __future__ import annotations

from gateway.app.health import Saturation


def reported(*seen: tuple[float, float]) -> list[bool | None]:
    saturation = Saturation()
    return [saturation.take(utilisation, now_s) for now_s, utilisation in seen]


def test_a_line_that_is_full_for_a_minute_is_reported_once() -> None:
    assert reported((0.0, 0.97), (30.0, 1.0), (60.0, 0.96), (61.0, 1.0), (200.0, 1.0)) == [
        None,
        None,
        True,
        None,
        None,
    ]


def test_a_pause_begins_the_minute_anew() -> None:
    assert reported((0.0, 0.97), (50.0, 0.9), (60.0, 0.97), (119.0, 0.97), (120.0, 0.97)) == [None] * 4 + [
        True
    ]


def test_a_full_line_is_relieved_after_a_minute_well_below() -> None:
    full = [(0.0, 1.0), (60.0, 1.0)]

    assert reported(*full, (100.0, 0.92), (200.0, 0.92), (201.0, 0.5), (261.0, 0.5))[2:] == [None] * 3 + [
        False
    ]
