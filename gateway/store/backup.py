"""A backup: a tar, compressed, that begins with a manifest of everything in it; and the upgrade of the files.

Databases are copied while a gateway may be writing them, each as it was at one moment. Only regular files
whose names stand in the manifest are ever read from a backup, and none is unpacked by the name that a tar
gives it: the caller says where each goes. A file that does not fit its SHA-256 is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from pydantic import BaseModel, ConfigDict

from gateway.errors import DamagedError, NewerError, StoreError
from gateway.store.database import copy_file, stored_version, translated, write_file
from gateway.store.import_0_2 import files_of_0_2, import_files, is_file_of_0_2, is_import_due
from gateway.store.schema import SCHEMAS
from gateway.system.instance_lock import FILE
from gateway.system.whole_files import NEW, private, put_in_place, sync_file

if TYPE_CHECKING:  # imported where a backup is made or read: the service hardly ever does
    import tarfile

# Also SQLite's journals, the reserve, and new and damaged files.
OWN_NAMES = re.compile(rf"({'|'.join(map(re.escape, (*SCHEMAS, FILE)))})([.-].*)?")

FORMAT = 1
MANIFEST = "manifest.json"
PACKING = 1  # gzip's fastest: an upgrade makes a backup while the starters wait


class Manifest(BaseModel):
    """The description of a backup, which begins with it."""

    model_config = ConfigDict(strict=True)

    format: int = FORMAT  # every version can read this and the next
    version: str  # of the gateway that made it
    made: str
    gateway: str
    config: str  # the configuration's name
    folder: str  # where that was
    state_dir: str
    has_secrets: bool
    left_out: list[str]  # files
    logins: list[str]  # whose passwords were left out
    state: dict[str, int]  # the version of each file of the state
    files: dict[str, str] = {}  # SHA-256 by name, in the order of the tar


class Member(NamedTuple):
    """A file to go into a backup: its name there, its content, and whose owner and mode are remembered."""

    name: str
    content: Path
    like: Path


class Archive(NamedTuple):
    """A backup that was verified, open; see `open_archive`."""

    manifest: Manifest
    tar: tarfile.TarFile

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        return _opened(self.tar, self.tar.getmember(name)).read()

    def extract(self, name: str, path: Path) -> None:
        """Write the content of a file to a new one, for its owner alone; it is on the disk then. OSError."""
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with open(path, "wb", opener=_fresh) as file:
            shutil.copyfileobj(_opened(self.tar, self.tar.getmember(name)), file)
        sync_file(path)

    def rights(self, name: str) -> tuple[int, str, str]:
        """Return the mode, the user and the group that a file had."""
        info = self.tar.getmember(name)
        return info.mode & 0o644, info.uname, info.gname


def copy_state(state_dir: Path, to: Path) -> dict[str, int]:
    """Copy the state's files into a folder, and those of 0.2.0 if no later version has run; return versions.

    0.2.0 itself must not run meanwhile. DamagedError, NewerError, StoreError, OSError.
    """
    os.listdir(state_dir)  # where this is not permitted, nothing in it seems to exist
    versions: dict[str, int] = {}
    for name, schema in SCHEMAS.items():
        if (state_dir / name).exists():
            try:
                versions[name] = copy_file(state_dir / name, schema, to / name)
            except DamagedError as error:
                raise DamagedError(f"{error} (start the gateway once, which sets it aside)") from error
    old = files_of_0_2(state_dir) if is_import_due(state_dir) else ()
    for name in old:  # as they are, with what may be damaged in them
        (to / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(state_dir / name, to / name)
    return {**versions, **dict.fromkeys(old, 1)}


def is_state_name(name: str) -> bool:
    """Return whether a backup may hold a file of this name, relative to the state directory."""
    return name in SCHEMAS or is_file_of_0_2(name)


def upgrade(state_dir: Path) -> None:
    """Take all files to the present version. StoreError."""
    import_files(state_dir)
    for name in found_versions(state_dir):
        write_file(state_dir / name, SCHEMAS[name], lambda _: None)


def write_archive(path: Path, facts: Manifest, members: Sequence[Member]) -> None:
    """Write a backup, for its owner alone; it appears whole, and after it was verified, or not at all.

    `facts` get what is in it. OSError, StoreError.
    """
    import tarfile

    for member in members:
        with member.content.open("rb") as content:
            facts.files[member.name] = _digest(content)
    new = path.with_name(path.name + NEW)
    try:
        with (
            open(new, "wb", opener=_fresh) as file,
            tarfile.open(
                fileobj=file, mode="w:gz", compresslevel=PACKING, format=tarfile.PAX_FORMAT, dereference=True
            ) as tar,
        ):
            text = facts.model_dump_json(indent=1).encode()
            info = tarfile.TarInfo(MANIFEST)
            info.size = len(text)
            tar.addfile(info, io.BytesIO(text))
            for member in members:
                _add(tar, member)
        sync_file(new)
        with open_archive(new):
            put_in_place(new, path)
    finally:
        new.unlink(missing_ok=True)


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Open a backup and verify all of it; DamagedError, NewerError, StoreError when it cannot be read."""
    import gzip
    import tarfile

    with translated(path):
        try:
            with tarfile.open(path, mode="r:gz") as tar:
                yield Archive(_verified(tar, tar.getmembers(), path), tar)
        except (tarfile.TarError, EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise DamagedError(f"{path} is no whole backup: {error} (take another copy)") from error


def _verified(tar: tarfile.TarFile, infos: Sequence[tarfile.TarInfo], path: Path) -> Manifest:
    if not infos or infos[0].name != MANIFEST:
        raise DamagedError(f"{path} is no backup of a gateway: it does not begin with {MANIFEST}")
    text = _opened(tar, infos[0]).read()
    try:
        said = json.loads(text)
        later = {name for name, schema in SCHEMAS.items() if said["state"].get(name, 0) > len(schema.steps)}
        if later or said["format"] > FORMAT:
            raise NewerError(f"{path} was made by a later version, {said['version']} (use that one)")
        manifest = Manifest.model_validate_json(text)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DamagedError(f"{path}: its {MANIFEST} is damaged") from error
    if list(manifest.files) != [info.name for info in infos[1:]]:
        raise DamagedError(f"{path}: its files are not those of its manifest")
    for info in infos[1:]:
        if _digest(_opened(tar, info)) != manifest.files[info.name]:
            raise DamagedError(f"{path}: {info.name} is not what was stored")
    return manifest


def _opened(tar: tarfile.TarFile, info: tarfile.TarInfo) -> io.BufferedReader:
    source = tar.extractfile(info) if info.isreg() else None
    if not isinstance(source, io.BufferedReader):
        raise DamagedError(f"{info.name} is no file")
    return source


def _digest(content: io.BufferedReader) -> str:
    return hashlib.file_digest(content, "sha256").hexdigest()


def _add(tar: tarfile.TarFile, member: Member) -> None:
    import tarfile

    info = tar.gettarinfo(member.like, arcname=member.name)
    info.type = tarfile.REGTYPE  # also where it is like a folder
    with member.content.open("rb") as file:
        info.size = os.fstat(file.fileno()).st_size
        tar.addfile(info, file)


def _fresh(path: str, flags: int) -> int:
    Path(path).unlink(missing_ok=True)  # one with other rights, or a link
    return private(path, flags | os.O_EXCL)


def own_files(state_dir: Path) -> Iterator[Path]:
    """Yield what is a gateway's own in a folder, whatever it is: a folder may be in the way of a file."""
    yield from (path for path in state_dir.iterdir() if OWN_NAMES.fullmatch(path.name))
    yield from (state_dir / name for name in files_of_0_2(state_dir))


def found_versions(state_dir: Path) -> dict[str, int]:
    """Return the version of each file that is there and can be read, by name; NewerError for a later one."""
    versions: dict[str, int] = {}
    for name, schema in SCHEMAS.items():
        try:
            versions[name] = stored_version(state_dir / name, schema)
        except NewerError:
            raise
        except StoreError:
            continue
    return versions


def is_upgrade_due(state_dir: Path) -> bool:
    """Return whether a file is of an earlier version, or all are; NewerError for a later one."""
    found = found_versions(state_dir).items()
    return is_import_due(state_dir) or any(version < len(SCHEMAS[name].steps) for name, version in found)
