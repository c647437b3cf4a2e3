"""What the tests of commands share: frames in hex, and rows as a starter would show them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gateway.families.command.build import build
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import Procedure
from gateway.families.profile.schema import Variant
from gateway.modbus.adu import encode
from gateway.modbus.pdu import Request

RUNNING, ENABLED, JOG, ACCELERATING, DECELERATING, REMOTE, REVERSE, SUPPLIED, FAULT = (
    1 << bit for bit in (0, 1, 2, 3, 7, 8, 11, 14, 15)
)
READY = ENABLED | REMOTE | SUPPLIED  # VB01 of an SSW-06 or SSW-07 at rest
NOT_STARTING = {
    "running": False,
    "reversing": False,
    "s5_1_1_3": False,
    "s5_1_1_12": False,
}  # the last two of an SSW900
SLOT_1, SLOT_2, NO_SLOT = Variant(slot=1), Variant(slot=2), Variant()


def frame(request: Request) -> str:
    """Return the frame to unit 1."""
    return encode(1, request.encode()).hex(" ").upper()


def own(procedure: Procedure) -> list[Request]:
    """Return what a command itself writes, without the run = 0 around it (see test_run_command.py)."""
    return [step.request for step in procedure.steps if not (step.is_run_off or step.may_be_refused)]


def words(procedure: Procedure) -> list[tuple[int, int]]:
    """Return address and word of each FC06 that a command itself writes."""
    frames = [request.encode() for request in own(procedure)]
    return [
        (int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")) for pdu in frames if pdu[0] == 6
    ]


def built(
    family: str,
    verb: str,
    args: Mapping[str, Any] | None = None,
    *,
    variant: Variant = SLOT_1,
    **rows: Any,
) -> Procedure:
    """Build a command; rows are given as VB01=word, with _ for the dots of an SSW900 code."""
    seen = {code.replace("_", "."): (word,) if isinstance(word, int) else word for code, word in rows.items()}
    return build(load_profile(family), variant, verb, args or {}, seen=seen)


def frames(family: str, verb: str, args: Mapping[str, Any] | None = None, **rows: Any) -> list[str]:
    """Return the frames to unit 1 that a command itself writes."""
    return [frame(request) for request in own(built(family, verb, args, **rows))]
