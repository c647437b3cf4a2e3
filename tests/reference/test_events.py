from __future__ import annotations

import pytest

from tests.reference.event_codes import EVENTS
from tests.reference.published_codes import Source, fields_made_for

LISTED = {code: event for events in EVENTS.values() for code, event in events.items()}


@pytest.fixture(scope="module")
def source() -> Source:
    return Source()


def test_every_code_in_the_source_can_be_read_off_it(source: Source) -> None:
    assert source.unresolved == []  # else: name it in published_codes.ELSEWHERE


def test_every_code_that_is_published_is_listed(source: Source) -> None:
    assert sorted(source.found.keys() - LISTED.keys()) == []  # else: tests/reference/event_codes.py


def test_every_listed_code_is_published(source: Source) -> None:
    assert sorted(LISTED.keys() - source.found.keys()) == []


def test_the_list_has_each_code_once() -> None:
    assert len(LISTED) == sum(len(events) for events in EVENTS.values())


@pytest.mark.parametrize("code", LISTED)
def test_an_event_has_the_severities_that_are_listed(source: Source, code: str) -> None:
    published = source.found[code]

    if not published.is_severity_computed:
        assert published.severities == {severity.value for severity in LISTED[code].severities}


@pytest.mark.parametrize("code", LISTED)
def test_an_event_carries_the_fields_that_are_listed(source: Source, code: str) -> None:
    published, listed = source.found[code].fields, set(LISTED[code].fields)

    assert published <= listed
    assert listed <= published | fields_made_for(code)


@pytest.mark.parametrize("code", LISTED)
def test_an_event_is_explained_in_sentences(code: str) -> None:
    event = LISTED[code]

    assert event.sentence.endswith(".")
    assert event.hint
    assert "|" not in event.sentence + event.hint + "".join(event.fields.values())
