"""What a starter says about itself, and how it is asked; reads only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from gateway.modbus.pdu import Request


@dataclass(frozen=True, slots=True)
class Question:
    """One request of an identification; the answer is handed to `identify` under its tag."""

    tag: str  # fc43, model_register, slots, firmware, model, name
    request: Request


@dataclass(frozen=True, slots=True)
class Identity:
    """What a unit said about itself; None is unknown. `reason` says why the family is, or is not, known."""

    family_seen: str | None = None
    model: str | None = None
    firmware: str | None = None
    serial: str | None = None
    rated_current_a: float | None = None
    rating: str | None = None  # SSW900: the range of currents of its size (S3.3.1)
    slot: Literal[1, 2] | None = None  # SSW900: where the RS-485 accessory sits
    accessories: tuple[str, ...] = ()  # SSW900: the kinds in slots 1 and 2
    hardware: str | None = None  # SST: its version
    reason: str = ""
