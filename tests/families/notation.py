"""Commands, rows and writes as words, for tables: `set P314=30`, `VB01=0x4102 slot=2`, `5003:0101 c100:1`.

A command: `start`, `jog on`, `direction reverse`, `reset whole`, `read P003`, `read P003 P002`, `set P314=5`,
`set P314=5 P313=1`, `output RL1=True`, `configure R41=30`. Rows: words by code (several with commas), points
in small letters (1, 0 or ?), `slot`, `firmware` and `model` of the starter. Writes: `c100:1` a coil,
`5003:0101` a register, `1110:FFFB,FFFF` several, `685&FFFA|0000` by mask.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any

import pytest

from gateway.contract import CommandError, ResultCode
from gateway.families.command.procedures import build, prepare
from gateway.families.profile.load import load_profile
from gateway.families.profile.procedure import Preparation, Procedure
from gateway.families.profile.schema import Variant
from gateway.modbus.pdu import Request


def table(text: str) -> list[list[str]]:
    """Return the rows of a table, a line each: cells parted by bars, and perhaps a remark behind `#`."""
    lines = (line.partition("#")[0] for line in text.strip().splitlines())
    return [[cell.strip() for cell in line.split("|")] for line in lines]


def command(text: str) -> tuple[str, dict[str, Any]]:
    """Return verb and arguments."""
    verb, *words = text.split()
    pairs = {name: _value(word) for name, sign, word in (each.partition("=") for each in words) if sign}
    plain = [word for word in words if "=" not in word]
    if verb == "read":
        return verb, {"parameters": plain} if len(plain) > 1 else {"parameter": plain[0]}
    if verb == "set" and len(pairs) == 1:
        ((code, value),) = pairs.items()
        return verb, {"parameter": code, "value": value}
    if verb == "set":
        return verb, {"parameters": pairs}
    if verb == "output":
        ((name, value),) = pairs.items()
        return verb, {"output": name, "value": value}
    if verb == "reset":
        return verb, dict.fromkeys(plain, True) | pairs
    return verb, pairs | ({"value": _value(plain[0])} if plain else {})


def rows(text: str) -> tuple[Variant, dict[str, Any]]:
    """Return what is known of a starter: its variant, its rows and points."""
    known: dict[str, Any] = {}
    variant: dict[str, Any] = {"slot": 1}
    for name, word in (each.split("=") for each in text.split()):
        if name == "slot":
            variant[name] = int(word) or None
        elif name in ("firmware", "model"):
            variant[name] = word
        elif name.islower():
            known[name] = {"1": True, "0": False, "?": None}[word]
        else:
            known[name] = tuple(int(each, 0) for each in word.split(","))
    return Variant(**variant), known


def prepared(family: str, text: str, known: str = "") -> Preparation:
    """Prepare a command."""
    return prepare(load_profile(family), rows(known)[0], *command(text))


def built(family: str, text: str, known: str = "") -> Procedure:
    """Build a command."""
    variant, seen = rows(known)
    return build(load_profile(family), variant, *command(text), seen=seen)


def writes(family: str, text: str, known: str = "", *, whole: bool = False) -> str:
    """Return what a command itself writes; with `whole` also the run = 0 around it (test_run_command.py)."""
    steps = built(family, text, known).steps
    return " ".join(
        shown(step.request) for step in steps if whole or not (step.is_run_off or step.may_be_refused)
    )


def shown(request: Request) -> str:
    """Return a request as words: a read is `h5001*1` (c coils, d inputs, h and i registers)."""
    pdu = request.encode()
    address, word = int.from_bytes(pdu[1:3]), pdu[3:5].hex().upper()
    match pdu[0]:
        case 1 | 2 | 3 | 4:
            return f"{'cdhi'[pdu[0] - 1]}{address}*{int(word, 16)}"
        case 5:
            return f"c{address}:{int(pdu[3] == 0xFF)}"
        case 6:
            return f"{address}:{word}"
        case 16:
            return f"{address}:{pdu[6:].hex(',', 2).upper()}"
        case 22:
            return f"{address}&{word}|{pdu[5:].hex().upper()}"
    return pdu.hex(" ")


def reads(preparation: Preparation) -> str:
    """Return what is read: `h5001*1=VB01`."""
    return " ".join(f"{shown(read.request)}={','.join(read.codes)}" for read in preparation.reads)


def refusal(family: str, verb: str, args: Mapping[str, Any], known: str = "") -> CommandError:
    """Return why a command is refused before anything is read."""
    with pytest.raises(CommandError) as caught:
        prepare(load_profile(family), rows(known)[0], verb, args)
    assert caught.value.code in set(ResultCode)
    return caught.value


def _value(word: str) -> Any:
    try:
        return ast.literal_eval(word)
    except (SyntaxError, ValueError):
        return word


def said(procedure: Procedure) -> str:
    """Return what the operator must know with the result."""
    return "; ".join(note.text for note in procedure.notes)
