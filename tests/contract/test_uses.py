"""What the source says of events and results fits their tables, all of a table is said, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Set
from functools import cache

from gateway.contract import EventCode, ResultCode
from gateway.contract.events import EVENTS
from gateway.contract.results import NOTES, RESULTS
from gateway.contract.wording import names_in
from tests.contract.uses import Use, uses

used = cache(lambda: list(uses()))

# By table, code and case: the fields that it must be given, and those that it may.
TABLE: Mapping[tuple[str, str, str], tuple[Set[str], Set[str]]] = {
    **{
        ("events", c, case): (names_in(text) | (m.data.keys() - m.optional), m.optional)
        for c, m in EVENTS.items()
        for case, text in m.texts.items()
    },
    **{
        ("phrases", c, case): (names_in(t), set()) for c, m in EVENTS.items() for case, t in m.phrases.items()
    },
    **{("results", c, case): (names_in(t), set()) for c, m in RESULTS.items() for case, t in m.texts.items()},
    **{("notes", "", case): (names_in(text), set()) for case, text in NOTES.items()},
}


def test_the_codes_are_those_of_the_tables_in_their_order() -> None:
    assert list(EVENTS) == list(EventCode)
    assert list(RESULTS) == list(ResultCode)


def is_right(use: Use) -> bool:
    required, optional = TABLE.get((use.table, use.code, use.case), ({"?"}, set()))
    return use.fields | optional == required | optional


def test_each_use_names_a_text_with_exactly_its_fields() -> None:
    assert [use for use in used() if not is_right(use)] == []
    assert len(used()) > 300


def test_each_text_is_used() -> None:
    assert TABLE.keys() - {(use.table, use.code, use.case) for use in used()} == set()


def test_a_severity_is_given_where_a_code_has_several_and_each_is_used() -> None:
    for code, meaning in EVENTS.items():
        given = {use.severity for use in used() if use.table == "events" and use.code == code}
        listed = {each.value for each in meaning.severities}
        assert given == {""} if len(listed) == 1 else "?" in given or given == listed, code
