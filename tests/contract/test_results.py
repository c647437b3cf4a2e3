"""The table of results: each result is made of the fields that it is given."""

from __future__ import annotations

from gateway.contract import Note, Reason, ResultCode, meaning_of


def test_a_reason_and_what_is_added_make_one_text() -> None:
    reason = Reason(ResultCode.SELECTION_EXPIRED, valid_s=10.0).noted(Note("nothing_written"), None)

    assert reason.text == "the selection is more than 10 s old; select again; nothing was written"
    assert reason.code == "selection_expired"
    assert reason.noted() == reason != Reason(ResultCode.EXPIRED, "message")


def test_an_exception_that_no_manual_names_has_its_number_in_the_code() -> None:
    assert Reason(ResultCode.EXCEPTION, "write", number=77).code == "exception_77"
    assert meaning_of("exception_77").remedy == "See its manual."
    assert meaning_of("locked").remedy == "Ask the owner of the lock."
