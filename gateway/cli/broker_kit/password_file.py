"""Passwords for the broker: drawn at random, stored for their users, and hashed as Mosquitto reads them.

A line of Mosquitto's password file is `name:$7$ITERATIONS$SALT$HASH`: PBKDF2 with SHA-512, salt and hash in
base64 [mosquitto_passwd(1); RFC 8018 5.2].
"""

from __future__ import annotations

import base64
import hashlib
import os
import secrets
from collections.abc import Iterable, Mapping
from pathlib import Path

from gateway.config.secrets import password_in

FOLDER = "logins"  # of a kit: one file a login

_ITERATIONS = (
    101  # mosquitto_passwd's; what is drawn below has 160 bits, which no number of them could improve
)
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
