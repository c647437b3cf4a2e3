"""Parameter sets as TOML, and what two of them differ in."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.errors import UsageError
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.starters.parameters.model import ParameterEntry, ParameterSet, differences, entries_of
from gateway.starters.parameters.toml_file import from_toml, to_toml

TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=12)
VALUE = st.none() | st.booleans() | st.integers(0, 9) | st.floats(0, 1e6) | TEXT
RAW = st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=4).map(tuple)
ENTRY = st.builds(ParameterEntry, name=TEXT, value=VALUE, label=st.none() | TEXT, unit=TEXT, raw=RAW)
CODES = st.from_regex(r"[A-Z]{1,4}[0-9.]{1,8}", fullmatch=True)

SSW07 = load_profile("ssw07")


def saved(**parameters: ParameterEntry) -> ParameterSet:
    return ParameterSet("pump-1", "ssw07", parameters=parameters)


@given(st.dictionaries(CODES, ENTRY, max_size=5), TEXT, st.none() | TEXT)
def test_what_is_written_is_read_again_as_it_was(
    parameters: dict[str, ParameterEntry], reason: str, model: str | None
) -> None:
    one = ParameterSet(
        "pump-1", "ssw07", "2026-11-21T01:02:03+00:00", model, "1.40", None, parameters, {"P089": reason}
    )

    assert from_toml(to_toml(one), "a.toml") == one


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[starter", "a.toml"),
        ("[parameters]\n", "[starter]"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n', "[parameters]"),
        ('[starter]\nname = "p"\n[parameters]\n', "family"),
        ('[starter]\nname = 1\nfamily = "ssw07"\n[parameters]\n', "name"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = {}\n', "P1"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = { colour = 1 }\n', "colour"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = { raw = [70000] }\n', "raw"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = { raw = 5 }\n', "raw"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = nan\n', "value"),
        ('[starter]\nname = "p"\nfamily = "ssw07"\n[parameters]\nP1 = [1]\n', "value"),
    ],
)
def test_a_file_that_is_none_is_refused_with_its_place(text: str, named: str) -> None:
    with pytest.raises(UsageError) as caught:
        from_toml(text, "a.toml")

    assert named in str(caught.value)
    assert str(caught.value).startswith("a.toml")


def of_raw(**raw: int) -> ParameterSet:
    return saved(**entries_of(SSW07, Variant(), {code: (number,) for code, number in raw.items()}))


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        (of_raw(P230=2, P314=0), of_raw(P230=1, P314=0),
         "P230 command selection, remote mode: 2 (Serial) -> 1 (DI)"),
        (saved(), saved(P314=ParameterEntry(name="timeout", value=3, unit="s")),
         "P314 timeout: not there -> 3 s"),
        (saved(P230=ParameterEntry(value="DI")), saved(P230=ParameterEntry(value="Serial")),
         "P230 : DI -> Serial"),
        (saved(P313=ParameterEntry(raw=(1, 2))), saved(P313=ParameterEntry(value=True)),
         "P313 : raw 1 2 -> true"),
        (of_raw(P003=1), of_raw(P003=2), ""),  # a reading
        *((of_raw(P230=2), saved(P230=ParameterEntry(value=value)), "") for value in (2, 2.0, "serial")),
    ],
)  # fmt: skip
def test_a_difference_is_shown_with_values_and_labels(
    before: ParameterSet, after: ParameterSet, text: str
) -> None:
    assert [each.text for each in differences(before, after, profile=SSW07)] == ([text] if text else [])


def test_rows_that_no_manual_names_come_last() -> None:
    assert list(entries_of(SSW07, Variant(), {"P500": (1,), "P003": (2,)})) == ["P003", "P500"]
