"""Whatever is commanded in whatever order: no motor starts without a start, none stops by a stray write.

2,000 commands a family.
"""

from __future__ import annotations

import pytest

from gateway.families.profile.load import FAMILIES
from tests.rules.random_commands import SERIAL_IN_LOCAL, send_at_random

COMMANDS = 2_000


@pytest.mark.parametrize("keeps_run_command", [False, True])
@pytest.mark.parametrize("family", FAMILIES)
def test_no_random_sequence_of_commands_starts_a_motor_unasked_or_stops_one_by_a_stray_write(
    family: str, *, keeps_run_command: bool
) -> None:
    ends = send_at_random(family, COMMANDS // 2, keeps_run_command=keeps_run_command)

    assert ends["start confirmed"] > COMMANDS / 200
    assert ends["stop confirmed"] > COMMANDS / 200
    assert "start confirmed in local" not in ends


@pytest.mark.parametrize("family", SERIAL_IN_LOCAL)
def test_nor_does_one_where_the_starter_obeys_the_line_in_local_mode(family: str) -> None:
    ends = send_at_random(family, COMMANDS // 2, keeps_run_command=True, obeys_in_local=True)

    assert ends["start confirmed in local"] > 0
    assert ends["stop confirmed in local"] > 0
