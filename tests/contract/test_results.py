"""The table of results: each result is made of the fields that it is given."""

from __future__ import annotations

import pytest

from gateway.contract import Note, Reason, ResultCode, meaning_of


@pytest.mark.parametrize(
    ("code", "case", "fields"),
    [
        (ResultCode.EXPIRED, "token", {"age_s": 7.3, "ttl_s": 5.0, "client": "alice"}),
        (ResultCode.EXPIRED, "token", {"age_s": 7.3}),
        (ResultCode.EXPIRED, "tokens", {"age_s": 7.3, "ttl_s": 5.0}),
        (ResultCode.EXPIRED, "", {}),
    ],
)
def test_what_does_not_fit_the_table_is_an_error(
    code: ResultCode, case: str, fields: dict[str, object]
) -> None:
    with pytest.raises(ValueError, match=r"results\.toml"):
        Reason(code, case, **fields)


def test_a_reason_and_what_is_added_make_one_text() -> None:
    reason = Reason(ResultCode.EXPIRED, "waiting", age_s=7.26).noted(Note("nothing_written"), None)

    assert reason.text == "the command arrived 7.3 s ago and is no longer valid; nothing was written"
    assert reason.code == "expired"
    assert reason.noted() == reason != Reason(ResultCode.EXPIRED, "message")


def test_an_exception_that_no_manual_names_has_its_number_in_the_code() -> None:
    assert Reason(ResultCode.EXCEPTION, "write", number=77).code == "exception_77"
    assert meaning_of("exception_77").remedy == "See its manual."
    assert meaning_of("locked").remedy == "Ask the owner of the lock."
