"""What docs/size.md says has been reached stays reached."""

from __future__ import annotations

from tests import size_page

LARGEST = {  # code lines of a room that is still above its budget: lower them with the room
    "contract": 852,
    "starters": 4201,
    "store": 1303,
    "system": 601,
    "cli": 3757,
}


def test_rooms_stay_within_their_budgets_or_within_what_they_have_been_brought_down_to() -> None:
    sizes = size_page.room_sizes()

    over = {
        room: n for room, n in sizes.items() if n > max(size_page.BUDGETS.get(room, 0), LARGEST.get(room, 0))
    }
    assert over == {}


def test_no_folder_has_more_than_13_modules() -> None:
    assert size_page.largest_folder()[0] <= 13


def test_few_files_are_below_60_lines() -> None:
    assert len(size_page.small_files()) < 37


def test_front_doors_have_at_most_40_names_and_the_contract_80() -> None:
    names = {door: len(size_page.door_names(door)) for door in size_page.DOORS}

    assert {door: n for door, n in names.items() if n > (80 if door == "contract" else 40)} == {}


def test_no_class_name_exists_twice() -> None:
    assert size_page.double_names() == []


def test_tests_construct_fewer_internal_classes_than_before() -> None:
    assert size_page.internal_constructions().total() < 950
