"""What several files of tests of the commands need."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.backup_site import BackupSite


@pytest.fixture
def place(tmp_path: Path) -> BackupSite:
    """Return a configuration with a secret, a file of another folder, and the state of a gateway."""
    return BackupSite(tmp_path)


@pytest.fixture
def backup(place: BackupSite) -> Path:
    """Return a backup of that, without secrets."""
    place.cli("backup SITE DIR/plant.tar.gz")
    return place.folder / "plant.tar.gz"
