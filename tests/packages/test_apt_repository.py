"""The apt repository, signed by the user's key: a fresh system installs from it, and from no other hand."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from deploy.apt_repository import KEYRING, make
from deploy.wheel import project_version
from tests.packages.built import Packages
from tests.packages.container import Container
from tests.packages.site import SYSTEMS

KEY = "plant@example.invalid"
SOURCE = """\
Types: deb
URIs: file:/srv/apt
Suites: {suite}
Components: main
Signed-By: /srv/apt/{keyring}
"""


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    if shutil.which("gpg") is None:
        pytest.skip("gpg is not installed")
    home = tmp_path / "gnupg"
    home.mkdir(mode=0o700)
    monkeypatch.setenv("GNUPGHOME", str(home))
    new = ("--passphrase", "", "--quick-generate-key", KEY, "ed25519", "sign")
    subprocess.run(["gpg", "--batch", "--quiet", *new], check=True, timeout=60.0)
    return KEY


def test_a_fresh_system_installs_from_the_signed_folder_and_refuses_what_was_changed(
    distribution: str, system: Container, packages: Packages, key: str
) -> None:
    repository = system.root / "srv" / "apt"
    make([packages.package(distribution, project_version())], repository, key)
    suite = SYSTEMS[distribution]
    system.write("/etc/apt/sources.list", "")
    system.write("/etc/apt/sources.list.d/plant.sources", SOURCE.format(suite=suite, keyring=KEYRING))

    system.run("apt-get", "update")
    system.run("apt-get", "install", "--yes", "--no-install-recommends", "starter-gateway")
    assert project_version() in system.run("starter-gateway", "--version")

    signed = repository / "dists" / suite / "InRelease"
    signed.write_text(signed.read_text("utf-8").replace("Origin: Starter", "Origin: Another"), "utf-8")
    said = system.run("sh", "-c", "apt-get update --error-on=any 2>&1", fails=True)
    assert "signature" in said
    subprocess.run(["gpgconf", "--kill", "gpg-agent"], check=False, timeout=20.0)
