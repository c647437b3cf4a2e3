"""What a reload has to do, from two configurations."""

from __future__ import annotations

from gateway.config.convert import wired_starters
from gateway.config.diff import ConfigChanges, changes_of
from gateway.config.reading import parse
from tests.config.sites import SITE, site

SECOND_LINE = """
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


def reported(*changes: tuple[str, str]) -> dict[str, list[str]]:
    """Return what becomes of the site when its text is changed so."""
    return between("", *changes)


def between(more: str, *changes: tuple[str, str]) -> dict[str, list[str]]:
    return found(more, *changes).to_dict()


def found(more: str, *changes: tuple[str, str]) -> ConfigChanges:
    text = SITE + more
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return changes_of(parse(SITE + more, "site.toml"), parse(text, "site.toml"))


def test_a_starter_that_is_another_machine_ends_and_begins() -> None:
    for change in (
        ("address = 1", "address = 9"),
        ('family = "ssw07"', 'family = "ssw06"'),
        ("every_s = 2.0", "every_s = 2.0\nwatchdog_s = 60.0"),
        ("every_s = 2.0", "every_s = 2.0\nenabled = false"),
    ):
        (kind,) = reported(change)
        assert kind == "starters_changed"


def test_points_concern_the_starters_that_have_them_alone() -> None:
    asked = '[[points]]\nfamily = "ssw900"\ncodes = ["D6.*"]\n'
    row = '[[row]]\nfamily = "ssw07"\nparameter = "P102"\nname = "x"\ntitle = "X"\n'

    assert reported(("every_s = 2.0", 'every_s = 2.0\npoints = ["S1.1.1"]')) == {
        "starters_changed": ["pump-2"]
    }
    assert reported(('framing = "8E1"', 'framing = "8E1"\npoints = ["P2*"]')) == {
        "starters_changed": ["pump-1"]
    }
    assert reported(("[[operator]]", f"{asked}[[operator]]")) == {"starters_changed": ["pump-2"]}
    assert reported(("[[operator]]", f"{row}[[operator]]")) == {"starters_changed": ["pump-1"]}
    assert between(asked, ("every_s = 2.0", 'every_s = 2.0\npoints = ["D6.1"]')) == {}


def test_a_line_whose_way_differs_ends_and_begins_with_all_its_starters() -> None:
    for change in (
        ("/dev/rs485-pumps", "/dev/ttyUSB3"),
        ("baud = 19200", "baud = 9600"),
        ('framing = "8E1"', 'framing = "8N2"'),
        ('framing = "8E1"', 'framing = "8E1"\nadapter_allowance_s = 0.05'),
    ):
        changes = found(SECOND_LINE, change)
        assert changes.to_dict() == {"lines_reopened": ["pumps"], "starters_changed": ["pump-1", "pump-2"]}
        assert changes.lines_forgotten == ()
        assert changes.lines_joined == ()


def test_a_starter_that_moves_to_another_line_is_not_forgotten() -> None:
    moved = parse(
        SITE.replace('name = "pump-2"', 'name = "fan"') + SECOND_LINE.replace('"fan"', '"pump-2"'), "x"
    )

    changes = changes_of(parse(SITE + SECOND_LINE, "x"), moved)

    assert changes.to_dict() == {"starters_changed": ["fan", "pump-2"]}


def test_starters_stand_in_the_order_of_the_cable_without_the_disabled_ones() -> None:
    by_address = wired_starters(site(("address = 1\n", "address = 9\n")).lines[0])
    ordered = wired_starters(
        site(('framing = "8E1"', 'framing = "8E1"\norder = ["pump-2", "pump-1"]')).lines[0]
    )
    off = wired_starters(site(("every_s = 2.0", "enabled = false")).lines[0])

    assert [each.name for each in by_address] == ["pump-2", "pump-1"]
    assert [each.name for each in ordered] == ["pump-2", "pump-1"]
    assert [each.name for each in off] == ["pump-1"]
