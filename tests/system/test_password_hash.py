"""Passwords as scrypt lines."""

from __future__ import annotations

import base64
import hashlib
import re

import pytest

from gateway.system.password_hash import LINE_PATTERN, is_password, password_line, unmatched_line


def test_a_line_verifies_its_password_in_either_encoding_and_no_other() -> None:
    line = password_line("M\u00fcller1")

    assert re.fullmatch(LINE_PATTERN, line)
    assert is_password("Mu\u0308ller1", line)
    assert not is_password("Muller1", line)
    assert not is_password("", line)
    assert password_line("M\u00fcller1") != line


def test_the_hash_is_the_one_of_rfc_7914() -> None:
    digest = hashlib.scrypt(b"pleaseletmein", salt=b"SodiumChloride", n=16384, r=8, p=1, dklen=64)
    assert digest.hex().startswith("7023bdcb3afd7348461c06cd81fd38eb")  # RFC 7914, section 12
    salt, text = (base64.b64encode(raw).decode().rstrip("=") for raw in (b"SodiumChloride", digest))
    line = f"$scrypt$ln=14,r=8,p=1${salt}${text}"
    assert is_password("pleaseletmein", line)


@pytest.mark.parametrize("line", ["", "secret", "$scrypt$ln=14,r=8,p=5$x$y", "$2b$12$abc", unmatched_line()])
def test_what_is_no_line_fits_no_password(line: str) -> None:
    assert not is_password("secret", line)


def test_a_line_that_would_take_much_memory_is_no_line() -> None:
    assert re.fullmatch(LINE_PATTERN, unmatched_line())
    assert not re.fullmatch(LINE_PATTERN, unmatched_line().replace("ln=14", "ln=20"))


@pytest.mark.parametrize("password", ["", "x" * 1025])
def test_an_empty_or_endless_password_is_refused(password: str) -> None:
    with pytest.raises(ValueError, match="1 to 1024 bytes"):
        password_line(password)
