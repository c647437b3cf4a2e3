"""What becomes of a kit's folder and of its certificates: written once, again, and by a hurried engineer."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.broker_kit.settings import KitSettings
from gateway.cli.main import main
from tests.config.sites import changed

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not here")

Kit = Callable[..., int]
NAMED = ('url = "mqtts://broker.plant:8883"', 'url = "mqtts://broker.plant:8883"\nusername = "mcc1"')


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "site.toml"
    path.write_text(changed(NAMED), "utf-8")
    return path


@pytest.fixture
def kit(config_file: Path, tmp_path: Path) -> Kit:
    """Return the command, for the folder `kit`."""
    return lambda *options, folder="kit": main(
        ["broker-kit", str(config_file), str(tmp_path / folder), *options]
    )


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def given(folder: Path, key: str = "broker.key") -> list[str]:
    """Return the options that give the certificates of another kit to this one."""
    return ["--ca", str(folder / "ca.pem"), "--cert", str(folder / "broker.pem"), "--key", str(folder / key)]


@pytest.mark.parametrize("option", [(), ("--force",)])
def test_a_folder_with_other_things_in_it_is_left_alone(
    kit: Kit, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, ...]
) -> None:
    (tmp_path / "kit/logins").mkdir(parents=True)
    (tmp_path / "kit/logins/bank").write_text("precious", "utf-8")
    (tmp_path / "kit/mosquitto.conf").write_text("the machine's own", "utf-8")
    before = contents(tmp_path / "kit")

    assert kit(*option) == 2

    assert "holds no kit, but logins" in capsys.readouterr().err
    assert contents(tmp_path / "kit") == before


def test_the_plants_certificates_are_taken_where_they_fit_together_and_are_for_this_broker(
    kit: Kit, config_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert kit(folder="plant") == 0
    config_file.write_text(changed(NAMED).replace("broker.plant", "other.plant"), "utf-8")
    assert kit(folder="other") == 0
    config_file.write_text(changed(NAMED), "utf-8")
    assert kit() == 0
    before = contents(tmp_path / "kit")
    capsys.readouterr()

    assert kit("--update", *given(tmp_path / "other")) == 2
    assert "--cert is not for broker.plant" in capsys.readouterr().err
    assert kit("--update", *given(tmp_path / "plant", "../other/broker.key")) == 2
    assert "do not fit together: " in capsys.readouterr().err
    (tmp_path / "plant" / "ca.pem").write_bytes((tmp_path / "other" / "ca.pem").read_bytes())
    assert kit("--update", *given(tmp_path / "plant")) == 2
    assert "do not fit together: " in capsys.readouterr().err
    assert kit("--update", "--bridge-ca", str(config_file), "--bridge", "central") == 2
    assert contents(tmp_path / "kit") == before

    assert kit(folder="again") == 0
    assert kit(*given(tmp_path / "again"), folder="third") == 0
    assert not (tmp_path / "third" / "ca.key").exists()
    assert contents(tmp_path / "third")["broker.pem"] == contents(tmp_path / "again")["broker.pem"]
    assert "certificate is valid until" in capsys.readouterr().out


def test_without_the_authoritys_key_the_certificate_stays_and_must_do(
    kit: Kit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert kit() == 0
    (tmp_path / "kit/ca.key").unlink()
    before = (tmp_path / "kit/broker.pem").read_bytes()

    assert kit("--update", "--viewer", "panel") == 0
    assert (tmp_path / "kit/broker.pem").read_bytes() == before
    capsys.readouterr()

    assert kit("--update", "--host", "new.plant") == 2
    assert "no certificate here is for new.plant (fetch ca.key back" in capsys.readouterr().err


def test_an_update_takes_away_what_an_empty_option_names(kit: Kit, tmp_path: Path) -> None:
    assert kit(folder="plant") == 0
    authority = str(tmp_path / "plant" / "ca.pem")
    assert kit("--bridge", "central", "--bridge-ca", authority, "--login", "two=alice") == 0
    assert kit("--update") == 0
    assert (tmp_path / "kit/central-ca.pem").exists()
    assert "bridge_cafile" in (tmp_path / "kit/bridge.conf").read_text("utf-8")

    assert kit("--update", "--bridge", "", "--login", "", "--auditor", "") == 0

    left = contents(tmp_path / "kit")
    assert [name for name in left if "bridge" in name or "central" in name] == []
    assert sorted(name for name in left if "/" in name) == [
        "logins/alice",
        "logins/mcc1",
        "logins/prover",
        "logins/viewer",
    ]
    assert KitSettings.read(tmp_path / "kit").bridge == ""


def test_a_second_gateway_at_the_broker_takes_the_passwords_and_the_authority_of_the_first(
    kit: Kit, config_file: Path, tmp_path: Path
) -> None:
    assert kit(folder="one") == 0
    config_file.write_text(changed(NAMED).replace("mcc1", "mcc2"), "utf-8")

    assert kit("--like", str(tmp_path / "one"), folder="two") == 0

    one, two = contents(tmp_path / "one"), contents(tmp_path / "two")
    assert {name for name in one if name.startswith("logins/") and one[name] == two.get(name)} == {
        "logins/alice",
        "logins/auditor",
        "logins/prover",
        "logins/viewer",
    }
    assert "logins/mcc2" in two
    assert two["ca.pem"] == one["ca.pem"]
    assert kit("--like", str(tmp_path / "none"), folder="three") == 2
