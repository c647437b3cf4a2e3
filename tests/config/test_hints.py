"""What is offered where a line cannot keep the watchdogs of its starters."""

from __future__ import annotations

from gateway.app.capacity import hint_of
from gateway.config.schema import LineTable


def line(*starters: tuple[str, float], baud: int = 19200, allowance_s: float = 0.02) -> LineTable:
    return LineTable.model_validate(
        {
            "name": "pumps",
            "port": "/dev/a",
            "baud": baud,
            "framing": "8E1",
            "adapter_allowance_s": allowance_s,
            "starter": [
                {"name": f"s{at}", "address": at, "family": family, "watchdog_s": watchdog_s}
                for at, (family, watchdog_s) in enumerate(starters, 1)
            ],
        }
    )


def test_every_single_change_that_helps_is_reported() -> None:
    hint = hint_of(line(*[("ssw07", 1.0)] * 7, baud=9600))

    assert hint == "baud = 19200, or 2 of its 7 starters on another line, or no watchdog below 2 s"


def test_a_rate_that_a_family_does_not_have_is_not_offered() -> None:
    assert "baud" not in hint_of(line(*[("ssw06", 1.0)] * 10, baud=38400))


def test_where_no_watchdog_is_long_enough_only_fewer_starters_help() -> None:
    starters = [
        {"name": f"s{at}", "address": at, "family": "sst", "watchdog_s": 255.0} for at in range(1, 248)
    ]
    table = {"name": "pumps", "port": "/dev/a", "baud": 1200, "framing": "8N2"}
    slow = [{**starter, "response_time_s": 10.0} for starter in starters]

    hint = hint_of(LineTable.model_validate({**table, "starter": slow}))

    assert hint.endswith(" of its 247 starters on another line")
