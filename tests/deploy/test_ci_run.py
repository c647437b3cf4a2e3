"""What the CI runs: everything once, as an ordinary user; as root only what needs root."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

RUN = Path(__file__).parents[2] / ".ci" / "run"

_COMMANDS = {
    "make": '[ "${FAILS:-}" != "$WHO" ]',
    "useradd": ":",
    "userdel": ":",
    "chown": ":",
    "runuser": 'while [ $1 != -- ]; do shift; done; shift; WHO=ordinary exec "$@"',
}


def run(tmp_path: Path, *, user: int, fails: str = "") -> tuple[int, list[str]]:
    """Run a copy of the script with commands that only note what they are asked."""
    tree, bin_, notes = tmp_path / "tree", tmp_path / "bin", tmp_path / "notes"
    (tree / ".ci").mkdir(parents=True)
    bin_.mkdir()
    notes.touch()
    shutil.copy(RUN, tree / ".ci" / "run")
    for name, then in {**_COMMANDS, "id": f"echo {user}"}.items():
        note = "" if name == "id" else f'echo "$WHO: {name} $*" >> {notes}\n'
        (bin_ / name).write_text(f"#!/bin/bash\n{note}{then}\n", "utf-8")
        (bin_ / name).chmod(0o755)
    environ = {**os.environ, "PATH": f"{bin_}:{os.environ['PATH']}", "WHO": "caller", "FAILS": fails}
    done = subprocess.run(
        [tree / ".ci" / "run"], env=environ, check=False, timeout=60.0, stdout=subprocess.DEVNULL
    )
    return done.returncode, notes.read_text("utf-8").splitlines()


def test_an_ordinary_user_tests_once(tmp_path: Path) -> None:
    assert run(tmp_path, user=1000) == (0, ["caller: make test e2e"])


def test_root_lets_an_ordinary_user_test_everything_and_does_only_what_needs_root(tmp_path: Path) -> None:
    code, notes = run(tmp_path, user=0)

    (home,) = [note.split("--directory ")[1].split("/tree")[0] for note in notes if "ordinary: make" in note]
    done = [note.split(": ")[1].split(" -")[0] for note in notes]
    assert code == 0
    assert done[:-1] == ["make programs", "useradd", "chown", "runuser", "make", "make test-root"]
    assert done[-1].startswith("userdel ")
    assert f"ordinary: make --directory {home}/tree test e2e" in notes
    assert not Path(home).exists()


@pytest.mark.parametrize("fails", ["caller", "ordinary"])
def test_a_failure_of_either_is_the_runs(tmp_path: Path, fails: str) -> None:
    code, notes = run(tmp_path, user=0, fails=fails)

    assert code != 0
    assert "caller: make test-root" not in notes
