from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.packages.built import Packages, need_built
from tests.packages.container import Container, why_not
from tests.packages.site import SYSTEMS


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Packages:
    need_built()
    return Packages(tmp_path_factory.mktemp("packages"))


@pytest.fixture(params=SYSTEMS)
def distribution(request: pytest.FixtureRequest) -> str:
    name = str(request.param)
    if reason := why_not(SYSTEMS[name]):
        pytest.skip(f"no fresh system of Debian: {reason}")
    return name


@pytest.fixture
def system(distribution: str, tmp_path: Path) -> Iterator[Container]:
    with Container(SYSTEMS[distribution], tmp_path) as container:
        yield container
