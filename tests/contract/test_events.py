"""The table of events: each event is made of the fields that it is given."""

from __future__ import annotations

from gateway.contract import Event, EventCode, Severity, event_of, phrase


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
