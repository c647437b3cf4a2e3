"""Packages for the tests: the one that is shipped, and later versions that differ in what a test is about."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from deploy.deb.build import LIBRARY, lay_out, pack
from deploy.deb.targets import DISTRIBUTIONS
from deploy.wheel import DOCS, UPLOT, build_wheel, project_version

GATEWAY = LIBRARY / "site-packages" / "gateway"
Change = Callable[[Path], None]  # of the program's folder


def need_built() -> None:
    """Skip the test where the parts that other programs make are not there."""
    if not (DOCS / "index.html").exists() or not UPLOT.exists():
        pytest.skip("not built: the documentation or uPlot (make test-deb builds them)")


class Packages:
    """Builds in a folder, each thing once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.wheel = cache(lambda: build_wheel(folder / "wheel"))
        self.tree = cache(self._tree)
        self.package = cache(self._package)

    def _package(
        self, distribution: str, version: str, change: Change | None = None, architecture: str = "amd64"
    ) -> Path:
        """Return the package of a version."""
        tree, out = self.tree(distribution, architecture), self._folder / "out"
        if change is not None:
            out = self._folder / change.__name__
            changed = out / f"{distribution}-{version}"
            shutil.copytree(tree, changed, symlinks=True, copy_function=shutil.copy2)
            shipped = f'__version__ = "{project_version()}"'
            replace(changed / GATEWAY / "__init__.py", shipped, f'__version__ = "{version}"')
            change(changed / GATEWAY)
            tree = changed
        target = DISTRIBUTIONS[distribution]
        return pack(tree, out, target, architecture, version)

    def _tree(self, distribution: str, architecture: str) -> Path:
        tree = self._folder / f"{distribution}-{architecture}-tree"
        lay_out(tree, self.wheel(), DISTRIBUTIONS[distribution], architecture)
        return tree


def replace(path: Path, old: str, new: str) -> None:
    """Replace a text that is there once."""
    text = path.read_text("utf-8")
    assert text.count(old) == 1, f"{path}: {old!r}"
    path.write_text(text.replace(old, new), "utf-8")


def only_the_version(gateway: Path) -> None:
    """Change nothing else."""


def without_spanish(gateway: Path) -> None:
    """Take a language away, so that a configuration with it is refused."""
    replace(
        gateway / "config" / "site_tables.py",
        "Language = Literal[LANGUAGES]",
        'Language = Literal["en", "pt"]',
    )


def slow_to_restart(gateway: Path) -> None:
    """Let `check` answer that a restart outlasts a starter's watchdog."""
    old = "code = _load(args.command).run(args)"
    replace(gateway / "cli" / "main.py", old, f'{old} if args.command != "check" else 75')
