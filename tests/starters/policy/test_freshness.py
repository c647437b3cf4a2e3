"""No date that is too old or too far ahead proves a command, whatever else the command carries."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.contract import MAX_TTL_S, CommandError, CommandRequest
from gateway.starters.policy.freshness import (
    BY_ISSUED_AT,
    BY_TOKEN,
    MAX_AHEAD_S,
    ArrivalTime,
    Tokens,
    dated,
)

UTC_S = 1_795_222_923.0


@given(
    token=st.none() | st.text(max_size=20),
    boot=st.sampled_from([None, "boot-1", "boot-0"]),
    ttl_s=st.floats(0.0, MAX_TTL_S, exclude_min=True),
    age_s=st.floats(MAX_TTL_S + 0.001, 1e9) | st.floats(-1e9, -MAX_AHEAD_S - 0.001),
    freshness=st.sampled_from([(BY_TOKEN,), (BY_ISSUED_AT,), (BY_TOKEN, BY_ISSUED_AT)]),
    doubt=st.sampled_from([None, "this gateway's clock is not synchronised"]),
)
def test_no_start_of_another_time_is_ever_fresh(
    token: str | None,
    boot: str | None,
    ttl_s: float,
    age_s: float,
    freshness: tuple[str, ...],
    doubt: str | None,
) -> None:
    tokens = Tokens("boot-1")
    tokens.issue(7.0)
    start = CommandRequest(
        "pump", "alice", "start", id="1", token=token, issued_s=UTC_S - age_s, boot=boot, ttl_s=ttl_s
    )

    with pytest.raises(CommandError) as caught:
        dated(start, freshness=freshness, tokens=tokens, moment=ArrivalTime(7.0, UTC_S, doubt))
    assert caught.value.code in ("expired", "not_fresh", "wrong_boot")
