from __future__ import annotations

import pytest

from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.starters.telemetry.decoding import DecodedPoints, PointSources, is_flag, type_of, unit_of

SST, SSW07, SSW900 = load_profile("sst"), load_profile("ssw07"), load_profile("ssw900")


def test_a_row_feeds_its_points_and_those_decoded_from_them() -> None:
    fed = PointSources(SST).fed_by(["COIL7"])

    assert set(fed) == {"coil7", "remote"}


def test_a_point_of_two_rows_is_decoded_with_the_row_that_is_known() -> None:
    decoded = PointSources(SST).decode(Variant(), {"COIL7": (0,)}, known={"COIL8": (1,), "COIL9": (1,)})

    assert {name: point.value for name, point in decoded.points.items()} == {"coil7": False, "remote": False}
    assert decoded.missing == ()


def test_a_point_whose_other_row_is_not_known_is_named_as_missing() -> None:
    decoded = PointSources(SST).decode(Variant(), {"COIL7": (0,)}, known={})

    assert set(decoded.points) == {"coil7"}
    assert decoded.missing == ("remote",)


def test_rows_that_feed_nothing_decode_to_nothing() -> None:
    assert PointSources(SSW07).decode(Variant(), {"P314": (5,)}, known={}) == DecodedPoints({}, ())


@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [("running", "boolean", ""), ("current", "float", "A"), ("fault_code", "integer", "")],
)
def test_a_point_has_a_kind_and_a_unit(name: str, kind: str, unit: str) -> None:
    assert (type_of(SSW07, name), unit_of(SSW07, name)) == (kind, unit)
    assert is_flag(SSW07, name) is (kind == "boolean")


def test_a_coil_and_a_test_of_a_value_are_booleans() -> None:
    assert is_flag(SST, "coil1")
    assert is_flag(SST, "running")
    assert is_flag(SST, "remote")
    assert not is_flag(SST, "current")


def test_an_enum_and_a_text_have_kinds_of_their_own() -> None:
    enum = next(row for row in SSW900.parameters.values() if row.type == "enum")
    text = next(row for row in SSW900.parameters.values() if row.type == "string")
    point = SSW900.points["current"]
    points = {
        "mode": point.model_copy(update={"code": enum.code}),
        "name": point.model_copy(update={"code": text.code}),
    }
    profile = SSW900.model_copy(update={"points": points})

    assert type_of(profile, "mode") == "enum"
    assert type_of(profile, "name") == "string"
