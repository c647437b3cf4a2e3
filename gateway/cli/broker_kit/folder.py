"""The folder of a kit: which one may be written to, and how a whole new kit takes the place of the old one.

A kit is made in a private folder inside its folder and moved over when it is complete: what is refused on the
way changes nothing, and a symbolic link in the folder is replaced, not followed.

Each password lies in a file of its own. A line of Mosquitto's password file is
`name:$7$ITERATIONS$SALT$HASH`: PBKDF2 with SHA-512, salt and hash in base64
[mosquitto_passwd(1); RFC 8018 5.2].
"""

from __future__ import annotations

import base64
import fcntl
import hashlib
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.config.secrets import password_in
from gateway.errors import UsageError

SETTINGS = "kit.json"  # what makes a folder a kit; moved over last
CENTRAL = "central"  # the part of the kit for the central broker
CENTRAL_CA = "central-ca.pem"

_FILES = ("passwords", "acl", CA_KEY, CA, KEY, CERT, "mosquitto.conf", CENTRAL_CA, "bridge.conf", SETTINGS)
_STAGE = ".new-"


def is_kit(folder: Path) -> bool:
    """Return whether a kit was written into this folder."""
    return (folder / SETTINGS).exists()


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """Yield a private folder for a whole kit; without an error it then takes the place of what `folder` has.

    UsageError for a folder with other things in it, of another user or in use; OSError by the disk.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    _require_usable(folder)
    folder.chmod(0o700)
    with _locked(folder):
        for killed in folder.glob(f"{_STAGE}*"):  # it has keys and passwords
            shutil.rmtree(killed)
        stage = Path(tempfile.mkdtemp(prefix=_STAGE, dir=folder))
        try:
            yield stage
            _move_over(stage, folder)
        finally:
            shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Have the folder alone; UsageError while another process has it."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UsageError(f"{folder} is being written by another broker-kit (wait for its end)") from error
        yield
    finally:
        os.close(handle)


def _require_usable(folder: Path) -> None:
    if folder.stat().st_uid != os.geteuid():
        raise UsageError(
            f"{folder} belongs to another user, who could change the kit (choose another folder)"
        )
    others = [each.name for each in folder.iterdir() if not each.name.startswith(_STAGE)]
    if others and not is_kit(folder):
        raise UsageError(f"{folder} holds no kit, but {min(others)} (choose a new or an empty folder)")
    for name in (FOLDER, CENTRAL, f"{CENTRAL}/{FOLDER}"):
        if os.path.lexists(folder / name) and not stat.S_ISDIR((folder / name).lstat().st_mode):
            raise UsageError(f"{folder / name} is no folder (remove it)")


def _move_over(stage: Path, folder: Path) -> None:
    """Move every file of a kit; remove what the new kit does not have."""
    for part in (FOLDER, f"{CENTRAL}/{FOLDER}"):
        _move_all(stage / part, folder / part)
    if (stage / CENTRAL).is_dir():
        _move_all(stage / CENTRAL, folder / CENTRAL)
    else:
        shutil.rmtree(folder / CENTRAL, ignore_errors=True)
    for name in _FILES:
        if (stage / name).exists():
            (stage / name).replace(folder / name)
        else:
            (folder / name).unlink(missing_ok=True)


def _move_all(source: Path, target: Path) -> None:
    if not source.is_dir():
        return
    target.mkdir(mode=0o700, parents=True, exist_ok=True)
    target.chmod(0o700)
    files = [each for each in source.iterdir() if not each.is_dir()]
    for each in files:
        each.replace(target / each.name)
    for old in target.iterdir():
        if old.name not in {each.name for each in files} and not old.is_dir():
            old.unlink()


FOLDER = "logins"  # of a kit: one file a login

_ITERATIONS = 101  # mosquitto_passwd's; no number of them could improve the 160 bits that are drawn below
_SALT_BYTES, _HASH_BYTES = 12, 64
_PASSWORD_BYTES = 20


def drawn_passwords(names: Iterable[str], *stored: Path) -> dict[str, str]:
    """Return a password for each login: of the first folder `stored` that has one, else a new one."""
    passwords = {}
    for name in names:
        files = [folder / name for folder in stored if (folder / name).exists()]
        passwords[name] = password_in(files[0]) if files else secrets.token_urlsafe(_PASSWORD_BYTES)
    return passwords


def password_line(name: str, password: str, *, salt: bytes | None = None) -> str:
    """Return a login's line of the password file."""
    salt = secrets.token_bytes(_SALT_BYTES) if salt is None else salt
    digest = hashlib.pbkdf2_hmac("sha512", password.encode(), salt, _ITERATIONS, _HASH_BYTES)
    salt_text, digest_text = (base64.b64encode(raw).decode("ascii") for raw in (salt, digest))
    return f"{name}:$7${_ITERATIONS}${salt_text}${digest_text}"


def password_file(passwords: Mapping[str, str]) -> str:
    """Return the text of the password file."""
    return "".join(f"{password_line(name, password)}\n" for name, password in passwords.items())


def write_private(path: Path, text: str) -> None:
    """Write a file that only its owner may read, from its first byte on; what was there is replaced."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)
