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
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from gateway.cli.broker_kit.certificates import CA, CA_KEY, CERT, KEY
from gateway.config.secrets import password_in
from gateway.errors import UsageError

SETTINGS = "kit.json"  # what makes a folder a kit; moved over last
FOLDER = "logins"  # of a kit: one file a login
CENTRAL = "central"  # the part of the kit for the central broker
CENTRAL_CA = "central-ca.pem"

_FILES = ("passwords", "acl", CA_KEY, CA, KEY, CERT, "mosquitto.conf", CENTRAL_CA, "bridge.conf")
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
    """Move every file of a kit, which marks the folder at last; remove what the new kit does not have."""
    parts = [Path(each) for each in (FOLDER, CENTRAL, f"{CENTRAL}/{FOLDER}")]
    for part in parts:
        if (folder / part).is_symlink():
            (folder / part).unlink()
        elif (folder / part).is_dir() and not (stage / part).is_dir():
            shutil.rmtree(folder / part)
        if (stage / part).is_dir():
            (folder / part).mkdir(mode=0o700, exist_ok=True)
    old = {path.relative_to(folder) for part in parts for path in (folder / part).glob("*")}
    old |= {Path(name) for name in _FILES}
    new = [path.relative_to(stage) for path in stage.rglob("*") if path.is_file()]
    for path in sorted(new, key=lambda each: str(each) == SETTINGS):
        (stage / path).replace(folder / path)
    for path in old - set(new) - set(parts):
        (folder / path).unlink(missing_ok=True)


def drawn_passwords(names: Iterable[str], stored: Iterable[Path]) -> dict[str, str]:
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


def write_private(path: Path, text: str) -> None:
    """Write a new file that only its owner may read, from its first byte on."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(text)


def write_logins(folder: Path, access: str, passwords: Mapping[str, str]) -> None:
    """Write an access list, Mosquitto's password file, and each login's password in a file of its own."""
    (folder / FOLDER).mkdir(mode=0o700)
    for name, password in passwords.items():
        write_private(folder / FOLDER / name, f"{password}\n")
    lines = (password_line(name, password) for name, password in passwords.items())
    write_private(folder / "passwords", "".join(f"{line}\n" for line in lines))
    write_private(folder / "acl", access)
