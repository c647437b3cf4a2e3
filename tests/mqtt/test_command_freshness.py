"""Which commands are fresh enough to be acted on."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import CommandRequest, rfc3339
from gateway.mqtt.commands import Rejection
from tests.mqtt.commands import NOW, NOW_S, TOKEN, command, fresh, judge, refusal

WITHOUT_BRIDGE = 'or, without a bridge, give the operator freshness = "token"'
AGAIN = "read B/gateway/fresh and send it again with a new id"
HELD_UP = "it was held up on its way; decide again, then send again"


@pytest.mark.parametrize(
    ("fields", "is_synchronised", "code", "text"),
    [
        (
            {},
            True,
            "not_fresh",
            "neither token nor issued_at is given; send the token of B/gateway/fresh",
        ),
        (
            {"issued_at": NOW},
            False,
            "not_fresh",
            "this gateway's clock is not synchronised; send the token of B/gateway/fresh instead",
        ),
        (
            {"boot": "boot-1"},
            True,
            "not_fresh",
            "neither token nor issued_at is given; send the token of B/gateway/fresh",
        ),
        (
            {"boot": "boot-0"},
            True,
            "wrong_boot",
            f"boot is not the one in gateway/status; {AGAIN} and its token",
        ),
        (
            {"boot": "boot-0", "issued_at": NOW},
            False,
            "wrong_boot",
            f"boot is not the one in gateway/status; {AGAIN} and its token",
        ),
        (
            {"token": "another"},
            True,
            "not_fresh",
            "its token is not known: older than 60 s, or of before the gateway lost its broker or stood "
            f"still; {AGAIN}",
        ),
        (
            {"issued_at": "2026-11-21T01:01:57Z"},
            True,
            "expired",
            f"issued 6.0 s ago, valid for 5 s: {HELD_UP}",
        ),
        (
            {"token": TOKEN, "boot": "boot-0"},
            True,
            "wrong_boot",
            f"boot is not the one in gateway/status; {AGAIN} and its token",
        ),
        (
            {"issued_at": "2026-11-21T01:02:05.1Z"},
            True,
            "not_fresh",
            "issued_at is 2.1 s in the future; set the clock",
        ),
        (
            {"issued_at": "0001-01-01T00:00:00+14:00"},
            True,
            "expired",
            f"issued 63930870123.0 s ago, valid for 5 s: {HELD_UP}",
        ),
    ],
)
def test_a_command_that_is_not_provably_fresh_is_refused(
    fields: dict[str, object], is_synchronised: bool, code: str, text: str
) -> None:
    rejection = refusal(command({"id": "c1", **fields}), clock_is_synchronised=is_synchronised)

    assert (rejection.code, rejection.text) == (code, text)


def test_a_message_whose_own_expiry_has_run_out_is_expired() -> None:
    assert refusal(command(fresh(), expiry_s=0)).code == "expired"
    assert isinstance(judge(command(fresh(), expiry_s=1)), CommandRequest)


@given(
    fields=st.dictionaries(
        st.sampled_from(["id", "token", "issued_at", "ttl_s", "boot", "operator", "reason", "args", "x"]),
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text(max_size=70)
        | st.dictionaries(st.text(), st.text(), max_size=2),
    ),
    age_s=st.floats(60.001, 1e9) | st.floats(-1e9, -2.001),
    is_retained=st.booleans(),
)
def test_no_stale_or_retained_start_is_ever_accepted(
    *, fields: dict[str, object], age_s: float, is_retained: bool
) -> None:
    if fields.get("token") == TOKEN:
        fields.pop("token")
    fields["issued_at"] = rfc3339(NOW_S - age_s)

    judged = judge(command(fields, is_retained=is_retained))

    assert isinstance(judged, Rejection)
