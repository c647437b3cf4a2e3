"""What the tables of this folder share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from tests.rig import RigPlant, msg
from tests.rig.rows import Action, Expectation


def refuse_rows(
    name: str,
    addresses: Iterable[int],
    code: int = 2,
    *,
    for_s: float | None = None,
    functions: tuple[int, ...] = (3, 4),
) -> Action:
    """Have a starter refuse each read that has one of these registers in it, with an exception code."""
    return answers(
        name,
        lambda pdu: bytes((pdu[0] | 0x80, code)) if reads_any(pdu, addresses, functions) else b"",
        for_s=for_s,
    )


def reads_any(pdu: bytes, addresses: Iterable[int], functions: tuple[int, ...] = (3, 4)) -> bool:
    """Return whether a request is a read that has one of these registers in it."""
    first, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    return pdu[0] in functions and any(first <= each < first + count for each in addresses)


def answers(
    name: str, habit: Callable[[bytes], bytes | None], *, for_s: float | None = None
) -> Callable[[RigPlant], None]:
    """Have a starter answer requests in another way; `habit` returns nothing (b"") for its own answer."""

    def change(plant: RigPlant) -> None:
        starter = plant.starter(name)
        own = starter._own
        end_s = plant.world.now_s() + (for_s if for_s is not None else 1e9)

        def handle(pdu: bytes, now_s: float) -> bytes | None:
            said = habit(pdu) if plant.world.now_s() < end_s else b""
            return own(pdu, now_s) if said == b"" else said

        starter._own = handle

    return change


def names_itself(name: str, product: str, *, for_s: float | None = None) -> Action:
    """Have a device say another product's name when it is asked for its identification (FC43)."""
    texts = (b"ACME", product.encode(), b"V1.00")
    objects = b"".join(bytes((number, len(text))) + text for number, text in enumerate(texts))
    reply = bytes.fromhex("2b 0e 01 81 00 00 03") + objects
    return answers(name, lambda pdu: reply if pdu[0] == 0x2B else b"", for_s=for_s)


def is_silent_to_fc43(name: str, *, for_s: float | None = None) -> Action:
    return answers(name, lambda pdu: None if pdu[0] == 0x2B else b"", for_s=for_s)


def is_deaf_after_fc43(name: str, seconds: float) -> Action:
    """Have a device not answer FC43, nor anything else for a while after it."""

    def change(plant: RigPlant) -> None:
        deaf_until_s = 0.0

        def habit(pdu: bytes) -> bytes | None:
            nonlocal deaf_until_s
            now_s = plant.world.now_s()
            if pdu[0] == 0x2B:
                deaf_until_s = now_s + seconds
            return None if now_s < deaf_until_s else b""

        answers(name, habit)(plant)

    return change


def nothing_written(name: str) -> Expectation:
    """Nothing was written to the device that is there now."""
    return lambda plant: str(plant.starter(name).writes or "")


def value(topic: str, value: Any, unit: str = "", **fields: Any) -> Expectation:
    """A value that was read, with its unit."""
    starter, point = topic.split("/")
    fields = {"value": value, "unit": unit, "quality": "good", **fields}
    return msg(f"starter/{starter}/value/{point}", retain=True, qos=1, time=..., seq=..., boot=..., **fields)


def bad(topic: str) -> Expectation:
    starter, point = topic.split("/")
    return msg(f"starter/{starter}/value/{point}", retain=True, value=None, quality="bad")
