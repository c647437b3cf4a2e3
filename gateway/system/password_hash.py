"""Passwords as scrypt lines in the PHC string format: `$scrypt$ln=14,r=8,p=5$<salt>$<hash>` [RFC 7914].

One check takes 16 MiB for about a tenth of a second; hashing releases the interpreter's lock.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import re
import secrets
import unicodedata

LOG_N, R, P = 14, 8, 5
MAX_PASSWORD_BYTES = 1024
LINE_PATTERN = r"^\$scrypt\$ln=1[0-5],r=8,p=[1-8]\$[A-Za-z0-9+/]{16,64}\$[A-Za-z0-9+/]{43,86}$"

_MAX_MEMORY_BYTES = 64 * 1024 * 1024
_LINE = re.compile(r"\$scrypt\$ln=(\d\d),r=(\d),p=(\d)\$([A-Za-z0-9+/]+)\$([A-Za-z0-9+/]+)", re.ASCII)
_SALT_BYTES, _HASH_BYTES = 16, 32


def password_line(password: str, *, salt: bytes | None = None) -> str:
    """Return the line that verifies this password; ValueError for an empty or too long one."""
    salt = secrets.token_bytes(_SALT_BYTES) if salt is None else salt
    digest = _digest(_encoded(password), salt, log_n=LOG_N, r=R, p=P, size=_HASH_BYTES)
    return f"$scrypt$ln={LOG_N},r={R},p={P}${_to_text(salt)}${_to_text(digest)}"


def is_password(password: str, line: str) -> bool:
    """Return whether a password is the one of this line; in the same time, whatever differs."""
    match = _LINE.fullmatch(line)
    if match is None:
        return False
    log_n, r, p = (int(number) for number in match.group(1, 2, 3))
    try:
        salt, expected = _from_text(match[4]), _from_text(match[5])
        digest = _digest(_encoded(password), salt, log_n=log_n, r=r, p=p, size=len(expected))
    except (ValueError, binascii.Error):
        return False
    return hmac.compare_digest(digest, expected)


def unmatched_line() -> str:
    """Return a line that no password fits: an unknown user is checked against it, in the usual time."""
    return f"$scrypt$ln={LOG_N},r={R},p={P}${_to_text(bytes(_SALT_BYTES))}${_to_text(bytes(_HASH_BYTES))}"


def _encoded(password: str) -> bytes:
    encoded = unicodedata.normalize("NFC", password).encode("utf-8")
    if not 0 < len(encoded) <= MAX_PASSWORD_BYTES:
        raise ValueError(f"a password has 1 to {MAX_PASSWORD_BYTES} bytes")
    return encoded


def _digest(password: bytes, salt: bytes, *, log_n: int, r: int, p: int, size: int) -> bytes:
    return hashlib.scrypt(password, salt=salt, n=2**log_n, r=r, p=p, maxmem=_MAX_MEMORY_BYTES, dklen=size)


def _to_text(raw: bytes) -> str:
    return base64.b64encode(raw).decode("ascii").rstrip("=")


def _from_text(text: str) -> bytes:
    return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
