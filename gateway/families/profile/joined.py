"""Texts over several rows: name, firmware and serial number of an SST (sst-intecma, register table)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gateway.families.profile.schema import Join, Profile


def joined(profile: Profile, rows: Mapping[str, Sequence[int]]) -> dict[str, str | None]:
    """Return the texts that these rows (words by code) make together, by name; None: no plausible one."""
    return {
        name: JOINS[join.how](_words(join, rows))
        for name, join in profile.joins.items()
        if all(code in rows for code in join.codes)
    }


def text_of(words: Sequence[int]) -> str | None:
    """Return the name in registers 22-29, whichever byte comes first: the order is not stated."""
    for order in ("big", "little"):
        octets = b"".join(word.to_bytes(2, order) for word in words)
        text = octets.split(b"\0", 1)[0].decode("latin-1").rstrip()
        if text.startswith("SST") and text.isascii() and text.isprintable():
            return text
    return None


def version_of(words: Sequence[int]) -> str:
    """Return the version in registers 2 and 3: 0204h, 0001h is 4.21 (erratum E-14)."""
    return f"{words[0] & 0xFF}.{words[0] >> 8}{words[1] & 0xFF}"


def serial_of(words: Sequence[int]) -> str | None:
    """Return the serial number: 32 bits in registers 8-9, or 64 when 10 or 11 is used (four are reserved)."""
    used = words if any(words[2:]) else words[:2]
    number = int.from_bytes(b"".join(word.to_bytes(2, "big") for word in used), "big")
    return str(number) if number else None


JOINS: dict[str, Callable[[Sequence[int]], str | None]] = {
    "text": text_of,
    "version": version_of,
    "serial": serial_of,
}


def _words(join: Join, rows: Mapping[str, Sequence[int]]) -> list[int]:
    return [word for code in join.codes for word in rows[code]]
