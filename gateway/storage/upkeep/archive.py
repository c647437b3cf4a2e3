"""The file of a backup: a tar, compressed, that begins with a manifest of everything in it.

Only regular files whose names stand in the manifest are ever read from one, and none is unpacked by the name
that a tar gives it: the caller says where each goes. What does not fit to its SHA-256 is refused, and so is
what is larger than any gateway's state, before it is read.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import shutil
import stat
import tarfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from operator import attrgetter
from pathlib import Path
from typing import IO, Any, NamedTuple

from gateway.errors import DamagedError, NewerError, StoreError
from gateway.system.whole_files import NEW, private, put_in_place, sync_file

FORMAT = 1
MANIFEST = "manifest.json"
MOST_MANIFEST_BYTES = 4 * 2**20
MOST_BYTES = 2**30  # of all files together; three databases and the audit are a quarter of that at most
MOST_FILES = 1000
MOST_HEADER_BYTES = 16 * 2**20  # of all files' headers together
MOST_READ = 4  # times each file may be read, with something to spare
MOST_TEXT = 4096  # characters of a text in the manifest
CHUNK_BYTES = 2**20

_TOO_MUCH = "it holds what no backup of a gateway does"
_TEXTS = ("version", "made", "gateway", "config", "folder", "state_dir")  # in the manifest, always
_LISTS = ("left_out", "logins")


class Member(NamedTuple):
    """A file to go into a backup: its name there, and where its content is."""

    name: str
    content: Path | bytes
    like: Path | None = None  # whose owner and mode the backup remembers


class Entry(NamedTuple):
    """A file in a backup, as its manifest says."""

    name: str
    octets: int
    sha256: str


def write_archive(path: Path, facts: Mapping[str, Any], members: Sequence[Member]) -> None:
    """Write a backup, for its owner alone; it appears whole, and after it was verified, or not at all.

    OSError, StoreError.
    """
    entries = [_entry(member) for member in members]
    manifest = {"format": FORMAT, **facts, "files": [entry._asdict() for entry in entries]}
    new = path.with_name(path.name + NEW)
    try:
        with (
            open(new, "wb", opener=_fresh) as file,
            gzip.GzipFile(filename="", mode="wb", fileobj=file) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT, dereference=True) as archive,
        ):
            text = json.dumps(manifest, indent=1).encode()
            _add(archive, Member(MANIFEST, text), len(text))
            for member, entry in zip(members, entries, strict=True):
                _add(archive, member, entry.octets)
        sync_file(new)
        with open_archive(new):
            put_in_place(new, path)
    finally:
        new.unlink(missing_ok=True)


class Archive:
    """A backup that was verified, open; see `open_archive`."""

    def __init__(self, archive: tarfile.TarFile, manifest: Mapping[str, Any], entries: list[Entry]) -> None:
        self._archive = archive
        self.manifest = manifest
        self.entries = entries

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        content = io.BytesIO()
        shutil.copyfileobj(self._open(name), content, CHUNK_BYTES)
        return content.getvalue()

    def extract(self, name: str, path: Path) -> None:
        """Write the content of a file to a new one, for its owner alone; it is on the disk then. OSError."""
        source = self._open(name)
        with open(path, "wb", opener=_fresh) as file:
            shutil.copyfileobj(source, file, CHUNK_BYTES)
            file.flush()
            os.fsync(file.fileno())

    def rights(self, name: str) -> tuple[int, str, str]:
        """Return the mode, the user and the group that a file had."""
        info = self._archive.getmember(name)
        return info.mode & 0o644, info.uname, info.gname

    def _open(self, name: str) -> IO[bytes]:
        source = self._archive.extractfile(self._archive.getmember(name))
        if source is None:
            raise DamagedError(f"{name} is no file")
        return source


class _Bounded(gzip.GzipFile):
    """The unpacked stream, of which no more can be read than `left`: a tar's headers may be of any length."""

    left = MOST_HEADER_BYTES

    def read(self, size: int | None = -1) -> bytes:
        if size is None or not 0 <= size <= self.left:
            raise tarfile.TarError(_TOO_MUCH)
        self.left -= size
        return super().read(size)


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Open a backup and verify all of it; DamagedError, NewerError, StoreError when it cannot be read."""
    try:
        with _Bounded(path) as stream, tarfile.open(fileobj=stream, mode="r:") as archive:
            members = list(_members(archive))
            stream.left = MOST_READ * MOST_BYTES
            yield _verified(archive, members, path)
    except (tarfile.TarError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DamagedError(f"{path} is no whole backup: {error} (take another copy)") from error
    except OSError as error:
        raise StoreError(f"{error.filename or path}: {error.strerror or error}") from error


def _verified(archive: tarfile.TarFile, members: list[tarfile.TarInfo], path: Path) -> Archive:
    if not members or members[0].name != MANIFEST or members[0].size > MOST_MANIFEST_BYTES:
        raise DamagedError(f"{path} is no backup of a gateway: it does not begin with {MANIFEST}")
    manifest, entries = _manifest(archive, members[0], path)
    names = [member.name for member in members[1:]]
    if sorted(names) != sorted(entry.name for entry in entries) or len(set(names)) != len(names):
        raise DamagedError(f"{path}: its files are not those of its manifest")
    for member, entry in zip(sorted(members[1:], key=attrgetter("name")), sorted(entries), strict=True):
        source = archive.extractfile(member) if member.size == entry.octets else None
        if source is None or _digest(source) != entry.sha256:
            raise DamagedError(f"{path}: {entry.name} is not what was stored")
    return Archive(archive, manifest, entries)


def _members(archive: tarfile.TarFile) -> Iterator[tarfile.TarInfo]:
    """Yield each file's header, as long as all are no more than a backup can have; TarError."""
    octets = 0
    for number, member in enumerate(archive, 1):
        octets += member.size
        is_plain = member.type in (tarfile.REGTYPE, tarfile.AREGTYPE) and not member.issparse()
        if not is_plain or member.size < 0 or octets > MOST_BYTES or number > MOST_FILES:
            raise tarfile.TarError(_TOO_MUCH)
        yield member


def _manifest(
    archive: tarfile.TarFile, member: tarfile.TarInfo, path: Path
) -> tuple[Mapping[str, Any], list[Entry]]:
    source = archive.extractfile(member)
    try:
        manifest = json.loads(b"" if source is None else source.read())
        if int(manifest["format"]) > FORMAT:
            raise NewerError(f"{path} was made by a later version, {manifest.get('version')} (use that one)")
        entries = [
            Entry(str(each["name"]), int(each["octets"]), str(each["sha256"])) for each in manifest["files"]
        ]
        _require_texts([manifest[key] for key in _TEXTS])
        datetime.fromisoformat(manifest["made"])
        for key in _LISTS:
            _require_texts(list(manifest[key]))
        _require_texts([entry.name for entry in entries])
    except (ArithmeticError, AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise DamagedError(f"{path}: its {MANIFEST} is damaged") from error
    return manifest, entries


def _require_texts(texts: Sequence[object]) -> None:
    """Raise ValueError for what could not be printed as it is."""
    if not all(isinstance(each, str) and len(each) <= MOST_TEXT and each.isprintable() for each in texts):
        raise ValueError


def _entry(member: Member) -> Entry:
    if isinstance(member.content, bytes):
        return Entry(member.name, len(member.content), hashlib.sha256(member.content).hexdigest())
    with member.content.open("rb") as file:
        return Entry(member.name, os.fstat(file.fileno()).st_size, _digest(file))


def _digest(source: IO[bytes]) -> str:
    digest = hashlib.sha256()
    while chunk := source.read(CHUNK_BYTES):
        digest.update(chunk)
    return digest.hexdigest()


def _add(archive: tarfile.TarFile, member: Member, octets: int) -> None:
    info = tarfile.TarInfo(member.name)
    if member.like is not None:
        info = archive.gettarinfo(member.like, arcname=member.name)
        info.type = tarfile.REGTYPE  # also where it is like a folder
        info.mode = stat.S_IMODE(member.like.stat().st_mode)
    else:
        info.mode = 0o600
    info.size = octets
    if isinstance(member.content, bytes):
        archive.addfile(info, io.BytesIO(member.content))
    else:
        with member.content.open("rb") as file:
            archive.addfile(info, file)


def _fresh(path: str, flags: int) -> int:
    Path(path).unlink(missing_ok=True)  # one with other rights, or a link
    return private(path, flags | os.O_EXCL)
