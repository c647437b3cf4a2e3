"""A starter whose points are mapped to fast words."""

from __future__ import annotations

from tests.starters.one_starter import OneStarter

MAP = range(1300, 1350)


STATUS, VALUES = bytes.fromhex("03 02A8"), bytes.fromhex("03 0002")


FAST = bytes.fromhex("03 05DC")


def map_writes(here: OneStarter) -> list[bytes]:
    """Return the writes that reached the map."""
    return [w.pdu for w in here.unit.writes if 1300 <= int.from_bytes(w.pdu[1:3], "big") < 1350]


def asked(here: OneStarter, start: bytes) -> int:
    return sum(pdu.startswith(start) for pdu in here.requests())
