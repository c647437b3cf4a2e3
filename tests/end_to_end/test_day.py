"""The recorded day, whole (`tests/rig/day.py`): in virtual time, but too long for `make test`."""

from __future__ import annotations

import pytest

from tests.rig.day import day, differences, recorded


@pytest.mark.long
@pytest.mark.timeout(1200)
def test_a_day_publishes_what_is_recorded() -> None:
    assert differences(recorded(), day()) == ""
