from __future__ import annotations

import pytest

from gateway.families.profile.decode import Decoded
from gateway.records import Quality
from gateway.starters.telemetry.snapshot import Reading, Snapshot, as_flag

UNITS = {"current": "A", "running": ""}


def decoded(value: float | None, unit: str = "A", *, label: str | None = None) -> Decoded:
    return Decoded(value, label=label, unit=unit, raw=(1,))


def read_once(value: float | None = 12.0, *, at_s: float = 5.0) -> Snapshot:
    snapshot = Snapshot(UNITS)
    snapshot.apply({"current": decoded(value)}, at_s=at_s, time_s=1000.0 + at_s)
    return snapshot


def test_a_point_just_read_is_good_and_carries_its_time() -> None:
    snapshot = read_once()

    assert snapshot.readings["current"] == Reading(12.0, "A", Quality.GOOD, None, 5.0, 1005.0)
    assert snapshot.age_s("current", now_s=7.5) == 2.5
    assert snapshot.good_values() == {"current": 12.0}


def test_a_value_that_cannot_be_decoded_is_bad_but_has_its_time() -> None:
    snapshot = read_once(None)

    assert snapshot.readings["current"] == Reading(None, "A", Quality.BAD, None, 5.0, 1005.0)


def test_a_reading_older_than_the_known_one_is_ignored() -> None:
    snapshot = read_once()

    snapshot.apply({"current": decoded(99.0)}, at_s=4.0, time_s=1004.0)

    assert snapshot.readings["current"].value == 12.0


def test_a_refused_point_is_bad_and_loses_its_value() -> None:
    snapshot = read_once()

    snapshot.refuse(["current"])

    assert snapshot.readings["current"] == Reading(None, "A", Quality.BAD, None, 5.0, 1005.0)


def test_a_stale_reading_keeps_its_value_and_its_own_old_time() -> None:
    snapshot = read_once()

    snapshot.mark_stale()

    assert snapshot.readings["current"] == Reading(12.0, "A", Quality.STALE, None, 5.0, 1005.0)
    assert snapshot.good_values() == {}


def test_only_the_named_points_become_stale() -> None:
    snapshot = read_once()

    snapshot.mark_stale(["running"])

    assert snapshot.readings["current"].quality is Quality.GOOD


def test_older_rows_do_not_replace_newer_ones() -> None:
    snapshot = Snapshot(UNITS)
    snapshot.keep_rows({"P003": (120,)}, at_s=5.0)

    snapshot.keep_rows({"P003": (99,)}, at_s=4.0)

    assert snapshot.rows == {"P003": (120,)}


def test_only_a_boolean_is_a_flag() -> None:
    assert as_flag(True) is True
    assert as_flag(False) is False
    assert as_flag(1) is None
    assert as_flag(None) is None


def test_only_points_that_say_something_else_since_the_last_look_are_named() -> None:
    snapshot = Snapshot(UNITS)
    assert set(snapshot.take_changed()) == {"current", "running"}
    assert not set(snapshot.take_changed())

    snapshot.apply({"current": decoded(12.0)}, at_s=5.0, time_s=1005.0)

    assert set(snapshot.take_changed()) == {"current"}


def test_a_reading_of_which_only_the_time_is_new_is_no_change() -> None:
    snapshot = read_once()
    snapshot.take_changed()

    snapshot.apply({"current": decoded(12.0)}, at_s=6.0, time_s=1006.0)

    assert not set(snapshot.take_changed())
    assert snapshot.readings["current"].at_s == 6.0


@pytest.mark.parametrize("other", [decoded(13.0), decoded(12), decoded(None), decoded(12.0, label="on")])
def test_another_value_type_quality_or_label_is_a_change(other: Decoded) -> None:
    snapshot = read_once()
    snapshot.take_changed()

    snapshot.apply({"current": other}, at_s=6.0, time_s=1006.0)

    assert set(snapshot.take_changed()) == {"current"}


def test_a_snapshot_stands_as_it_did_while_only_measured_quantities_change() -> None:
    snapshot = Snapshot(UNITS)
    snapshot.apply(
        {"current": decoded(12.0), "running": Decoded(True, label=None, unit="", raw=(1,))},
        at_s=1.0,
        time_s=0.0,
    )
    before = snapshot.standing

    snapshot.apply({"current": decoded(13.0)}, at_s=2.0, time_s=0.0)
    assert snapshot.standing == before
    snapshot.apply({"running": Decoded(False, label=None, unit="", raw=(0,))}, at_s=3.0, time_s=0.0)
    assert snapshot.standing > before
    before = snapshot.standing
    snapshot.mark_stale(["current"])
    assert snapshot.standing > before
