"""What the gateway has stored of a starter counts for the commands that go to its port directly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gateway.cli.parameters.restore import identity_trouble
from gateway.errors import CommandError
from gateway.families.devices.device import Identity
from gateway.families.devices.findings import Weight
from gateway.families.profile.load import load_profile
from gateway.families.profile.schema import Variant
from gateway.sim.factory import make_unit
from gateway.starters.setup import StarterSetup
from tests.cli.doctor_site import examine, site
from tests.cli.parameters_place import ParametersPlace

SETUP = StarterSetup("pump", "pumps", 1, load_profile("ssw07"), Variant())
SEEN = Identity(family_seen="ssw07", model="SSW-07 85.0A", firmware="1.40", rated_current_a=85.0)


def stored(folder: Path, name: str = "pump", **fields: str) -> Path:
    (folder / "identities.json").write_text(json.dumps({"starters": {name: fields}}), "utf-8")
    return folder


def test_the_starter_that_is_known_and_one_that_was_never_seen_are_no_trouble(tmp_path: Path) -> None:
    assert identity_trouble(tmp_path, SETUP, SEEN) == ""
    assert identity_trouble(stored(tmp_path, model="SSW-07 85.0A", firmware="1.40"), SETUP, SEEN) == ""


def test_another_one_is_reported_with_the_difference(tmp_path: Path) -> None:
    trouble = identity_trouble(stored(tmp_path, firmware="1.30"), SETUP, SEEN)

    assert "firmware was 1.30, is 1.40" in trouble
    assert "send accept" in trouble


def test_what_cannot_be_read_is_trouble(tmp_path: Path) -> None:
    (tmp_path / "identities.json").write_text("[", "utf-8")

    assert "is unknown" in identity_trouble(tmp_path, SETUP, SEEN)


@pytest.mark.usefixtures("one_loop")
def test_nothing_is_restored_to_another_starter_than_the_gateway_knows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = ParametersPlace(make_unit("ssw07", 1))
    place.state_dir = stored(tmp_path, firmware="1.30")

    with pytest.raises(CommandError, match="another starter than before") as refused:
        place.restore({"P314": 3})
    assert refused.value.code == "identity_changed"
    assert place.restore({"P314": 3}, is_dry=True) == 0
    assert "would be refused: another starter" in capsys.readouterr().out
    assert place.written == []

    place.state_dir = stored(tmp_path, firmware="1.40")
    assert place.restore({"P314": 3}) == 0


def test_doctor_reports_that_commands_would_be_held(tmp_path: Path) -> None:
    stored(tmp_path, "pump-1", firmware="1.30")

    remarks = examine(site(), make_unit("ssw07", 1), state_dir=tmp_path)

    held = [remark for remark in remarks if "commands would be held" in remark.text]
    assert [(remark.where, remark.weight) for remark in held] == [("starter pump-1", Weight.ERROR)]
