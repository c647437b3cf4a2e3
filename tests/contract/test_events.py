from __future__ import annotations

import ast
from collections import Counter

import pytest

from gateway.contract import Event, EventCode, Severity, event_of, phrase
from gateway.contract.events import EVENTS
from gateway.contract.wording import names_in
from tests.contract.event_uses import (
    ADDED_TO_FAULT,
    FAULT,
    SOURCE,
    calls_of,
    is_composed,
    modules,
    uses,
)

USES = uses()
EVENT_USES = [use for use in USES if use.callee != "phrase"]
PHRASE_USES = [use for use in USES if use.callee == "phrase"]
CODES = {code.name: code for code in EventCode}


def test_the_table_has_every_code() -> None:
    assert list(EVENTS) == list(EventCode)
    assert all(code.name.lower() == code.value for code in EventCode)


def test_an_event_is_given_a_case_and_exactly_its_fields() -> None:
    for use in EVENT_USES:
        meaning = EVENTS[CODES[use.code]]
        assert use.case in meaning.texts, use
        assert use.fields - meaning.optional == meaning.required(use.case), use


def test_a_severity_is_given_where_a_code_has_several() -> None:
    for use in EVENT_USES:
        severities = {each.value for each in EVENTS[CODES[use.code]].severities}
        assert bool(use.severity) is (len(severities) > 1), use
        assert use.severity in severities | {"", "?"}, use


def test_a_phrase_is_given_exactly_its_fields() -> None:
    for use in PHRASE_USES:
        assert use.fields == names_in(EVENTS[CODES[use.code]].phrases[use.case]), use


def test_every_code_every_case_and_every_phrase_is_used() -> None:
    said = {(CODES[use.code], use.case) for use in EVENT_USES}
    phrases = {(CODES[use.code], use.case) for use in PHRASE_USES}

    assert {(code, case) for code, event in EVENTS.items() for case in event.texts} == said
    assert {(code, name) for code, event in EVENTS.items() for name in event.phrases} == phrases


def test_every_severity_of_a_code_is_used() -> None:
    given: dict[str, set[str]] = {}
    for use in EVENT_USES:
        given.setdefault(use.code, set()).add(use.severity)

    for name, severities in given.items():
        listed = {each.value for each in EVENTS[CODES[name]].severities}
        assert severities in ({""}, listed) or "?" in severities


def test_no_text_is_composed_where_an_event_is_given() -> None:
    assert not [str(use) for use in USES if any(map(is_composed, use.values))]


def test_only_the_contract_makes_events() -> None:
    places = {
        (callee, name)
        for name, module in modules()
        for callee in ("Event", "EventRecord")
        for call in calls_of(module, callee)
        if isinstance(call.func, ast.Name)  # no asyncio.Event
    }

    assert places == {("Event", "contract/events.py"), ("EventRecord", "contract/bus.py")}


def test_a_fault_of_a_line_is_completed_in_one_place() -> None:
    relays = [
        (name, {each.arg for each in call.keywords} - {None})
        for name, module in modules()
        for call in calls_of(module, "_publish_event")
        if any(each.arg is None for each in call.keywords)
    ]

    assert relays == [("app/plant.py", ADDED_TO_FAULT)]
    assert {use.place.split(":")[0] for use in USES if use.callee == FAULT} == {"line/rtu/bus_faults.py"}


@pytest.mark.parametrize("code", EventCode)
def test_an_event_is_explained_in_sentences(code: EventCode) -> None:
    event = EVENTS[code]

    assert event.sentence.endswith(".")
    assert event.remedy.endswith(".")
    assert event.severities
    assert event.optional <= event.data.keys()
    assert "|" not in event.sentence + event.remedy + "".join(event.data.values())
    for text in (*event.texts.values(), *event.phrases.values()):
        assert text == text.strip()
        assert not text.endswith(".")


def test_a_text_and_the_data_are_made_of_the_fields() -> None:
    assert event_of(EventCode.WENT_SILENT, reason="no reply", frames=["00"]) == Event(
        EventCode.WENT_SILENT,
        Severity.WARNING,
        "the starter went silent: no reply",
        {"reason": "no reply", "frames": ["00"]},
    )
    assert phrase(EventCode.GAP, "loss", count=3, kind="value", reason="full") == "3 of kind value (full)"


def test_data_has_the_order_of_the_table_whatever_that_of_the_call() -> None:
    stopped = event_of(EventCode.STOPPED, run_s=2.5, to="ready", from_="running")

    assert list(stopped.data.items()) == [("from", "running"), ("to", "ready"), ("run_s", 2.5)]


def test_what_is_not_known_is_absent_only_where_it_is_optional() -> None:
    assert event_of(EventCode.STARTED, from_=None, to="running", before=None).data == {
        "from": None,
        "to": "running",
    }


WRONG = {
    "a field is missing": (EventCode.BROKER_AWAY, "", {}),
    "a field is too much": (EventCode.BROKER_CONNECTED, "", {"trouble": "x"}),
    "a severity is missing": (EventCode.STORE_LOST, "", {"trouble": "x"}),
    "another severity": (EventCode.BROKER_AWAY, "", {"trouble": "x", "severity": Severity.ERROR}),
    "another of several": (EventCode.ALARM, "", {"severity": Severity.INFO}),
}


@pytest.mark.parametrize(("code", "case", "fields"), WRONG.values(), ids=WRONG)
def test_a_wrong_call_is_an_error(code: EventCode, case: str, fields: dict[str, object]) -> None:
    with pytest.raises(TypeError, match=code.value):
        event_of(code, case, **fields)  # type: ignore[arg-type]


def test_a_case_that_the_code_has_not_is_an_error() -> None:
    with pytest.raises(KeyError):
        event_of(EventCode.SPARKPLUG_AWAY, "other")


def test_a_value_with_braces_stays_as_it_is() -> None:
    assert event_of(EventCode.BROKER_AWAY, trouble="{x}").text == "{x}"


def test_the_source_was_read() -> None:
    assert SOURCE.is_dir()
    assert Counter(use.callee for use in USES)["event_of"] > 5
