"""What several files of tests of the commands need."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.cli.backup_site import build_site


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Return a configuration with a secret, a file of another folder, and the state of a gateway."""
    return build_site(tmp_path)


@pytest.fixture
def backup(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """Return a backup of that, without secrets."""
    assert main(["backup", str(site), str(tmp_path / "plant.tar.gz")]) == 0
    capsys.readouterr()
    return tmp_path / "plant.tar.gz"
