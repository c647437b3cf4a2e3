"""A backup that was tampered with, damaged or made to do harm is refused as a whole, and writes nothing."""

from __future__ import annotations

import gzip
import hashlib
import json
import resource
import tarfile
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.main import main
from tests.cli.backup_site import altered, files_below, renamed, with_names


def link(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
    info = tarfile.TarInfo(name)
    if name == "state/wear.json":
        info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
    return info, content


def of_type(kind: bytes, target: str = "") -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    def change(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
        info = tarfile.TarInfo(name)
        if name == "state/wear.json":
            info.type, info.linkname = kind, target
        return info, content

    return change


def saying(**facts: object) -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    def change(name: str, content: bytes) -> tuple[tarfile.TarInfo, bytes]:
        if name == "manifest.json":
            content = json.dumps({**json.loads(content), **facts}).encode()
        return renamed(name, content)

    return change


def with_content(member: str, content: bytes) -> Callable[[str, bytes], tuple[tarfile.TarInfo, bytes]]:
    """Replace a file, also in the manifest, as somebody would who knows how."""

    def change(name: str, before: bytes) -> tuple[tarfile.TarInfo, bytes]:
        if name == "manifest.json":
            facts = json.loads(before)
            for each in facts["files"]:
                if each["name"] == member:
                    each.update(octets=len(content), sha256=hashlib.sha256(content).hexdigest())
            return renamed(name, json.dumps(facts).encode())
        return renamed(name, content if name == member else before)

    return change


BAD = {
    "is a hard link": of_type(tarfile.LNKTYPE, "manifest.json"),
    "is a device": of_type(tarfile.CHRTYPE),
    "is a pipe": of_type(tarfile.FIFOTYPE),
    "is a folder": of_type(tarfile.DIRTYPE),
    "is no file that the configuration names": with_names("state/wear.json", "config/cron.d/evil"),
    "writes to the terminal": saying(version="\x1b]0;evil\x07"),
    "has a list for a text": saying(version=["0.2.0"]),
    "has a number for a list": saying(logins=5),
    "was made at no time": saying(made="today" * 100),
    "has no whole folder": saying(folder="etc"),
    "has an endless number": saying(format=float("inf")),
    "is nested without end": lambda name, content: renamed(
        name, b"[" * 100_000 if name == "manifest.json" else content
    ),
    "climbs out of the configuration's folder": with_names("config/site.toml", "config/../../evil"),
    "climbs out of the state": with_names("state/wear.json", "state/../../evil.json"),
    "has a whole path": with_names("state/wear.json", "/tmp/evil"),
    "has a whole path below a folder": with_names("state/wear.json", "config//tmp/evil"),
    "is no file of a state": with_names("state/wear.json", "state/gateway.lock"),
    "is no file of the audit": with_names("state/wear.json", "state/audit/lock"),
    "is a link": link,
    "was changed": lambda name, content: renamed(
        name, content + b" " if name == "state/wear.json" else content
    ),
    "is missing": lambda name, content: None if name == "state/wear.json" else renamed(name, content),
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


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_half_a_backup_is_refused(
    share: float, backup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    octets = backup.read_bytes()
    backup.write_bytes(octets[: int(len(octets) * share)])

    assert main(["restore", str(backup), "--to", str(tmp_path / "new")]) == 1
    assert "is no whole backup" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_backup_of_a_later_version_is_refused_with_78(
    backup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for old, new in ((b'"format": 1', b'"format": 2'), (b'"history.db": 1', b'"history.db": 2')):
        bad = altered(
            backup,
            lambda name, content, old=old, new=new: renamed(  # type: ignore[misc]
                name, content.replace(old, new) if name == "manifest.json" else content
            ),
        )
        assert main(["restore", str(bad), "--to", str(tmp_path / "new")]) == 78

    assert not (tmp_path / "new").exists()
    assert "history.db has format 2" in capsys.readouterr().err


def test_a_state_of_a_later_version_is_refused_whatever_the_manifest_says_of_it(
    backup: Path, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = altered(backup, with_content("state/wear.json", b'{"version": 2}'))
    before = files_below(tmp_path) | {"etc/state/gateway.lock"}

    assert main(["restore", str(bad), "--replace"]) == 78

    assert "wear.json has format 2" in capsys.readouterr().err
    assert files_below(tmp_path) == before


def bomb(path: Path, header: tarfile.TarInfo, most: int) -> None:
    """Write a backup in which a file, or what stands for a name, goes on for long: zeros."""
    with gzip.open(path, "wb") as file:
        manifest = tarfile.TarInfo("manifest.json")
        manifest.size = 2
        file.write(manifest.tobuf() + b"{}".ljust(512, b"\0"))
        file.write(header.tobuf(tarfile.GNU_FORMAT))
        for _ in range(most // 2**20):
            file.write(bytes(2**20))


@pytest.mark.parametrize(
    "kind", [tarfile.REGTYPE, tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.GNUTYPE_LONGNAME]
)
def test_a_backup_that_unpacks_to_more_than_any_state_is_refused_before_it_fills_the_memory(
    kind: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    header = tarfile.TarInfo("state/wear.json")
    header.type, header.size = kind, 2**40
    bomb(tmp_path / "bomb.tar.gz", header, 64 * 2**20)
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    assert main(["restore", str(tmp_path / "bomb.tar.gz"), "--to", str(tmp_path / "new")]) == 1

    assert capsys.readouterr().err.count("\n") == 1
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < 32 * 1024
