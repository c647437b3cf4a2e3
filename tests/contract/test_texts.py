"""The tables of events and results: each text is made of the fields that it is given."""

from __future__ import annotations

from gateway.contract import (
    Event,
    EventCode,
    Note,
    Reason,
    ResultCode,
    Severity,
    event_of,
    meaning_of,
    phrase,
)


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


def test_a_reason_and_what_is_added_make_one_text() -> None:
    reason = Reason(ResultCode.SELECTION_EXPIRED, valid_s=10.0).noted(Note("nothing_written"), None)

    assert reason.text == "the selection is more than 10 s old; select again; nothing was written"
    assert reason.code == "selection_expired"
    assert reason.noted() == reason != Reason(ResultCode.EXPIRED, "message")


def test_an_exception_that_no_manual_names_has_its_number_in_the_code() -> None:
    assert Reason(ResultCode.EXCEPTION, "write", number=77).code == "exception_77"
    assert meaning_of("exception_77").remedy == "See its manual."
    assert meaning_of("locked").remedy == "Ask the owner of the lock."
