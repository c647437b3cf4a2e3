"""Rules of the manuals about rows, judged by the profiles (W-07, W-08, S9-09, S9-10)."""

from __future__ import annotations

import pytest

from gateway.families.profile.load import load_profile
from gateway.families.profile.rows import Table

SSW900 = load_profile("ssw900")
ROWS = SSW900.parameters


@pytest.mark.parametrize("family", ["ssw06", "ssw07"])
def test_w_07_parameter_nnn_is_register_nnn_and_vbnn_is_5000_and_nn(family: str) -> None:
    for row in load_profile(family).parameters.values():
        if row.table is Table.HOLDING:
            first = 5000 if row.code.startswith("VB") else 0
            assert row.address == first + int(row.code.lstrip("PVB"))


def test_s9_10_the_property_stopped_is_known_for_the_communication_menu_only() -> None:
    known = {row.code.split(".")[0] for row in ROWS.values() if row.is_stopped_only is not None}

    assert known == {"C8"}


def test_s9_09_the_mapping_is_set_at_standstill_except_the_update_delay() -> None:
    mapping = {code for code in ROWS if code.startswith(("C8.1.1.", "C8.1.2."))}

    assert {code for code in mapping if ROWS[code].is_stopped_only} == mapping - {"C8.1.2.5"}
