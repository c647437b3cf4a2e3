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
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.cli.broker_kit.logins import access_list
from gateway.cli.broker_kit.rights import Login
from gateway.cli.broker_kit.settings import SETTINGS
from gateway.config import password_in
from gateway.errors import UsageError

FOLDER = "logins"  # of a kit: one file a login
CENTRAL = "central"  # the part of the kit for the central broker
CENTRAL_CA = "central-ca.pem"

_FILES = ("passwords", "acl", CA_KEY, CA, KEY, CERT, "mosquitto.conf", CENTRAL_CA, "bridge.conf")
_FOLDERS = (FOLDER, CENTRAL, f"{CENTRAL}/{FOLDER}")
_STAGE = ".new-"
_ITERATIONS = 101  # mosquitto_passwd's; no number of them could improve the 160 bits that are drawn below
_SALT_BYTES, _HASH_BYTES = 12, 64
_PASSWORD_BYTES = 20


def is_kit(folder: Path) -> bool:
    """Return whether a kit was written into this folder."""
    return (folder / SETTINGS).exists()


@contextmanager
def replaced(folder: Path) -> Iterator[Path]:
    """Yield a private folder for a whole kit; without an error it then takes the place of what `folder` has.

    UsageError for a folder with other things in it, of another user or in use; OSError by the disk.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.stat().st_uid != os.geteuid():
        what = f"{folder} belongs to another user, who could change the kit"
        raise UsageError(f"{what} (choose another folder)")
    others = [each.name for each in folder.iterdir() if not each.name.startswith(_STAGE)]
    if others and not is_kit(folder):
        raise UsageError(f"{folder} holds no kit, but {min(others)} (choose a new or an empty folder)")
    folder.chmod(0o700)
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for killed in folder.glob(f"{_STAGE}*"):  # it has keys and passwords
            shutil.rmtree(killed)
        with tempfile.TemporaryDirectory(prefix=_STAGE, dir=folder) as stage:
            yield Path(stage)
            _move_over(Path(stage), folder)
    except BlockingIOError as error:
        raise UsageError(f"{folder} is being written by another broker-kit (wait for its end)") from error
    finally:
        os.close(handle)


def _move_over(stage: Path, folder: Path) -> None:
    """Move every file of a kit, the one that marks the folder at last; remove those of the old kit alone."""
    for part in _FOLDERS:
        if (folder / part).is_symlink():
            (folder / part).unlink()
    old = {
        *_FILES,
        *(str(each.relative_to(folder)) for part in _FOLDERS for each in (folder / part).glob("*")),
    }
    new = sorted(str(path.relative_to(stage)) for path in stage.rglob("*") if path.is_file())
    for name in sorted(new, key=lambda name: name == SETTINGS):
        (folder / name).parent.mkdir(mode=0o700, exist_ok=True)
        (stage / name).replace(folder / name)
    for name in old.difference(new, _FOLDERS):
        (folder / name).unlink(missing_ok=True)
    if not (stage / CENTRAL).exists():
        shutil.rmtree(folder / CENTRAL, ignore_errors=True)


def write_logins(folder: Path, logins: Sequence[Login], stored: Iterable[Path]) -> dict[str, str]:
    """Write an access list, Mosquitto's password file, and each login's password in a file of its own.

    Return the passwords: of the first of the folders `stored` that has one for a login, else a new one.
    """
    (folder / FOLDER).mkdir(mode=0o700, parents=True)
    passwords = {}
    for login in logins:
        files = [path for path in (each / FOLDER / login.name for each in stored) if path.exists()]
        password = password_in(files[0]) if files else secrets.token_urlsafe(_PASSWORD_BYTES)
        write_private(folder / FOLDER / login.name, f"{password}\n")
        passwords[login.name] = password
    lines = (password_line(name, password) for name, password in passwords.items())
    write_private(folder / "passwords", "".join(f"{line}\n" for line in lines))
    write_private(folder / "acl", access_list(logins))
    return passwords


def password_line(name: str, password: str, *, salt: bytes | None = None) -> str:
    """Return a login's line of the password file."""
    salt = secrets.token_bytes(_SALT_BYTES) if salt is None else salt
    digest = hashlib.pbkdf2_hmac("sha512", password.encode(), salt, _ITERATIONS, _HASH_BYTES)
    salt_text, digest_text = (base64.b64encode(raw).decode("ascii") for raw in (salt, digest))
    return f"{name}:$7${_ITERATIONS}${salt_text}${digest_text}"


def write_private(path: Path, text: str) -> None:
    """Write a new file that only its owner may read, from its first byte on."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)
