"""The registers of the simulated SSTs: what its models differ in, and how versions and names lie in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

NAME = tuple(f"R{number}" for number in range(22, 30))
DECELERATION, ACCELERATION, AUTO_RESET, TIMEOUT_STOP, TIMEOUT_RESET = 39, 37, 40, 41, 42
AUTO_RESET_OFF = 97

_FIRST = {30: 30, 31: 40, 32: 20, 33: 6, 34: 6, 35: 5, 36: 35, 37: 2, 38: 2, 39: 10, 40: AUTO_RESET_OFF}


@dataclass(frozen=True, slots=True)
class SstModel:
    """One SST: its number in register 0, and since when its name can be read; its ranges: the profile."""

    name: str  # as registers 22-29 give it, but for the variant at its end
    number: int
    hardware: str
    firmware: str  # what it has unless said otherwise
    name_since: str  # firmware that added registers 22-29
    first_values: Mapping[int, int]  # ours


MODELS = (
    SstModel("SST330i", 330, "6.1", "4.04", "4.04", {**_FIRST, 39: 20}),
    SstModel("SST360i", 360, "6.1", "4.04", "4.04", {**_FIRST, 39: 20}),
    SstModel("SST130i-75", 130, "4.4", "2.04", "2.00", {**_FIRST, 30: 75, 31: 75}),
    SstModel("SST130i-140", 130, "4.4", "2.04", "2.00", _FIRST),
)


def find_model(text: str) -> SstModel:
    """Return the model whose name begins this text (SST330i-M-ES), or the first that it begins (SST130i).

    ValueError for none.
    """
    said = text.upper()
    known = [model for model in MODELS if said.startswith(model.name.upper())]
    known = known or [model for model in MODELS if said and model.name.upper().startswith(said)][:1]
    if not known:
        raise ValueError(f"model {text!r} is not one of {', '.join(model.name for model in MODELS)}")
    return max(known, key=lambda model: len(model.name))


def version_words(firmware: str) -> tuple[int, int]:
    """Return registers 2 and 3: SW 4.21 is 0204h, 0001h (erratum E-14)."""
    major, _, minor = firmware.partition(".")
    first, second = divmod(int(f"{minor:0<2}"[:2]), 10)
    return first << 8 | int(major), second


def hardware_word(hardware: str) -> int:
    """Return register 1: HW 6.1 is 0106h."""
    major, _, minor = hardware.partition(".")
    return int(minor) << 8 | int(major)


def name_words(name: str) -> tuple[int, ...]:
    """Return registers 22-29: sixteen characters, two in a register, the first one high."""
    text = name.encode("ascii")[:16].ljust(16, b"\0")
    return tuple(int.from_bytes(text[at : at + 2], "big") for at in range(0, 16, 2))
