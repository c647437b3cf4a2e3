"""What a reload has to do, from two configurations."""

from __future__ import annotations

import pytest

from gateway.config.convert import wired_starters
from gateway.config.diff import changes_of
from gateway.config.reading import parse
from tests.config.sites import SITE, site

FANS = """
[[line]]
name = "fans"
port = "/dev/rs485-fans"
baud = 9600
framing = "8N2"

[[line.starter]]
name = "fan"
address = 1
family = "ssw06"
"""
ASKED = '[[points]]\nfamily = "ssw900"\ncodes = ["D6.*"]\n'
ROW = '[[row]]\nfamily = "ssw07"\nparameter = "P102"\nname = "x"\ntitle = "X"\n'
EVERY, FRAMING, OPERATOR = "every_s = 2.0", 'framing = "8E1"', "[[operator]]"
PUMP_1, PUMP_2 = ({"starters_changed": [name]} for name in ("pump-1", "pump-2"))
REOPENED = {"lines_reopened": ["pumps"], "starters_changed": ["pump-1", "pump-2"]}


@pytest.mark.parametrize(
    ("old", "new", "changes"),
    [
        # another machine
        ("address = 1", "address = 9", PUMP_1),
        ('family = "ssw07"', 'family = "ssw06"', PUMP_1),
        (EVERY, f"{EVERY}\nwatchdog_s = 60.0", PUMP_2),
        (EVERY, f"{EVERY}\nenabled = false", PUMP_2),
        # points concern the starters that have them alone, wherever they are asked for
        (EVERY, f'{EVERY}\npoints = ["S1.1.1"]', PUMP_2),
        (FRAMING, f'{FRAMING}\npoints = ["P2*"]', PUMP_1),
        (OPERATOR, ASKED + OPERATOR, PUMP_2),
        (OPERATOR, ROW + OPERATOR, PUMP_1),
        # another way to the line
        ("/dev/rs485-pumps", "/dev/ttyUSB3", REOPENED),
        ("baud = 19200", "baud = 9600", REOPENED),
        (FRAMING, 'framing = "8N2"', REOPENED),
        (FRAMING, f"{FRAMING}\nadapter_allowance_s = 0.05", REOPENED),
    ],
)
def test_another_machine_or_another_way_to_it_ends_and_begins(
    old: str, new: str, changes: dict[str, list[str]]
) -> None:
    found = changes_of(parse(SITE + FANS, "x"), parse((SITE + FANS).replace(old, new, 1), "x"))

    assert found.to_dict() == changes
    assert (found.lines_forgotten, found.lines_joined != ()) == ((), changes is not REOPENED)


def test_a_point_that_is_asked_for_twice_changes_nothing() -> None:
    twice = (SITE + ASKED).replace(EVERY, f'{EVERY}\npoints = ["D6.1"]')

    assert changes_of(parse(SITE + ASKED, "x"), parse(twice, "x")).to_dict() == {}


def test_a_starter_that_moves_to_another_line_is_not_forgotten() -> None:
    moved = SITE.replace('name = "pump-2"', 'name = "fan"') + FANS.replace('"fan"', '"pump-2"')

    changes = changes_of(parse(SITE + FANS, "x"), parse(moved, "x"))

    assert changes.to_dict() == {"starters_changed": ["fan", "pump-2"]}


@pytest.mark.parametrize(
    ("old", "new", "wired"),
    [
        ("address = 1\n", "address = 9\n", ["pump-2", "pump-1"]),
        (FRAMING, f'{FRAMING}\norder = ["pump-2", "pump-1"]', ["pump-2", "pump-1"]),
        (EVERY, "enabled = false", ["pump-1"]),
    ],
)
def test_starters_are_in_the_order_of_the_cable_without_the_disabled_ones(
    old: str, new: str, wired: list[str]
) -> None:
    assert [each.name for each in wired_starters(site((old, new)).lines[0])] == wired
