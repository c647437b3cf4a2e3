"""Programs that some tests need: where one is not installed they are skipped by name, and fail in CI."""

from __future__ import annotations

import os
import shutil
from typing import NoReturn

import pytest


def program(name: str, package: str = "") -> str:
    """Return the path of a program of a Debian package, by default of its own name."""
    return shutil.which(name) or without(name, package or name)


def without(names: str, packages: str) -> NoReturn:
    """End the test: these programs are not there."""
    text = f"not installed: {names} (apt-get install {packages})"
    if os.environ.get("CI") == "true":
        pytest.fail(text)
    pytest.skip(text)
