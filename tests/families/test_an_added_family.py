"""The guide docs/adding-a-family.md, followed for an invented starter: one folder of data and one file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.errors import CommandError, ProfileError
from gateway.families.command.build import build, prepare, verbs
from gateway.families.command.interlock import check
from gateway.families.devices import device_of
from gateway.families.profile.decode import decode_points, decode_words
from gateway.families.profile.load import read_profile
from gateway.families.profile.rows import Table
from gateway.families.profile.schema import Variant
from gateway.families.profile.state import state_of
from gateway.families.reading import plan_blocks
from gateway.modbus import adu

ACME = Path(__file__).parent / "acme"
GATEWAY = Path(__file__).parents[2] / "gateway"
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
    assert [violation.code for violation in violations] == ["in_local"]


def test_its_parameters_are_set_within_the_manuals_range() -> None:
    procedure = build(PROFILE, SOFTY, "set", {"parameter": "T1", "value": 12.0}, seen={"T1": (50,)})

    assert [step.request.encode().hex(" ") for step in procedure.steps] == ["06 03 00 00 78"]


def test_without_a_procedure_of_its_own_it_is_not_configured() -> None:
    with pytest.raises(CommandError, match="no procedure of its own"):
        device_of(PROFILE).prepare_configure(PROFILE, SOFTY, {})
    with pytest.raises(CommandError, match="no procedure of its own"):
        device_of(PROFILE).build_configure(PROFILE, SOFTY, {}, seen={})


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


SITE = """
[gateway]
name = "mcc1"
[mqtt]
url = "mqtt://127.0.0.1:1883"
[[line]]
name = "pumps"
port = "/dev/ttyUSB0"
baud = 19200
framing = "8E1"
[[line.starter]]
name = "mixer"
address = 9
family = "acme"
"""

SHIPPED = """
from gateway.families.command.build import build, prepare
from gateway.families.command.interlock import check
from gateway.families.devices import device_of
from gateway.families.diagnosis.identify import identify, identify_requests, matches
from gateway.families.diagnosis.readiness import readiness, readiness_codes, refuses_start
from gateway.families.diagnosis.readiness import shortest_s
from gateway.families.profile.decode import decode_points
from gateway.families.profile.load import FAMILIES, load_profile
from gateway.families.profile.schema import Variant
from gateway.families.profile.state import state_of
from gateway.families.reading import plan_blocks
from gateway.modbus.device_id import DeviceIdentification

profile = load_profile("acme")
print("families", *FAMILIES)

print("asked", *(each.request.encode().hex() for each in identify_requests(profile)))
identity = identify(profile, {"fc43": DeviceIdentification({1: "SOFTY 30A", 2: "V2.01"})})
print("is", identity.family_seen, identity.model, identity.firmware, matches(profile, identity))
stranger = identify(load_profile("ssw07"), {"fc43": DeviceIdentification({1: "SOFTY 30A"})})
print("an ssw07 would be", stranger.family_seen)

variant = Variant(model=identity.model, firmware=identity.firmware)
blocks = plan_blocks(profile, variant)
print("polls", *(block.request.encode().hex() for block in blocks))
rows = {**blocks[0].rows_in(profile, (0b1_0010,)), **blocks[1].rows_in(profile, (125,))}
points = {name: point.value for name, point in decode_points(profile, variant, rows).items()}
print("reads", points["current"], state_of(profile, points))

settings = {"T3": (50,), "T4": (0,)}
print("looks at", *readiness_codes(profile), shortest_s(profile, variant, settings))
print("refuses", refuses_start(readiness(profile, variant, settings)))

preparation = prepare(profile, variant, "start", {})
print("may start", check(profile, preparation.requires, points) == ())
start = build(profile, variant, "start", {}, seen=rows)
print("starts", *(step.request.encode().hex() for step in start.steps), start.verify.name)
source = build(profile, variant, "set", {"parameter": "T4", "value": "Line"}, seen={**rows, **settings})
print("sets", source.is_source, *(step.request.encode().hex() for step in source.steps))
"""


def test_with_a_folder_and_a_file_it_is_a_family_like_any_other(tmp_path: Path) -> None:
    """In a copy of the gateway of which nothing else is touched: identified, read, watched and started."""
    shutil.copytree(GATEWAY, tmp_path / "gateway", ignore=shutil.ignore_patterns("__pycache__"))
    families = tmp_path / "gateway" / "families"
    shutil.copytree(
        ACME, families / "profiles" / "acme", ignore=shutil.ignore_patterns("*.py", "__pycache__")
    )
    shutil.copy(ACME / "device.py", families / "devices" / "acme.py")
    (tmp_path / "site.toml").write_text(SITE, "utf-8")

    def run(*args: str) -> str:
        env = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run([sys.executable, *args], cwd=tmp_path, env=env, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    assert run("-c", SHIPPED).splitlines() == [
        "families acme sst ssw06 ssw07 ssw900",
        "asked 2b0e0100",
        "is acme SOFTY 30A 2.01 True",
        "an ssw07 would be acme",
        "polls 0301000001 0301010001",
        "reads 12.5 ready",
        "looks at T4 T3 5.0",
        "refuses True",
        "may start True",
        "starts 050010ff00 running",
        "sets True 0500100000 0603030001 0500100000",
    ]
    assert "mixer" in run("-m", "gateway", "check", "site.toml")
