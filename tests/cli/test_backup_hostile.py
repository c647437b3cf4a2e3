"""A backup that was tampered with, damaged or made to do harm is refused as a whole, and writes nothing."""

from __future__ import annotations

import json
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.cli.backup_site import altered, files_below, renamed, with_names


def of_type(kind: bytes, target: str = "") -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    def change(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
        info = tarfile.TarInfo(name)
        if name == "state/state.sqlite":
            info.type, info.linkname = kind, target
        return info, content

    return change


def saying(**facts: object) -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    def change(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
        if name == "manifest.json":
            content = json.dumps({**json.loads(content), **facts}).encode()
        return renamed(name, content)

    return change


BAD = {
    "is a link": of_type(tarfile.SYMTYPE, "/etc/passwd"),
    "is a hard link": of_type(tarfile.LNKTYPE, "manifest.json"),
    "is a folder": of_type(tarfile.DIRTYPE),
    "is no file that the configuration names": with_names("state/state.sqlite", "config/cron.d/evil"),
    "has a list for a text": saying(version=["0.2.0"]),
    "has no whole folder": saying(folder="etc"),
    "climbs out of the configuration's folder": with_names("config/site.toml", "config/../../evil"),
    "has a whole path": with_names("state/state.sqlite", "/tmp/evil"),
    "is no file of a state": with_names("state/state.sqlite", "state/gateway.lock"),
    "was changed": lambda name, content: renamed(
        name, content + b" " if name == "state/state.sqlite" else content
    ),
    "is missing": lambda name, content: None if name == "state/state.sqlite" else renamed(name, content),
    "has no manifest": lambda name, content: None if name == "manifest.json" else renamed(name, content),
    "has a damaged manifest": lambda name, content: renamed(
        name, b"{}" if name == "manifest.json" else content
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_a_backup_that_was_tampered_with_writes_nothing(
    what: str, backup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = files_below(tmp_path) | {"altered.tar.gz"}

    assert main(["restore", str(altered(backup, BAD[what])), "--to", str(tmp_path / "new")]) == 1

    assert files_below(tmp_path) == before
    assert capsys.readouterr().err.count("\n") == 1


def test_a_backup_of_a_later_version_is_refused_with_78(
    backup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for old, new in ((b'"format": 1', b'"format": 2'), (b'"history.sqlite": 1', b'"history.sqlite": 2')):
        bad = altered(
            backup,
            lambda name, content, old=old, new=new: renamed(  # type: ignore[misc]
                name, content.replace(old, new) if name == "manifest.json" else content
            ),
        )
        assert main(["restore", str(bad), "--to", str(tmp_path / "new")]) == 78

    assert not (tmp_path / "new").exists()
    assert "was made by a later version" in capsys.readouterr().err
