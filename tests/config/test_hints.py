"""What is offered where a line cannot keep the watchdogs of its starters."""

from __future__ import annotations

import re

import pytest

from gateway.app.capacity import hint_of
from gateway.config.schema import LineTable


@pytest.mark.parametrize(
    ("count", "starter", "baud", "hint"),
    [
        (7, {"family": "ssw07", "watchdog_s": 1.0}, 9600,
         "baud = 19200, or 2 of its 7 starters on another line, or no watchdog below 2 s"),
        (10, {"family": "ssw06", "watchdog_s": 1.0}, 38400, "(?!.*baud).*"),  # the family has no faster rate
        (247, {"family": "sst", "watchdog_s": 255.0, "response_time_s": 10.0}, 1200,
         "[0-9]+ of its 247 starters on another line"),
    ],
)  # fmt: skip
def test_every_single_change_that_helps_is_offered(
    count: int, starter: dict[str, object], baud: int, hint: str
) -> None:
    starters = [{"name": f"s{at}", "address": at, **starter} for at in range(1, count + 1)]
    table = {"name": "pumps", "port": "/dev/a", "baud": baud, "framing": "8N2", "starter": starters}

    assert re.fullmatch(hint, hint_of(LineTable.model_validate(table)))
