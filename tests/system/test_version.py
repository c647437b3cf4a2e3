"""Between releases the version says the commit; a released one is plain."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from gateway.system.version import MARK, checkout_mark, commit_mark


def git(top: Path, *words: str) -> None:
    who = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    subprocess.run(["git", "-C", top, *who, *words], check=True, capture_output=True)


def test_a_checkout_has_its_commit_in_the_version_but_not_that_of_a_release(tmp_path: Path) -> None:
    git(tmp_path, "init")
    git(tmp_path, "commit", "--allow-empty", "-m", "one")

    assert re.fullmatch(r"\+g[0-9a-f]{7}", checkout_mark(tmp_path, "0.3.0"))
    git(tmp_path, "tag", "v0.3.0")
    assert checkout_mark(tmp_path, "0.3.0") == ""
    git(tmp_path, "commit", "--allow-empty", "-m", "two")
    assert re.fullmatch(r"\+g[0-9a-f]{7}", checkout_mark(tmp_path, "0.3.0"))


def test_the_commit_is_never_that_of_another_repository(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("here", "there"):
        git(tmp_path, "init", name)
        git(tmp_path / name, "commit", "--allow-empty", "-m", name)
    here = checkout_mark(tmp_path / "here", "0.3.0")

    monkeypatch.setenv("GIT_DIR", str(tmp_path / "there" / ".git"))  # as in a hook of that one
    assert checkout_mark(tmp_path / "here", "0.3.0") == here
    monkeypatch.delenv("GIT_DIR")

    (tmp_path / "there" / "copy" / ".git").mkdir(parents=True)
    assert checkout_mark(tmp_path / "there" / "copy", "0.3.0") == ""


def test_a_package_has_what_it_was_built_with(tmp_path: Path) -> None:
    package = tmp_path / "gateway"
    package.mkdir()
    assert commit_mark(package, "0.3.0") == ""

    (package / MARK).write_text("+g1234abc\n", "ascii")

    assert commit_mark(package, "0.3.0") == "+g1234abc"

    (package / MARK).write_bytes(b"\xff")

    assert commit_mark(package, "0.3.0") == ""
