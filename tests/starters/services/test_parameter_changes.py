"""Who turned the keypad."""

from __future__ import annotations

from typing import Any

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.starters.services.parameter_monitor import ParameterChanges, watched_codes

V = Variant()


def ssw07() -> ParameterChanges:
    watch = ParameterChanges(load_profile("ssw07"))
    assert watch.note_reading(V, {"P314": (30,), "P230": (2,)}) == ()
    return watch


def note(watch: ParameterChanges, verb: str, args: dict[str, Any]) -> None:
    """Let a command of ours begin and end."""
    watch.note_command(V, verb, args, is_over=False)
    watch.note_command(V, verb, args, is_over=True)


def test_the_first_reading_is_no_change_and_an_equal_one_neither() -> None:
    assert ssw07().note_reading(V, {"P314": (30,)}) == ()


def test_a_setting_that_was_not_set_through_us_is_an_event_with_both_values() -> None:
    (change,) = ssw07().note_reading(V, {"P314": (5,)})

    assert change.code == "parameter_changed"
    assert "P314 timeout for message reception was changed at the starter: 30.0 s -> 5.0 s" in change.text
    assert change.data["before"]["raw"] == [30]
    assert change.data["after"] == {"value": 5.0, "label": None, "unit": "s", "raw": [5]}


def test_a_change_is_one_event() -> None:
    watch = ssw07()
    watch.note_reading(V, {"P314": (5,)})

    assert watch.note_reading(V, {"P314": (5,)}) == ()


def test_what_we_set_is_no_news() -> None:
    watch = ssw07()
    note(watch, "set", {"parameter": "p314", "value": 5})

    assert watch.note_reading(V, {"P314": (5,)}) == ()


def test_what_is_set_just_now_is_no_news_before_the_command_has_ended() -> None:
    watch = ssw07()
    watch.note_command(V, "set", {"parameter": "P314", "value": 5}, is_over=False)

    assert watch.note_reading(V, {"P314": (30,)}) == ()
    assert watch.note_reading(V, {"P314": (5,)}) == ()


def test_another_value_than_ours_is_news_although_we_set_the_same_row() -> None:
    watch = ssw07()
    note(watch, "set", {"parameter": "P314", "value": 5})

    assert len(watch.note_reading(V, {"P314": (7,)})) == 1


def test_ours_counts_up_to_the_first_reading_after_the_command() -> None:
    watch = ssw07()
    note(watch, "set", {"parameter": "P314", "value": 5})  # it failed
    watch.note_reading(V, {"P314": (30,)})

    assert len(watch.note_reading(V, {"P314": (5,)})) == 1


def test_a_second_command_for_a_row_is_awaited_anew() -> None:
    watch = ssw07()
    note(watch, "set", {"parameter": "P314", "value": 5})
    watch.note_command(V, "set", {"parameter": "P314", "value": 6}, is_over=False)

    assert watch.note_reading(V, {"P314": (30,)}) == ()
    assert watch.note_reading(V, {"P314": (6,)}) == ()


def test_several_values_of_one_set_are_all_ours() -> None:
    watch = ssw07()
    note(watch, "set", {"values": {"P314": 5, "P230": "DI"}})

    assert watch.note_reading(V, {"P314": (5,), "P230": (1,)}) == ()


def test_a_configure_is_ours() -> None:
    watch = ParameterChanges(load_profile("sst"))
    watch.note_reading(V, {"R41": (0,)})
    note(watch, "configure", {"R41": 9})

    assert watch.note_reading(V, {"R41": (9,)}) == ()


def test_a_command_that_makes_no_sense_is_passed_over() -> None:
    watch = ssw07()
    note(watch, "set", {"parameter": "COFFEE", "value": 1})
    note(watch, "set", {})

    assert len(watch.note_reading(V, {"P314": (5,)})) == 1


def test_settings_are_watched_and_readings_outputs_and_the_clock_are_not() -> None:
    codes = watched_codes(load_profile("ssw900"))

    assert {"C3.1", "C8.1.1.5", "C8.2.5.3"} <= set(codes)
    assert not any(code.startswith(("S", "D", "C11.", "C6.3.")) for code in codes)
