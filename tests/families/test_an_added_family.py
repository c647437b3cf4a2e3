"""The guide docs/adding-a-family.md, followed for an invented starter: data alone, no line of Python."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gateway.errors import ProfileError
from gateway.families.command.build import build, prepare, verbs
from gateway.families.command.interlock import check
from gateway.families.profile.decode import decode_points, decode_words
from gateway.families.profile.load import read_profile
from gateway.families.profile.schema import Table, Variant
from gateway.families.profile.state import state_of
from gateway.families.reading.poll_blocks import plan_blocks
from gateway.modbus import adu

ACME = Path(__file__).parent / "acme"
PROFILE = read_profile(ACME)
SOFTY = Variant(model="SOFTY 30A")
READY = 0b1_0010  # remote, enabled


def test_its_few_polls_follow_from_its_points_and_limits() -> None:
    frames = [adu.encode(9, block.request.encode()).hex(" ") for block in plan_blocks(PROFILE, SOFTY)]

    assert [frame[:17] for frame in frames] == ["09 03 01 00 00 01", "09 03 01 01 00 01"]


def test_its_words_become_points_and_a_state() -> None:
    points = decode_points(PROFILE, SOFTY, {"ST": (READY | 0b101,), "M1": (125,)})

    assert points["current"].value == 12.5
    assert state_of(PROFILE, {name: point.value for name, point in points.items()}) == "starting"
    assert decode_words(PROFILE, SOFTY, Table.HOLDING, 769, (1,))["T2"]["label"] == "On"


def test_its_start_is_one_coil_and_needs_what_the_profile_requires() -> None:
    preparation = prepare(PROFILE, SOFTY, "start", {})
    procedure = build(PROFILE, SOFTY, "start", {}, seen={"ST": (READY,)})
    points = decode_points(PROFILE, SOFTY, {"ST": (READY & ~0b1_0000,)})
    violations = check(PROFILE, preparation.requires, {name: point.value for name, point in points.items()})

    assert verbs(PROFILE)[:3] == ("start", "stop", "reset")
    assert [step.request.encode().hex(" ") for step in procedure.steps] == ["05 00 10 ff 00"]
    assert [violation.rule for violation in violations] == ["remote"]


def test_its_parameters_are_set_within_the_manuals_range() -> None:
    procedure = build(PROFILE, SOFTY, "set", {"parameter": "T1", "value": 12.0}, seen={"T1": (50,)})

    assert [step.request.encode().hex(" ") for step in procedure.steps] == ["06 03 00 00 78"]


def test_every_contradiction_of_a_new_profile_is_reported_at_once(tmp_path: Path) -> None:
    broken = tmp_path / "acme"
    shutil.copytree(ACME, broken)
    toml = (broken / "family.toml").read_text("utf-8")
    toml = toml.replace('code = "M1"', 'code = "M9"').replace("coil = 17", "coil = 99")
    (broken / "family.toml").write_text(toml, "utf-8")

    with pytest.raises(ProfileError) as caught:
        read_profile(broken)

    assert len(caught.value.problems) >= 2
    assert "M9" in str(caught.value)
    assert "99" in str(caught.value)
