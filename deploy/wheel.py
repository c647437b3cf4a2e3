"""Builds the wheel, with documentation, page and deploy kit: `python -m deploy.wheel FOLDER`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from gateway.system.version import MARK, checkout_mark

TOP = Path(__file__).parents[1]
DOCS = TOP / "gateway" / "docs_site"  # of `make site`
UPLOT = TOP / "gateway" / "plugins" / "web" / "static" / "vendor" / "uPlot.iife.min.js"  # of `make web`
BACKEND = TOP / "deploy" / "backend"
_LEFT_OUT = (  # what only builders need
    *("__pycache__", "backend", "deb", "get-*.sh", "npm", "oci", "progress.sh", "demo.lock"),
    *("apt_repository.py", "libraries.py", "licences", "wheel.py"),
)


def project_version() -> str:
    """Return the version of the program."""
    (version,) = re.findall(r'^__version__ = "(.+)"$', (TOP / "gateway/__init__.py").read_text("utf-8"), re.M)
    return str(version)


@cache
def commit_time() -> int:
    """Return when the last commit was made, in seconds since 1970; without git, of the last release."""
    command = ["git", "-C", str(TOP), "log", "-1", "--format=%ct"]
    try:
        return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    except (OSError, subprocess.CalledProcessError, ValueError):
        days = re.findall(r"^## \[[\d.]+\] - ([\d-]+)$", (TOP / "CHANGELOG.md").read_text("utf-8"), re.M)
        return int(datetime.fromisoformat(days[0]).replace(tzinfo=UTC).timestamp())


def builders_environ() -> dict[str, str]:
    """Return the environment of a program that builds: what it makes is the same for every builder.

    The time is the last commit's; the width of the terminal is the manual page's.
    """
    same = {"COLUMNS": "80", "LC_ALL": "C.UTF-8", "TZ": "UTC", "PYTHONHASHSEED": "0"}
    return {**os.environ, **same, "SOURCE_DATE_EPOCH": str(commit_time())}


def build_wheel(out: Path) -> Path:
    """Build the wheel from a copy of the tree, so that nothing left over gets into it; return its path."""
    for needed, target in ((DOCS / "index.html", "make site"), (UPLOT, "make web")):
        if not needed.exists():
            raise FileNotFoundError(f"{needed} is not here: {target}")
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(TOP / "gateway", tree / "gateway", ignore=shutil.ignore_patterns("__pycache__"))
        mark = checkout_mark(TOP, project_version())
        (tree / "gateway" / MARK).write_text(f"{mark}\n", "ascii")
        kit = tree / "gateway" / "deploy_kit"
        shutil.copytree(TOP / "deploy", kit, ignore=shutil.ignore_patterns(*_LEFT_OUT))
        shutil.copytree(TOP / "config", kit / "config")
        shutil.copytree(BACKEND, tree / BACKEND.relative_to(TOP))
        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copyfile(TOP / name, tree / name)
        _same_modes(tree)
        command = [
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
        ]
        subprocess.run(
            [*command, "--wheel-dir", str(out), str(tree)], check=True, env=builders_environ(), umask=0o022
        )
    (wheel,) = out.glob(f"starter_gateway-{project_version()}-*.whl")
    return wheel


def _same_modes(tree: Path) -> None:
    """Give files the modes that they have in git, whatever the umask of who checked them out."""
    for path in tree.rglob("*"):
        path.chmod(0o755 if path.is_dir() or path.stat().st_mode & 0o100 else 0o644)


if __name__ == "__main__":
    print(build_wheel(Path(sys.argv[1]) if len(sys.argv) > 1 else TOP / "dist"))
