"""The commit of a program that is between two releases, as its version shows it: `0.3.0+g1234abc`."""

from __future__ import annotations

import subprocess
from pathlib import Path

MARK = "commit.txt"  # what a package that was built from a git checkout has in place of git


def commit_mark(package: Path, version: str) -> str:
    """Return `+g` and the commit of a package; empty for a released version, or where that is not known."""
    try:
        return (package / MARK).read_text("ascii").strip()
    except (OSError, ValueError):
        return checkout_mark(package.parent, version)


def checkout_mark(top: Path, version: str) -> str:
    """Return the same for a git checkout; its release has the tag `v` and the version."""
    if not (top / ".git").exists():
        return ""
    # Named, so that neither GIT_DIR (set in a hook) nor a repository around this one answers in its place.
    describe = (
        "git",
        f"--git-dir={top / '.git'}",
        "describe",
        "--tags",
        "--always",
        "--abbrev=7",
        "--match",
        f"v{version}",
    )
    try:
        said = subprocess.run(describe, capture_output=True, check=True, text=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
    return "" if said == f"v{version}" else f"+g{said.rpartition('-g')[2]}"
