"""Between releases the version says the commit; a released one is plain."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from gateway.system.version import MARK, checkout_mark, commit_mark


def commit(top: Path) -> None:
    git(top, "init")
    git(top, "commit", "--allow-empty", "-m", top.name)


def git(top: Path, *words: str) -> None:
    top.mkdir(exist_ok=True)
    who = ("-c", "user.name=x", "-c", "user.email=x@example.org")
    subprocess.run(["git", "-C", top, *who, *words], check=True, capture_output=True)


def test_a_checkout_has_its_own_commit_in_the_version_but_not_that_of_a_release(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    commit(here)
    commit(there)
    mark = checkout_mark(here, "0.3.0")

    assert re.fullmatch(r"\+g[0-9a-f]{7}", mark)
    monkeypatch.setenv("GIT_DIR", str(there / ".git"))  # as in a hook of that one
    assert checkout_mark(here, "0.3.0") == mark
    monkeypatch.delenv("GIT_DIR")
    (there / "copy" / ".git").mkdir(parents=True)
    assert checkout_mark(there / "copy", "0.3.0") == ""

    git(here, "tag", "v0.3.0")
    assert checkout_mark(here, "0.3.0") == ""
    commit(here)
    assert re.fullmatch(r"\+g[0-9a-f]{7}", checkout_mark(here, "0.3.0"))


@pytest.mark.parametrize(("mark", "shown"), [(None, ""), (b"+g1234abc\n", "+g1234abc"), (b"\xff", "")])
def test_a_package_has_what_it_was_built_with(mark: bytes | None, shown: str, tmp_path: Path) -> None:
    if mark is not None:
        (tmp_path / MARK).write_bytes(mark)

    assert commit_mark(tmp_path, "0.3.0") == shown
