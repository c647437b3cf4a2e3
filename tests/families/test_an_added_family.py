"""The guide docs/adding-a-family.md, followed for an invented starter: one folder of data and one file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.contract import CommandError
from gateway.families.devices import device_of
from gateway.families.profile.load import read_profile
from gateway.families.profile.schema import Variant
from tests.rig.sites import line, starter, table

ACME = Path(__file__).parent / "acme"
GATEWAY = Path(__file__).parents[2] / "gateway"
PROFILE = read_profile(ACME)
SOFTY = Variant(model="SOFTY 30A")


def test_without_a_procedure_of_its_own_it_is_not_configured() -> None:
    with pytest.raises(CommandError, match="no procedure of its own"):
        device_of(PROFILE).prepare_configure(PROFILE, SOFTY, {})
    with pytest.raises(CommandError, match="no procedure of its own"):
        device_of(PROFILE).build_configure(PROFILE, SOFTY, {}, seen={})


HEAD = table("gateway", name="mcc1") + table("mqtt", url="mqtt://127.0.0.1")
SITE = HEAD + line(framing="8E1") + starter("mixer", 9, "acme")
SHIPPED = """
from gateway.families.command.procedures import build, prepare
from gateway.families.command.interlock import check
from gateway.families.devices import device_of
from gateway.families.diagnosis.identification import identify, identify_requests, matches
from gateway.families.diagnosis.readiness_check import readiness, readiness_codes, refuses_start
from gateway.families.diagnosis.readiness_check import shortest_s
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
rows = {blocks[0].codes[0]: (0b1_0010,), blocks[1].codes[0]: (125,)}
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
    shutil.copytree(GATEWAY, tmp_path / "gateway")  # with its compiled modules
    families = tmp_path / "gateway" / "families"
    shutil.copytree(
        ACME, families / "profiles" / "acme", ignore=shutil.ignore_patterns("*.py", "__pycache__")
    )
    shutil.copy(ACME / "device.py", families / "devices" / "acme.py")
    (tmp_path / "site.toml").write_text(SITE, "utf-8")

    def run(*args: str) -> str:
        env = {**os.environ, "PYTHONPATH": str(tmp_path)}
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
