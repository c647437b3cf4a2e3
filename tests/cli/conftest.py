"""What several files of tests of the commands need."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.cli.backup_site import build_site
from tests.cli.parameters_place import RUNNERS
from tests.virtual_time import VirtualTimeLoop


@pytest.fixture
def one_loop() -> Iterator[None]:
    """Let all commands of a test run on one loop, since a starter's life has one clock."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        RUNNERS.append(runner)
        yield
        RUNNERS.clear()


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
